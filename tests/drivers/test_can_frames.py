from __future__ import annotations

import numpy as np
from can_strategies import frames_of, rows, rows_of
from hypothesis import given
from hypothesis import strategies as st

from drivers.can_frames import concatenate


@given(st.lists(rows(), min_size=1, max_size=4))
def test_concatenated_batches_say_what_each_says(drawn: list[list]) -> None:
    joined = concatenate([frames_of(part) for part in drawn])
    assert rows_of([joined]) == [row for part in drawn for row in part]
    assert joined.data.shape[1] in (8, 64)


@given(rows(), st.data())
def test_selected_frames_are_those(drawn: list, data: st.DataObject) -> None:
    frames = frames_of(drawn)
    mask = np.array(data.draw(st.lists(st.booleans(), min_size=len(drawn), max_size=len(drawn))))
    mask = mask.astype(np.bool_)
    assert rows_of([frames.select(mask)]) == [
        row for row, keep in zip(drawn, mask, strict=True) if keep
    ]
    assert rows_of([frames.select(slice(1, 3))]) == drawn[1:3]


def test_the_highest_drop_count_survives() -> None:
    batches = [frames_of([], dropped=3), frames_of([], dropped=7), frames_of([], dropped=5)]
    assert concatenate(batches).dropped == 7

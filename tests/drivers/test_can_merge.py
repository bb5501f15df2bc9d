from __future__ import annotations

from collections.abc import Iterator

from can_strategies import Row, frames_of, rows, rows_of
from hypothesis import given
from hypothesis import strategies as st

from drivers.can_frames import CanFrames
from drivers.can_merge import merge_by_time

CLOSE = st.integers(0, 20)


def stream(drawn: list[Row], batch: int) -> Iterator[CanFrames]:
    for start in range(0, len(drawn), batch):
        yield frames_of(drawn[start : start + batch])


@given(st.lists(rows(stamps=CLOSE), min_size=1, max_size=4), st.integers(1, 5))
def test_sorted_streams_become_one_sorted_stream(drawn: list[list[Row]], batch: int) -> None:
    drawn = [sorted(part, key=lambda row: row.stamp_ns) for part in drawn]
    merged = rows_of(merge_by_time([stream(part, batch) for part in drawn]))
    assert [row.stamp_ns for row in merged] == sorted(row.stamp_ns for row in merged)
    assert sorted(merged) == sorted(row for part in drawn for row in part)


@given(st.lists(rows(stamps=CLOSE), min_size=1, max_size=4), st.integers(1, 5))
def test_every_stream_keeps_its_own_order(drawn: list[list[Row]], batch: int) -> None:
    drawn = [[row._replace(channel=f"can{k}") for row in part] for k, part in enumerate(drawn)]
    merged = rows_of(merge_by_time([stream(part, batch) for part in drawn]))
    for k, part in enumerate(drawn):
        assert [row for row in merged if row.channel == f"can{k}"] == part


def test_a_single_stream_passes_untouched() -> None:
    batches = [frames_of([Row(5, 1, 0, b"", 0, "can0")]), frames_of([Row(3, 2, 0, b"", 0, "can0")])]
    assert list(merge_by_time([iter(batches)])) == batches

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.degrade.draw import DrawKey
from models.degrade.kinds import KINDS, module_of
from models.degrade.parameters import from_json, to_json

EVERY = [(sensor_type, kind) for sensor_type, kinds in KINDS.items() for kind in kinds]
keys = st.builds(DrawKey, st.integers(0, 2**63), st.text(max_size=5), st.integers(0, 2**62))


def test_a_kind_belongs_to_one_sensor_type() -> None:
    assert len({kind for _, kind in EVERY}) == len(EVERY)


@settings(max_examples=15, deadline=None)
@given(st.floats(0, 100), keys)
@pytest.mark.parametrize(("sensor_type", "kind"), EVERY)
def test_text_gives_the_drawn_parameters_to_the_last_bit(
    sensor_type: str, kind: str, level: float, key: DrawKey
) -> None:
    drawn = module_of(sensor_type, kind).draw(kind, level, key)
    again = from_json(to_json(drawn))
    assert again == drawn
    assert type(again) is type(drawn)
    assert to_json(again) == to_json(drawn)


@pytest.mark.parametrize(
    "text",
    [
        *("", "[]", "{}", "null", '{"kind": "sun"}', '{"kind": "blur"}'),
        '{"kind": "blur", "level": []}',
        '{"kind": "snr", "level": 50, "ghosts": [{}]}',
    ],
)
def test_other_text_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"\S"):
        from_json(text)

from __future__ import annotations

import pytest

from models.degrade.kinds import KINDS, module_of


@pytest.mark.parametrize(
    ("sensor_type", "kind"), [(name, kind) for name, kinds in KINDS.items() for kind in kinds]
)
def test_every_kind_is_drawn_by_its_module(sensor_type: str, kind: str) -> None:
    assert kind in module_of(sensor_type, kind).KINDS


def test_no_module_has_a_kind_that_is_not_listed() -> None:
    for sensor_type, kinds in KINDS.items():
        listed = {kind for name in kinds for kind in module_of(sensor_type, name).KINDS}
        assert listed == set(kinds)
    with pytest.raises(KeyError):
        module_of("camera", "snr")

from __future__ import annotations

from typing import Any

import pytest

from node.plan import Plan, plan
from node.scene import check_scene


def planned(**content: Any) -> Plan:
    return plan(check_scene(content, "test"))


RADAR = {"name": "radar", "type": "radar", "source": "drive.log"}
CAMERA = {"name": "camera", "type": "camera", "source": "world"}


def test_a_radar_log_needs_neither_video_nor_images() -> None:
    made = planned(sensors=[RADAR])
    assert not {"cv2", "av", "matplotlib"} & set(made.libraries)
    assert made.keeps("source", "radar")
    assert not made.keeps("inject", "radar")
    assert not made.keeps("world")


def test_every_stage_says_why() -> None:
    made = planned(
        sensors=[RADAR, CAMERA],
        injections=[
            {"sensor": "camera", "kind": "blur", "level": 3},
        ],
        outputs={"picture": "a.png"},
        clock={"fast": True},
    )
    assert all(stage.reason for stage in made.stages)
    assert made.keeps("inject", "camera")
    assert made.keeps("world")
    assert made.keeps("picture")
    assert not made.keeps("pace")


@pytest.mark.parametrize(
    ("source", "library"),
    [("socketcan:can0", "can"), ("vcan0", "can"), ("drive.log", "cantools")],
)
def test_the_source_decides_what_reads_it(source: str, library: str) -> None:
    made = planned(sensors=[{**RADAR, "source": source}])
    assert library in made.libraries
    assert ("can" in made.libraries) == (library == "can")

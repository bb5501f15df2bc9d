"""An output to ROS 2 as a scene of a radar and a camera asks for it."""

from __future__ import annotations

from typing import Any

from node.bus.in_process import Bus
from node.bus.ros2 import Ros2Output
from node.outputs import SetInjection
from node.plan import plan
from node.scene import check_scene


def open_output(
    bus: Bus, domain: int, set_injection: SetInjection | None = None, **settings: Any
) -> Ros2Output:
    scene = check_scene(
        {
            "name": settings.pop("name", "tunnel"),
            "sensors": [
                {"name": "front", "type": "radar", "source": "world"},
                {"name": "camera", "type": "camera", "source": "world"},
            ],
            "outputs": {"ros2": {"domain": domain, **settings}},
        },
        "test",
    )
    return Ros2Output(plan(scene), bus, set_injection or (lambda *_: None))

"""A detector that changes models because murk said so, and what it gains.

A switch is a part of the scene (`[[switches]]`, see [scene.md](scene.md)) or of your detector:

```python
from threading import Thread

from models.bev.camera_first import CameraFirst
from models.bev.radar_only import RadarOnly
from node.subscribe import subscribe
from node.switch import ModelSwitch


def detect(bus, rules):
    switch = ModelSwitch(rules, {"camera_first": CameraFirst, "radar_only": RadarOnly})
    levels = subscribe(bus, rules.sensors)  # or "ros2:", "can:socketcan:can0"
    Thread(target=switch.follow, args=(levels,), daemon=True).start()
    for frame in bus.subscribe("/murk/camera/image"):
        scan = bus.latest("/murk/radar/scan")
        if scan is not None:
            yield switch.chosen, switch.model(frame, scan)
```

All models are built, and have answered once, before the first level comes: `ModelSwitch` calls what
builds them when it is made. So no change waits for weights, and a model that cannot be built is
found before the drive. Rules are tried in order and the first that holds decides. A rule on the
level holds on until the level has passed the bound by its hysteresis, a model stays for `dwell_s`
at least, and a sensor without a level for longer than `stale_s` is not waited for. `murk run`
publishes every choice with its reason on `/murk/model`.

The two detectors find road users (vehicles and pedestrians that are on the move or wait in the
traffic) up to 60 m ahead of the simulated camera. `camera_first` is a small network on the picture;
a radar echo confirms what it saw and tells how far away it is. `radar_only` gathers echoes of what
moves, by Doppler, and does not tell what has always stood from the roadside. The network learned
from clean frames only.

The error is the mean OSPA distance of order 1 with a cut-off of 5 m (Schuhmacher et al., 2008): the
mean distance to the road users, where a miss and a false alarm count 5 m each. The switch sees what
the node's estimator says of each degraded frame, never what was injected, and a frame is answered
by the model that was chosen before it came. The bounds of its rules are where the two errors met on
16 other drives than those measured here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import median
from time import monotonic_ns, process_time

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from drivers.frame import Frame
from drivers.scan import RadarScan
from models.bev.camera_first import CameraFirst
from models.bev.ospa import ospa
from models.bev.picture import horizon_of
from models.bev.radar_only import RadarOnly
from models.bev.truth import Truth, truth
from models.evaluate.report import Goal, Picture, Point, Result, Table
from models.world.camera import WorldCamera
from models.world.radar import WorldRadar
from models.world.road import World
from node.chooser import Chooser
from node.estimator import Estimator
from node.injector import Injector
from node.scene import Injection, Sensor
from node.switch_rules import Switch

SEEDS = range(7_000_000, 7_000_006)
DURATION_S = 8.0
RATE_HZ = 6.25
LEVELS = (0, 20, 40, 60, 80, 100)
CHANGING = (
    ("over", ((1.0, 80.0), (3.0, 0.0))),
    ("under", ((4.0, 80.0), (6.0, 0.0))),
)
"""Into a tunnel and out of it: seconds and levels by kind."""
CAMERA_ENDS_S = 4.0
"""When the camera falls silent, where it does."""

RULES = Switch.model_validate(
    {
        "name": "detector",
        "default": "camera_first",
        "dwell_s": 0.5,
        "rules": [
            {"sensor": "camera", "stale_s": 0.5, "model": "radar_only"},
            {
                "sensor": "camera",
                "above": 50,
                "hysteresis": 10,
                "kinds": ["under"],
                "model": "radar_only",
            },
            {
                "sensor": "camera",
                "above": 75,
                "hysteresis": 10,
                "kinds": ["over", "noise"],
                "model": "radar_only",
            },
        ],
    }
)
MODELS = ("camera_first", "radar_only")
_CAMERA = Sensor(name="camera", type="camera", source="world")
_RADAR = Sensor(name="radar", type="radar", source="world")


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """A frame, the newest scan before it, and the truth at the frame's moment."""

    t_s: float
    frame: Frame
    scan: RadarScan
    truth: Truth


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """A simulated drive as both sensors saw it, clean."""

    seed: int
    horizon: float
    moments: tuple[Moment, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """A drive under some injections; (n,) one entry a frame.

    Attributes
    ----------
    t_s:
        Time of the frame, s.
    errors:
        (n, 2) OSPA of each of ``MODELS``, m.
    answered:
        Which of ``MODELS`` the switch let answer.
    levels:
        The camera's estimated level, %.
    run_times_s:
        (n, 2) CPU time of each model, s.
    """

    t_s: NDArray[np.float64]
    errors: NDArray[np.float64]
    answered: NDArray[np.intp]
    levels: NDArray[np.float64]
    run_times_s: NDArray[np.float64]

    @property
    def switched(self) -> NDArray[np.float64]:
        """OSPA of what the switch let answer, m."""
        return np.asarray(self.errors[np.arange(len(self.errors)), self.answered])


def drive(seed: int, duration_s: float = DURATION_S) -> Drive:
    """Record a simulated drive; scans come from the radar's own clock, frames from the camera's."""
    world = World(seed, duration_s)
    camera, radar = WorldCamera(world, rate_hz=RATE_HZ), WorldRadar(world)
    moments, newest = [], 0
    for frame in camera.frames():
        t_s = camera.time(frame.sequence)
        while radar.time(newest + 1) <= t_s:
            newest += 1
        right = truth(world, camera.view(t_s), t_s)
        moments.append(Moment(t_s, frame, radar.scan(newest), right))
    return Drive(seed, horizon_of(camera), tuple(moments))


def replay(
    recorded: Drive, injections: Sequence[Injection], camera_ends_s: float = math.inf
) -> Outcome:
    """Answer a drive with both models and with the switch, under some injections.

    After ``camera_ends_s`` no frame comes any more: the camera's model sees nothing, and its level
    is not told.
    """
    models = (CameraFirst(recorded.horizon), RadarOnly())
    injectors = [
        Injector(sensor, [one for one in injections if one.sensor == sensor.name], recorded.seed)
        for sensor in (_CAMERA, _RADAR)
    ]
    estimator, chooser = Estimator("camera"), Chooser(RULES)
    rows = []
    for moment in recorded.moments:
        answered = MODELS.index(chooser.model)
        frame, _ = injectors[0].inject(moment.frame, moment.t_s)
        scan, _ = injectors[1].inject(moment.scan, moment.t_s)
        level = None
        if moment.t_s < camera_ends_s:
            level = estimator.estimate(frame, arrival_ns=monotonic_ns(), injected=None, dropped=0)
        chooser.update(level, frame.stamp_ns)
        errors, run_times_s = [], []
        for model in models:
            start_s = process_time()
            places = model(frame, scan)
            run_times_s.append(process_time() - start_s)
            blind = level is None and model is models[0]
            errors.append(ospa(places[:0] if blind else places, moment.truth))
        rows.append((moment.t_s, errors, answered, level.level if level else math.nan, run_times_s))
    t_s, errors_m, chosen, levels, times_s = (
        np.array(column) for column in zip(*rows, strict=True)
    )
    return Outcome(t_s, errors_m, chosen, levels, times_s)


def constant(kind: str, level: float) -> list[Injection]:
    """Return one kind at one level, from the first frame on."""
    return [Injection(sensor="radar" if kind == "snr" else "camera", kind=kind, level=level)]


def changing() -> list[Injection]:
    """Return ``CHANGING`` as injections."""
    return [Injection(sensor="camera", kind=kind, points=points) for kind, points in CHANGING]


def run(quick: bool) -> Iterator[Result]:
    """Measure both models and the switch over kinds and levels."""
    kinds = ("under",) if quick else ("blur", "over", "under", "noise", "snr")
    levels = (0, 80) if quick else LEVELS
    conditions = {
        (kind, level): constant(kind, level) if level else [] for kind in kinds for level in levels
    }
    curves: dict[tuple[str, int], list[Outcome]] = {condition: [] for condition in conditions}
    tunnels, ended = [], []
    for seed in SEEDS[:1] if quick else SEEDS:
        recorded = drive(seed)
        clean = replay(recorded, [])
        for condition, injections in conditions.items():
            curves[condition].append(replay(recorded, injections) if injections else clean)
        tunnels.append(replay(recorded, changing()))
        ended.append(replay(recorded, [], CAMERA_ENDS_S))
    yield from _run_times([one for own in curves.values() for one in own])
    means = {condition: _means(own) for condition, own in curves.items()}
    camera, radar, switched, share = np.mean(list(means.values()), axis=0).tolist()
    name = "error with the switch, times that of the better model alone"
    yield Goal(f"{name}, all kinds and levels", switched / min(camera, radar), 1.0, at_least=False)
    yield Table(
        "Error over noise level",
        ("kind", "level, %", *(f"{name}, m" for name in (*MODELS, "switch")), "by radar, %"),
        tuple((kind, level, *means[kind, level]) for kind, level in means),
    )
    yield Table(
        "All of them, a tunnel, and a camera that falls silent",
        ("", *(f"{name}, m" for name in (*MODELS, "switch")), "by radar, %"),
        (
            ("all kinds and levels alike", camera, radar, switched, share),
            ("over 80 % for 2 s, clean for 1 s, under 80 % for 2 s", *_means(tunnels)),
            (f"clean; the camera falls silent after {CAMERA_ENDS_S:g} s", *_means(ended)),
        ),
    )
    yield Picture("Error over noise level", lambda figure: _draw_curves(figure, means))
    yield Picture("Into a tunnel and out of it", lambda figure: _draw_tunnel(figure, tunnels))


def _run_times(outcomes: Sequence[Outcome]) -> Iterator[Point]:
    for number, name in enumerate(MODELS):
        times_us = [1e6 * float(t) for one in outcomes for t in one.run_times_s[:, number]]
        error = float(np.mean([one.errors[:, number].mean() for one in outcomes]))
        yield Point(name, "all kinds and levels", median(times_us), error, "m (OSPA)")


def _means(outcomes: Sequence[Outcome]) -> tuple[float, float, float, float]:
    """Return mean OSPA of both models and of the switch, m, and how often the radar answered, %."""
    camera, radar = np.concatenate([one.errors for one in outcomes]).mean(axis=0).tolist()
    switched = float(np.concatenate([one.switched for one in outcomes]).mean())
    share = float(np.concatenate([one.answered for one in outcomes]).mean())
    return camera, radar, switched, 100 * share


_STYLES = (("C0", "-", "camera_first"), ("C1", "-", "radar_only"), ("black", "--", "switch"))


def _draw_curves(
    figure: Figure, means: dict[tuple[str, int], tuple[float, float, float, float]]
) -> None:
    kinds = list(dict.fromkeys(kind for kind, _ in means))
    axes = figure.subplots(1, len(kinds), sharey=True, squeeze=False)[0]
    for axis, kind in zip(axes, kinds, strict=True):
        levels = [level for own, level in means if own == kind]
        for number, (colour, line, label) in enumerate(_STYLES):
            values = [means[kind, level][number] for level in levels]
            axis.plot(levels, values, color=colour, linestyle=line, marker="o", ms=3, label=label)
        axis.set_title(f"radar, {kind}" if kind == "snr" else f"camera, {kind}", size=10)
        axis.set_xlabel("level, %")
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("error, m (OSPA)")
    axes[0].set_ylim(bottom=0)
    axes[0].legend(frameon=False, fontsize=8, loc="lower left")


def _draw_tunnel(figure: Figure, outcomes: Sequence[Outcome]) -> None:
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    t_s = outcomes[0].t_s
    errors = np.mean([one.errors for one in outcomes], axis=0)
    columns = (errors[:, 0], errors[:, 1], np.mean([one.switched for one in outcomes], axis=0))
    for values, (colour, line, label) in zip(columns, _STYLES, strict=True):
        upper.plot(t_s, values, color=colour, linestyle=line, label=label)
    upper.set_ylabel("error, m (OSPA)")
    upper.set_ylim(bottom=0)
    upper.legend(frameon=False, fontsize=8)
    injected = [max(one.schedule(0).level_at(t) for one in changing()) for t in t_s]
    lower.plot(t_s, injected, color="gray", drawstyle="steps-post", label="injected, %")
    estimated = np.mean([one.levels for one in outcomes], axis=0)
    lower.plot(t_s, estimated, color="C0", label="estimated, %")
    share = 100 * np.mean([one.answered for one in outcomes], axis=0)
    lower.plot(t_s, share, color="black", linestyle="--", label="answered by radar_only, %")
    lower.set_xlabel("time, s")
    lower.legend(frameon=False, fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    for axis in (upper, lower):
        axis.spines[["top", "right"]].set_visible(False)

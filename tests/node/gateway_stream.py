"""Streams of a radar's CAN frames for the tests of the gateway, and a fake clock to run it by."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from drivers.can_frames import CanFrames, concatenate
from drivers.encode import encode_scan
from models.sensor import ARS408
from node.gateway_can import CanGateway
from node.gateway_levels import GatewayLevels
from node.scene import Injection, Sensor
from tests.models.degrade_scans import QUALITY, make_scan

CYCLE_NS = 72_000_000
SPACING_NS = 250_000
PAUSE_NS = 5_000_000
"""A reader that waits longer than this gets what has come until then."""
RADAR = Sensor(name="radar", type="radar", source="virtual:in")
EPOCH_NS = 1_700_000_000_000_000_000
"""Stamps are wall time, the gateway's clock is not."""


def radar_scan(number: int, clusters: int = 40, *, quality: bool = True, sensor_id: int = 0) -> Any:
    rng = np.random.default_rng(number)
    reach = rng.uniform(2, 150, clusters)
    azimuth = rng.uniform(-0.6, 0.6, clusters)
    rows = np.array(
        [
            reach * np.cos(azimuth),
            reach * np.sin(azimuth),
            rng.normal(-5, 8, clusters),
            rng.normal(0, 2, clusters),
            rng.uniform(-5, 30, clusters),
        ]
    )
    x, y, vx, vy, rcs = ARS408.rows_to_grid(rows).astype(np.float32)
    near = clusters * 2 // 3
    order = np.lexsort((np.hypot(x, y), np.arange(clusters) >= near))
    fields: dict[str, Any] = {"sensor_id": sensor_id, "meas_counter": 2 * number % 65536}
    fields["stamp_ns"] = EPOCH_NS + number * CYCLE_NS
    if quality:
        fields |= {name: rng.integers(1, 4, clusters).astype(np.uint8) for name in QUALITY}
    return make_scan(x[order], y[order], vx[order], vy[order], rcs[order], near, **fields)


def radar_frames(number: int, clusters: int = 40, **options: Any) -> CanFrames:
    """Return the frames of one cycle, as the radar sends them."""
    return encode_scan(radar_scan(number, clusters, **options), spacing_ns=SPACING_NS)


def other_frames(stamps_ns: Sequence[int], can_ids: Sequence[int]) -> CanFrames:
    """Return frames that are none of the radar's lists; each payload is unlike every other."""
    count = len(stamps_ns)
    data = np.array([(7 * k + 1).to_bytes(8, "big") for k in range(count)], "S8")
    return CanFrames(
        stamp_ns=np.array(stamps_ns, np.int64).reshape(count),
        can_id=np.array(can_ids, np.uint32).reshape(count),
        length=np.full(count, 8, np.uint8),
        data=np.frombuffer(data.tobytes(), np.uint8).reshape(count, 8),
        flags=np.zeros(count, np.uint8),
        channel=np.zeros(count, np.uint8),
    )


def merged(*streams: CanFrames) -> CanFrames:
    """Return frames of several streams in order of their stamps."""
    frames = concatenate(streams)
    return frames.select(np.argsort(frames.stamp_ns, kind="stable"))


def gateway(
    levels: dict[str, float] | None = None, sensor: Sensor = RADAR, seed: int = 1
) -> tuple[CanGateway, GatewayLevels]:
    """Return a gateway with levels that hold from the start."""
    control = GatewayLevels(sensor, (), (), seed)
    for kind, level in (levels or {}).items():
        control.set_level(kind, level)
    return CanGateway(sensor, control, seed), control


def scheduled(*injections: Injection, seed: int = 1) -> CanGateway:
    return CanGateway(RADAR, GatewayLevels(RADAR, injections, (), seed), seed)


class Clock:
    """Runs a gateway as a bus would, and notes what it sends and when.

    Attributes
    ----------
    sent:
        What was sent, a batch each, and when.
    fed_ns:
        When each frame was fed.
    now_ns:
        Time of the gateway's clock.
    """

    def __init__(self, gateway: CanGateway) -> None:
        self.gateway = gateway
        self.sent: list[tuple[int, CanFrames]] = []
        self.fed_ns: list[int] = []
        self.now_ns = 0

    def play(self, frames: CanFrames, batch: int = 1) -> Clock:
        """Feed frames in batches, each when its last frame has come; a pause ends a batch."""
        pauses = np.flatnonzero(np.diff(frames.stamp_ns) > PAUSE_NS) + 1
        bounds = sorted({*range(0, len(frames), batch), *pauses.tolist(), len(frames)})
        for first, last in pairwise(bounds):
            part = frames.select(slice(first, last))
            self.advance(int(part.stamp_ns[-1]) - EPOCH_NS)
            self.gateway.feed(part, self.now_ns)
            self.fed_ns += [self.now_ns] * len(part)
            self._send()
        return self

    def advance(self, until_ns: int) -> None:
        """Let time pass, and the gateway send what becomes due."""
        while (due_ns := self.gateway.next_due_ns()) is not None and due_ns <= until_ns:
            self.now_ns = max(self.now_ns, due_ns)
            self._send()
        self.now_ns = max(self.now_ns, until_ns)

    def finish(self) -> Clock:
        """End the run as the gateway's loop does."""
        self.gateway.finish()
        while not self.gateway.finished:
            due_ns = self.gateway.next_due_ns()
            assert due_ns is not None, "the gateway would wait for ever"
            self.advance(due_ns)
        return self

    def rest(self) -> Clock:
        """Let the gateway send all that waits."""
        while (due_ns := self.gateway.next_due_ns()) is not None:
            self.advance(due_ns)
        return self

    @property
    def frames(self) -> CanFrames:
        return concatenate([frames for _, frames in self.sent])

    @property
    def times_ns(self) -> Any:
        return np.repeat([time for time, _ in self.sent], [len(frames) for _, frames in self.sent])

    def _send(self) -> None:
        frames = self.gateway.due(self.now_ns)
        if frames is not None:
            self.sent.append((self.now_ns, frames))


def wire(frames: CanFrames) -> list[tuple[int, int, bytes, int]]:
    """Return what a receiver sees of each frame."""
    rows = zip(frames.can_id, frames.length, frames.data, frames.flags, strict=True)
    return [(int(i), int(n), data[:n].tobytes(), int(flags)) for i, n, data, flags in rows]

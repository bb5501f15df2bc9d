from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from dbc.codec import ars408
from drivers.can_frames import CanFrames, concatenate
from drivers.candump import read_candump, write_candump
from drivers.scan import RadarState
from node.injector import Injector
from node.scene import Injection
from tests.node.datasets import murk
from tests.node.gateway_stream import (
    CYCLE_NS,
    EPOCH_NS,
    RADAR,
    Clock,
    gateway,
    merged,
    other_frames,
    radar_frames,
    radar_scan,
)

CYCLES = 60
PER_STATE = 6


def drive(own_id: int = 0x201) -> CanFrames:
    """Return cycles of a radar and every sixth cycle's time its state, whatever that says."""
    cycles = concatenate([radar_frames(number) for number in range(CYCLES)])
    stamps = [EPOCH_NS + n * CYCLE_NS - 1_000_000 for n in range(PER_STATE, CYCLES, PER_STATE)]
    return merged(cycles, other_frames(stamps, [own_id] * len(stamps)))


def states(frames: CanFrames, can_id: int = 0x201) -> CanFrames:
    return frames.select(np.flatnonzero(frames.can_id == can_id))


def bits(frames: CanFrames) -> list[bool]:
    decoded = ars408().message(0x201).decode(states(frames).data)
    return [bool(one) for one in decoded["RadarState_Interference"]]


def with_all_bits(frames: CanFrames) -> bytes:
    data = states(frames).data.copy()
    data[:, 2] |= 0x10
    return data.tobytes()


def test_a_degraded_log_has_the_bit_where_a_burst_came_and_nowhere_else(tmp_path: Path) -> None:
    write_candump(tmp_path / "in.log", [drive()])
    result = murk(tmp_path / "in.log", tmp_path / "out", "--kind=interference", "--level=40")
    assert result.returncode == 0, result.stderr
    rows = map(json.loads, (tmp_path / "out" / "labels.jsonl").read_text().splitlines())
    hit = [row["sequence"] for row in rows if row["drawn"]["ghosts"]]
    assert 2 < len(hit) < CYCLES / 2
    before = bits(drive())
    told = [
        was or any(PER_STATE * k <= number < PER_STATE * (k + 1) for number in hit)
        for k, was in enumerate(before)
    ]
    degraded = concatenate(list(read_candump(tmp_path / "out" / "in.log")))
    assert bits(degraded) == told
    assert told != before
    assert with_all_bits(degraded) == with_all_bits(drive())


def test_the_gateway_tells_of_bursts_and_of_nothing_else() -> None:
    for levels, expected in (({"interference": 100.0}, True), ({"noise_jam": 100.0}, False)):
        core, _ = gateway(levels)
        sent = Clock(core).play(drive()).finish().frames
        assert (bits(sent) != bits(drive())) is expected
        assert with_all_bits(sent) == with_all_bits(drive())
    core, _ = gateway({"interference": 100.0})
    another = Clock(core).play(drive(0x211)).finish().frames
    assert states(another, 0x211).data.tobytes() == states(drive(0x211), 0x211).data.tobytes()


def test_a_state_is_marked_once_after_a_burst() -> None:
    content = {"sensor": "radar", "kind": "interference", "level": 100}
    injector = Injector(RADAR, [Injection.model_validate(content)], seed=1)
    quiet = RadarState(
        "radar", 0, 5, {"RadarState_Interference": 0.0, "RadarState_NVMReadStatus": 1.0}
    )
    assert injector.mark(quiet) is quiet
    hits = []
    for number in range(20):
        _, drawn = injector.inject(replace(radar_scan(number), sequence=number), 0.0)
        hits.append(drawn["interference"].ghosts > 0)
    assert 0 < sum(hits) < 20
    assert injector.mark(quiet).values == quiet.values | {"RadarState_Interference": 1.0}
    assert injector.mark(quiet) is quiet

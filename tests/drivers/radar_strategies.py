"""Radar scans and disturbed radar streams as hypothesis draws them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

from drivers.ars408 import Item, ScanAssembler
from drivers.ars408_layout import MODES
from drivers.can_frames import CanFrames, FrameFlag, concatenate
from drivers.encode import encode_motion, encode_scan, encode_state
from drivers.scan import RadarScan, RadarState

STATE_SIGNALS = ("RadarState_SendQualityCfg", "RadarState_SendExtInfoCfg")


def random_scan(
    rng: np.random.Generator, n: int, mode: str, lists: Sequence[bool], **more: Any
) -> RadarScan:
    """Return a scan of n random payloads; ``lists`` says which optional lists it has."""
    layout = next(layout for layout in MODES.values() if layout.name == mode)
    arrays: dict[str, Any] = {}
    for part, wanted in zip(layout.lists, (True, *lists), strict=False):
        if wanted:
            arrays |= part.decode(rng.integers(0, 256, (n, 8), dtype=np.uint8))
    arrays["id"] = rng.permutation(256)[:n].astype(np.uint8)
    near = n if mode == "object" else int(rng.integers(0, n + 1))
    header: dict[str, Any] = {
        "sensor": "radar_0",
        "sensor_id": 0,
        "sequence": 0,
        "stamp_ns": 0,
        "stamp_source": "file",
        "mode": mode,
        "meas_counter": 0,
        "near": near,
        "far": n - near,
    }
    return RadarScan(**(header | more), **arrays)


@st.composite
def _cycle(draw: st.DrawFn, sensor_id: int) -> CanFrames:
    """Draw one cycle, with motion input and radar states strewn in."""
    rng = np.random.default_rng(draw(st.integers(0, 1000)))
    mode = draw(st.sampled_from(["cluster", "cluster", "object"]))
    scan = random_scan(
        rng,
        draw(st.integers(0, 5)),
        mode,
        [draw(st.booleans()), draw(st.booleans())],
        sensor_id=sensor_id,
        meas_counter=draw(st.sampled_from([0, 2, 4, 6, 8, 40000, 65534])),
    )
    frames = encode_scan(scan)
    if draw(st.integers(0, 3)) == 0:
        frames = shuffled_last(frames, len(scan), rng)
    parts = [frames]
    if draw(st.integers(0, 3)) == 0:
        parts.insert(draw(st.integers(0, 1)), encode_motion(1.5, -0.25, sensor_id=sensor_id))
    if draw(st.integers(0, 3)) == 0:
        values = {signal: float(draw(st.booleans())) for signal in STATE_SIGNALS}
        parts.insert(draw(st.integers(0, 1)), encode_state(RadarState("", sensor_id, 0, values)))
    return replace(concatenate(parts), stamp_source="file")


def shuffled_last(frames: CanFrames, n: int, rng: np.random.Generator) -> CanFrames:
    """Return frames with the last n in another order."""
    rows = np.arange(len(frames))
    rng.shuffle(rows[len(rows) - n :])
    return frames.select(rows)


@st.composite
def disturbed(
    draw: st.DrawFn, frames: CanFrames, actions: Sequence[str], most: int = 8
) -> CanFrames:
    """Draw some faults and do them to frames."""
    rows = list(range(len(frames)))
    places = st.integers(0, 200)
    for action, place, target in draw(
        st.lists(st.tuples(st.sampled_from(actions), places, places), max_size=most)
    ):
        place, target = place % len(rows), target % len(rows)
        if action == "lose" and len(rows) > 1:
            rows.pop(place)
        elif action == "repeat":
            rows.insert(target, rows[place])
        elif action == "move":
            rows.insert(target, rows.pop(place))
        elif action == "shorten":
            frames.length[rows[place]] = target % 9
        elif action == "flag":
            frames.flags[rows[place]] = FrameFlag(1 << target % 7)
        elif action == "alter":
            frames.data[rows[place], target % 3] = target
        elif action == "rename":
            frames.data[rows[place], 0] = frames.data[rows[place] - 1, 0]
    frames = frames.select(np.array(rows))
    return replace(frames, stamp_ns=np.arange(len(rows), dtype=np.int64) * 250_000)


ACTIONS = ("lose", "repeat", "move", "shorten", "flag", "alter", "rename")


@st.composite
def changing_streams(draw: st.DrawFn) -> CanFrames:
    """Draw cycles of one to three radars that change their minds, disturbed."""
    sensor_ids = st.sampled_from(draw(st.sampled_from([[0], [0], [3], [0, 1, 7]])))
    cycles = draw(st.lists(sensor_ids.flatmap(_cycle), min_size=1, max_size=12))
    return draw(disturbed(concatenate(cycles), ACTIONS))


@st.composite
def steady_streams(draw: st.DrawFn) -> CanFrames:
    """Draw cycles of a radar that says what it sends, with some frames strewn in, disturbed."""
    rng = np.random.default_rng(draw(st.integers(0, 1000)))
    mode, other_mode = draw(st.permutations(["cluster", "object"]))
    lists = (draw(st.booleans()), draw(st.booleans()))
    sizes = draw(st.lists(st.integers(0, 4), min_size=2, max_size=8))
    scans = [random_scan(rng, n, mode, lists, meas_counter=2 * k) for k, n in enumerate(sizes)]
    foreign = encode_scan(random_scan(rng, 1, other_mode, (True, True)))
    values = {signal: float(draw(st.booleans())) for signal in STATE_SIGNALS}
    strewn = concatenate([encode_state(RadarState("", 0, 0, values)), foreign])
    steady = dict(zip(STATE_SIGNALS, map(float, lists), strict=True))
    told = encode_state(RadarState("", 0, 0, steady))
    frames = concatenate([told, *map(encode_scan, scans), strewn])
    rows = list(range(len(frames) - len(strewn)))
    for row in draw(st.sets(st.integers(len(rows), len(frames) - 1), max_size=2)):
        rows.insert(draw(st.integers(1, len(rows))), row)
    return draw(disturbed(frames.select(np.array(rows)), ACTIONS, 2))


def streams() -> st.SearchStrategy[CanFrames]:
    """Draw streams of either kind."""
    return changing_streams() | steady_streams()


def assembled(batches: Sequence[CanFrames]) -> list[Item]:
    """Feed batches to an assembler of every radar."""
    assembler = ScanAssembler()
    items = [item for batch in batches for item in assembler.feed(batch)]
    return items + assembler.flush()


def scans_of(batches: Sequence[CanFrames]) -> list[RadarScan]:
    return [item for item in assembled(batches) if isinstance(item, RadarScan)]


def comparable(item: Item) -> dict[str, Any]:
    """Return an item as plain values that ``==`` compares, types of arrays included."""
    values = {field.name: getattr(item, field.name) for field in fields(item)}
    return {
        name: (str(value.dtype), value.tobytes()) if isinstance(value, np.ndarray) else value
        for name, value in values.items()
    }

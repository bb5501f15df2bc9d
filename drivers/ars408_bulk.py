"""The assembler's fast path: every regular cycle of a batch is found and decoded at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ars408_layout import MODES, Kind, ModeLayout
from drivers.frame import StampSource

IndexArray = NDArray[np.intp]

_KINDS = 16
_IDS = 256


@dataclass(frozen=True, slots=True)
class RadarFrames:
    """Frames that one radar sent, in order.

    Attributes
    ----------
    row:
        (M,) place of each in the batch, ascending.
    kind:
        (M,) uint8, ``Kind``.
    payload:
        (M, 8) uint8.
    stamp_ns:
        (M,) int64.
    stamp_source:
        How the stamps were taken.
    """

    row: IndexArray
    kind: NDArray[np.uint8]
    payload: NDArray[np.uint8]
    stamp_ns: NDArray[np.int64]
    stamp_source: StampSource

    def __len__(self) -> int:
        return len(self.row)

    def select(self, rows: slice | NDArray[Any]) -> RadarFrames:
        """Return the frames of a slice, an index array or a mask."""
        return RadarFrames(
            self.row[rows],
            self.kind[rows],
            self.payload[rows],
            self.stamp_ns[rows],
            self.stamp_source,
        )


@dataclass(slots=True)
class Announcement:
    """A status frame, and where its cycle lies: frames ``start`` (itself) to ``end`` - 1."""

    mode: ModeLayout
    near: int
    far: int
    counter: int
    stamp_ns: int
    stamp_source: StampSource
    start: int
    end: int

    @property
    def size(self) -> int:
        """Clusters or objects announced."""
        return self.near + self.far


@dataclass(slots=True)
class Cycle:
    """A regular cycle.

    Attributes
    ----------
    last:
        Row of the frame that completes it.
    present:
        Which of the mode's optional lists it has.
    arrays:
        Fields of the scan.
    """

    last: int
    present: tuple[bool, ...]
    arrays: dict[str, NDArray[Any]]


def announcements(frames: RadarFrames) -> list[Announcement]:
    """Decode the status frames of a batch."""
    is_status = np.zeros(_KINDS, bool)
    is_status[list(MODES)] = True
    start = np.flatnonzero(is_status[frames.kind])
    if not len(start):
        return []
    kind = frames.kind[start]
    near, far, counter = (np.zeros(len(start), np.int64) for _ in range(3))
    for status, mode in MODES.items():
        of_mode = kind == status
        if of_mode.any():
            columns = mode.status_codec.decode(frames.payload[start[of_mode]])
            near[of_mode] = columns[mode.near]
            far[of_mode] = columns[mode.far] if mode.far else 0
            counter[of_mode] = columns[mode.counter]
    heads = zip(
        [MODES[status] for status in kind.tolist()],
        near.tolist(),
        far.tolist(),
        counter.tolist(),
        frames.stamp_ns[start].tolist(),
        [frames.stamp_source] * len(start),
        start.tolist(),
        [*start[1:].tolist(), len(frames)],
        strict=True,
    )
    return [Announcement(*head) for head in heads]


def regular_cycles(frames: RadarFrames, announced: list[Announcement]) -> list[Cycle | None]:
    """Find and decode the regular cycles of a batch.

    Between its status frame and the next one a regular cycle has exactly the announced number of
    general frames, each of another ID, and each optional list wholly, with the same IDs in any
    order, or not at all; and nothing else but radar states.

    Returns
    -------
    list
        For each announcement its cycle, None where that is not regular.
    """
    if not announced:
        return []
    frames = frames.select(slice(announced[0].start, None))
    status = np.array([head.mode.status for head in announced])
    size = np.array([head.size for head in announced])
    cycle = np.repeat(np.arange(len(size)), [head.end - head.start for head in announced])
    counts = np.bincount(_KINDS * cycle + frames.kind, minlength=_KINDS * len(size))
    counts = counts.reshape(len(size), _KINDS)
    strict = counts.sum(axis=1) - counts[:, Kind.RADAR_STATE] - 1
    cycles: list[Cycle | None] = [None] * len(size)
    for mode in MODES.values():
        regular = (status == mode.status) & (size > 0)
        regular &= counts[:, mode.general.kind] == size
        for layout in mode.optional:
            regular &= (counts[:, layout.kind] == size) | (counts[:, layout.kind] == 0)
        regular &= counts[:, [layout.kind for layout in mode.lists]].sum(axis=1) == strict
        if regular.any():
            for index, decoded in _decode(mode, frames, cycle, counts, regular):
                cycles[index] = decoded
    return cycles


def _decode(
    mode: ModeLayout,
    frames: RadarFrames,
    cycle: IndexArray,
    counts: IndexArray,
    regular: NDArray[np.bool_],
) -> Iterator[tuple[int, Cycle]]:
    """Decode each list of all regular cycles of one mode at once, and cut it into cycles."""
    wanted = regular[cycle]
    size = counts[regular, mode.general.kind]
    first_key = _IDS * np.arange(len(size))
    payload = frames.payload.compress(wanted & (frames.kind == mode.general.kind), axis=0)
    general = np.repeat(first_key, size) + payload[:, 0]
    broken = _repeated(general)
    columns = [(mode.general.decode(payload), _bounds(size))]
    for layout in mode.optional:
        present = counts[regular, layout.kind]
        payload = frames.payload.compress(wanted & (frames.kind == layout.kind), axis=0)
        optional = np.repeat(first_key, present) + payload[:, 0]
        order, strangers = _join(general[np.repeat(present > 0, size)], optional)
        broken = np.append(broken, strangers)
        columns.append((layout.decode(payload.take(order, axis=0)), _bounds(present)))
    refused = set((broken // _IDS).tolist())
    last = _last_rows(frames, cycle, regular)
    for number, index in enumerate(np.flatnonzero(regular).tolist()):
        if number in refused:
            continue
        arrays: dict[str, NDArray[Any]] = {}
        for fields, bounds in columns:
            begin, end = bounds[number], bounds[number + 1]
            if begin < end:
                arrays |= {name: column[begin:end] for name, column in fields.items()}
        present = tuple(bounds[number] < bounds[number + 1] for _, bounds in columns[1:])
        yield index, Cycle(last[number], present, arrays)


def _bounds(sizes: IndexArray) -> list[int]:
    """Return where each cycle begins in a decoded list, and where the last one ends."""
    return [0, *np.cumsum(sizes).tolist()]


def _last_rows(frames: RadarFrames, cycle: IndexArray, regular: NDArray[np.bool_]) -> list[int]:
    """Return the row of the last frame of each regular cycle that is no radar state."""
    listed = np.flatnonzero(frames.kind != Kind.RADAR_STATE)
    after = np.searchsorted(cycle[listed], np.flatnonzero(regular), side="right")
    rows: list[int] = frames.row[listed[after - 1]].tolist()
    return rows


def _repeated(key: IndexArray) -> IndexArray:
    """Return the keys that occur more than once."""
    if (key[1:] > key[:-1]).all():
        return key[:0]
    key = np.sort(key)
    repeated: IndexArray = key[1:][key[1:] == key[:-1]]
    return repeated


def _join(general: IndexArray, optional: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Return the order that brings an optional list to its general one, and keys without partner.

    Both have equally many keys of each cycle, so a cycle with strangers disturbs no other.
    """
    if np.array_equal(general, optional):
        return np.arange(len(general)), general[:0]
    by_general = np.argsort(general, kind="stable")
    order = np.empty_like(by_general)
    order[by_general] = np.argsort(optional, kind="stable")
    return order, general[optional[order] != general]

"""The assembler's fast path: every regular cycle of a batch is found and decoded at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ars408_layout import MODES, Kind, ListLayout, ModeLayout
from drivers.frame import StampSource

IndexArray = NDArray[np.intp]

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

    def take(self, places: IndexArray) -> RadarFrames:
        """Return the frames at these places."""
        return RadarFrames(
            self.row.take(places),
            self.kind.take(places),
            self.payload.take(places, axis=0),
            self.stamp_ns.take(places),
            self.stamp_source,
        )

    def since(self, place: int) -> RadarFrames:
        """Return the frames from a place on."""
        return RadarFrames(
            self.row[place:],
            self.kind[place:],
            self.payload[place:],
            self.stamp_ns[place:],
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
    is_status = np.logical_or.reduce([frames.kind == status for status in MODES])
    start = np.flatnonzero(is_status)
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
    if not any(0 < head.size < head.end - head.start for head in announced):
        return [None] * len(announced)
    last = _last_rows(frames, announced)
    frames = frames.since(announced[0].start)
    start = np.array([head.start for head in announced]) - announced[0].start
    length = np.diff(start, append=len(frames))
    states = np.add.reduceat(frames.kind == Kind.RADAR_STATE, start, dtype=np.intp)
    size = np.array([head.size for head in announced])
    status = frames.kind[start]
    cycles: list[Cycle | None] = [None] * len(size)
    for mode in MODES.values():
        regular = (status == mode.status) & (size > 0)
        if not regular.any():
            continue
        counts = [
            np.add.reduceat(frames.kind == layout.kind, start, dtype=np.intp)
            for layout in mode.lists
        ]
        regular &= counts[0] == size
        for count in counts[1:]:
            regular &= (count == size) | (count == 0)
        regular &= 1 + sum(counts) + states == length
        wanted = np.repeat(regular, length)
        for index, arrays, present in _decode(mode, frames, wanted, regular, counts):
            cycles[index] = Cycle(last[index], present, arrays)
    return cycles


def _last_rows(frames: RadarFrames, announced: list[Announcement]) -> list[int]:
    """Return the row of the last frame of each cycle that is no radar state."""
    last = np.array([head.end for head in announced]) - 1
    while (is_state := frames.kind[last] == Kind.RADAR_STATE).any():
        last -= is_state
    rows: list[int] = frames.row[last].tolist()
    return rows


def _decode(
    mode: ModeLayout,
    frames: RadarFrames,
    wanted: NDArray[np.bool_],
    regular: NDArray[np.bool_],
    counts: list[IndexArray],
) -> Iterator[tuple[int, dict[str, NDArray[Any]], tuple[bool, ...]]]:
    """Decode each list of all regular cycles of one mode at once, and cut it into cycles.

    Parameters
    ----------
    wanted:
        (M,) which frames belong to regular cycles.
    regular, counts:
        Which cycles are regular, and how many frames of each list every cycle has.

    Yields
    ------
    tuple
        Index of the cycle, fields of the scan, and which of the optional lists it has.
    """
    size, *optional_sizes = (count[regular] for count in counts)
    first_key = _IDS * np.arange(len(size))

    def payloads_and_keys(
        layout: ListLayout, sizes: IndexArray
    ) -> tuple[NDArray[np.uint8], IndexArray]:
        payload = frames.payload.compress(wanted & (frames.kind == layout.kind), axis=0)
        return payload, np.repeat(first_key, sizes) + payload[:, 0]

    payload, general = payloads_and_keys(mode.general, size)
    broken = _repeated(general)
    lists = [(mode.general.decode(payload), _slices(size))]
    for layout, present in zip(mode.optional, optional_sizes, strict=True):
        payload, optional = payloads_and_keys(layout, present)
        order, strangers = _join(general[np.repeat(present > 0, size)], optional)
        broken = np.append(broken, strangers)
        lists.append((layout.decode(payload.take(order, axis=0)), _slices(present)))
    refused = set((broken // _IDS).tolist())
    for number, index in enumerate(np.flatnonzero(regular).tolist()):
        if number in refused:
            continue
        arrays: dict[str, NDArray[Any]] = {}
        for columns, slices in lists:
            if rows := slices[number]:
                arrays |= {name: column[rows] for name, column in columns.items()}
        yield index, arrays, tuple(slices[number] is not None for _, slices in lists[1:])


def _slices(sizes: IndexArray) -> list[slice | None]:
    """Return where each cycle lies in a decoded list, None where it has none."""
    ends = np.cumsum(sizes).tolist()
    return [
        slice(end - size, end) if size else None
        for end, size in zip(ends, sizes.tolist(), strict=True)
    ]


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

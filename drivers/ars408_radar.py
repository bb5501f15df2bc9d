"""One radar's state between batches, and the assembler's general path: whatever may come."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.codec import ars408
from drivers.ars408_bulk import Announcement, Cycle, RadarFrames, announcements, regular_cycles
from drivers.ars408_layout import CAN_ID, MODES, PAYLOAD_BYTES, Kind, ListLayout
from drivers.ars408_learned import CycleCounter, Expectations
from drivers.scan import MotionInput, RadarScan, RadarState

Item = RadarScan | RadarState | MotionInput
Placed = tuple[int, Item]
"""What a frame completes, after the row of that frame."""

_PAYLOAD = np.dtype((np.void, PAYLOAD_BYTES))
# an int is found several times faster than a member of an enumeration
_RADAR_STATE, _SPEED, _YAW_RATE = int(Kind.RADAR_STATE), int(Kind.SPEED), int(Kind.YAW_RATE)
_STATUSES = [int(status) for status in MODES]
_REVERSE = 2  # of RadarDevice_SpeedDirection


@dataclass(slots=True)
class _OpenScan:
    """A scan that waits for frames: payload by ID, a list each."""

    head: Announcement
    payload: bytes
    lists: dict[int, dict[int, bytes]]
    duplicates: int = 0


@dataclass(slots=True)
class Radar:
    """The state of one radar.

    Attributes
    ----------
    strays:
        Stray frames since the last scan.
    """

    sensor_id: int
    name: str
    strays: int = 0
    _open: _OpenScan | None = None
    _cycles: CycleCounter = field(default_factory=CycleCounter)
    _expected: Expectations = field(default_factory=Expectations)
    _speed: float | None = None
    _yaw_rate: float | None = None
    _dropped: int = 0

    @property
    def missing(self) -> int:
        """How many frames the open scan lacks, as far as is known; 0 where none is open."""
        scan = self._open
        if scan is None:
            return 0
        mode, size = scan.head.mode, scan.head.size
        kinds = [layout.kind for layout in mode.optional if self._expected.of[layout.kind]]
        return sum(size - len(scan.lists[kind]) for kind in (mode.general.kind, *kinds))

    def feed(self, frames: RadarFrames, dropped: int) -> Iterator[Placed]:
        """Yield what the radar's frames of a batch complete; not quite in order of rows."""
        self._dropped = dropped
        counts = np.bincount(frames.kind, minlength=len(Kind)).tolist()
        if counts[_SPEED] or counts[_YAW_RATE]:
            motion = (frames.kind == _SPEED) | (frames.kind == _YAW_RATE)
            yield from self._motion(frames.take(np.flatnonzero(motion)))
            frames = frames.take(np.flatnonzero(~motion))
        states = self._states(frames) if counts[_RADAR_STATE] else {}
        if any(counts[status] for status in _STATUSES):
            announced = announcements(frames)
            yield from self._step(frames, 0, announced[0].start, states)
            yield from self._walk(frames, announced, states)
        else:
            yield from self._step(frames, 0, len(frames), states)

    def flush(self) -> Iterator[RadarScan]:
        """Yield the open scan as it is."""
        if self._open is not None:
            yield self._close(self._open)

    def _motion(self, frames: RadarFrames) -> Iterator[Placed]:
        speed = ars408().message(CAN_ID[Kind.SPEED]).decode(frames.payload)
        direction = np.where(speed["RadarDevice_SpeedDirection"] == _REVERSE, -1.0, 1.0)
        yaw_rate = ars408().message(CAN_ID[Kind.YAW_RATE]).decode(frames.payload)
        columns = zip(
            frames.row.tolist(),
            (frames.kind == _SPEED).tolist(),
            frames.stamp_ns.tolist(),
            (direction * speed["RadarDevice_Speed"]).tolist(),
            yaw_rate["RadarDevice_YawRate"].tolist(),
            strict=True,
        )
        for row, is_speed, stamp_ns, metres_per_second, degrees_per_second in columns:
            if is_speed:
                self._speed = metres_per_second
            else:
                self._yaw_rate = degrees_per_second
            yield row, MotionInput(self.sensor_id, stamp_ns, self._speed, self._yaw_rate)

    def _states(self, frames: RadarFrames) -> dict[int, RadarState]:
        """Decode the radar states of a batch, by place in ``frames``."""
        place = np.flatnonzero(frames.kind == _RADAR_STATE)
        columns = ars408().message(CAN_ID[Kind.RADAR_STATE]).decode(frames.payload[place])
        rows = zip(*(column.astype(float).tolist() for column in columns.values()), strict=True)
        stamps = frames.stamp_ns[place].tolist()
        values = (dict(zip(columns, row, strict=True)) for row in rows)
        return {
            index: RadarState(self.name, self.sensor_id, stamp_ns, value)
            for index, stamp_ns, value in zip(place.tolist(), stamps, values, strict=True)
        }

    def _walk(
        self, frames: RadarFrames, announced: list[Announcement], states: dict[int, RadarState]
    ) -> Iterator[Placed]:
        """Go from cycle to cycle: the regular ones as they were decoded, the rest step by step."""
        cycles = regular_cycles(frames, announced)
        places = list(states)
        for head, cycle in zip(announced, cycles, strict=True):
            told = places[bisect(places, head.start) : bisect(places, head.end)]
            if cycle is not None and self._foresees(head, cycle, [states[p] for p in told]):
                for place in told:
                    self._expected.tell(states[place])
                    yield int(frames.row[place]), states[place]
                for layout, present in zip(head.mode.optional, cycle.present, strict=True):
                    if present:
                        self._expected.see(layout.kind)
                yield cycle.last, self._scan(head, cycle.arrays)
            else:
                yield from self._begin(head, frames)
                yield from self._step(frames, head.start + 1, head.end, states)

    def _foresees(self, head: Announcement, cycle: Cycle, told: list[RadarState]) -> bool:
        """Whether, frame by frame, this cycle would be complete at its last frame exactly."""
        if self._open is not None:
            return False
        expected = tuple(self._expected.of[layout.kind] for layout in head.mode.optional)
        return cycle.present == expected and all(map(self._expected.knew, told))

    def _begin(self, head: Announcement, frames: RadarFrames) -> Iterator[Placed]:
        """Take a status frame."""
        row = int(frames.row[head.start])
        payload = frames.payload[head.start].tobytes()
        scan = self._open
        if scan is not None:
            if payload == scan.payload and not scan.duplicates and not any(scan.lists.values()):
                scan.duplicates += 1
                return
            yield row, self._close(scan)
        lists: dict[int, dict[int, bytes]] = {layout.kind: {} for layout in head.mode.lists}
        self._open = _OpenScan(head, payload, lists)
        if head.size == 0:
            yield row, self._close(self._open)

    def _step(
        self, frames: RadarFrames, begin: int, end: int, states: dict[int, RadarState]
    ) -> Iterator[Placed]:
        """Take the frames of a range that has no status frame, run by run of one kind."""
        if begin == end:
            return
        kinds = frames.kind[begin:end]
        cuts = [0, *(np.flatnonzero(kinds[1:] != kinds[:-1]) + 1).tolist(), end - begin]
        rows = frames.row[begin:end].tolist()
        payloads = frames.payload[begin:end].view(_PAYLOAD)[:, 0].tolist()
        for first, after in pairwise(cuts):
            kind = int(kinds[first])
            if kind == _RADAR_STATE:
                for place in range(first, after):
                    yield from self._state(rows[place], states[begin + place])
            else:
                completing = self._take(kind, payloads[first:after])
                if completing is not None:
                    assert self._open is not None
                    yield rows[first + completing], self._close(self._open)
                    self.strays += after - first - completing - 1

    def _state(self, row: int, state: RadarState) -> Iterator[Placed]:
        """Take a radar state; it may settle what the open scan waits for."""
        self._expected.tell(state)
        if self._open is not None and self._is_complete(self._open):
            yield row, self._close(self._open)
        yield row, state

    def _take(self, kind: int, payloads: list[bytes]) -> int | None:
        """Take a run of frames of one list; return which of them completes the open scan."""
        if kind in self._expected.of:
            self._expected.see(kind)
        scan = self._open
        if scan is None or kind not in scan.lists:
            self.strays += len(payloads)
            return None
        frames, size = scan.lists[kind], scan.head.size
        new = {payload[0]: payload for payload in payloads}
        if len(new) == len(payloads) <= size - len(frames) and frames.keys().isdisjoint(new):
            frames |= new
            return len(new) - 1 if len(frames) == size and self._is_complete(scan) else None
        for place, payload in enumerate(payloads):
            if payload[0] in frames:
                scan.duplicates += 1
            elif len(frames) == size:
                self.strays += 1
            else:
                frames[payload[0]] = payload
                if len(frames) == size and self._is_complete(scan):
                    return place
        return None

    def _is_complete(self, scan: _OpenScan) -> bool:
        size = scan.head.size
        return len(scan.lists[scan.head.mode.general.kind]) == size and all(
            len(scan.lists[layout.kind]) == size
            or (self._expected.of[layout.kind] is False and not scan.lists[layout.kind])
            for layout in scan.head.mode.optional
        )

    def _close(self, scan: _OpenScan) -> RadarScan:
        """Decode an open scan, complete or not."""
        self._open = None
        head = scan.head
        general = scan.lists[head.mode.general.kind]
        arrays = head.mode.general.decode(_payloads(general))
        unknown = lost = head.size - len(general)
        for layout in head.mode.optional:
            frames = scan.lists[layout.kind]
            if frames:
                fields, matched = _joined(layout, general, frames)
                arrays |= fields
                # a frame without partner is explained by a general frame that was lost
                explained = min(len(frames) - matched, unknown)
                self.strays += len(frames) - matched - explained
                lost += head.size - matched - explained
            else:
                lost += head.size if self._expected.of[layout.kind] else 0
                if head.size and not unknown:
                    self._expected.miss(layout.kind)
        return self._scan(head, arrays, lost, scan.duplicates)

    def _scan(
        self,
        head: Announcement,
        arrays: dict[str, NDArray[Any]],
        frames_lost: int = 0,
        duplicates: int = 0,
    ) -> RadarScan:
        cycles_lost = self._cycles.count(head.counter, head.stamp_ns)
        strays, self.strays = self.strays, 0
        return RadarScan(
            sensor=self.name,
            sensor_id=self.sensor_id,
            sequence=self._cycles.sequence,
            stamp_ns=head.stamp_ns,
            stamp_source=head.stamp_source,
            mode=head.mode.name,
            meas_counter=head.counter,
            near=head.near,
            far=head.far,
            frames_lost=frames_lost,
            cycles_lost=cycles_lost,
            duplicates=duplicates,
            strays=strays,
            dropped=self._dropped,
            injected=None,
            drawn=None,
            **arrays,
        )


def _payloads(frames: dict[int, bytes]) -> NDArray[np.uint8]:
    joined = np.frombuffer(b"".join(frames.values()), np.uint8)
    return joined.reshape(len(frames), PAYLOAD_BYTES)


def _joined(
    layout: ListLayout, general: dict[int, bytes], frames: dict[int, bytes]
) -> tuple[dict[str, NDArray[Any]], int]:
    """Bring the fields of an optional list to the order of the general one.

    Returns
    -------
    dict
        The fields, invalid where a frame is missing.
    int
        How many frames found their partner.
    """
    places = {identifier: place for place, identifier in enumerate(frames)}
    order = np.array([places.get(identifier, -1) for identifier in general], np.intp)
    fields = {name: column[order] for name, column in layout.decode(_payloads(frames)).items()}
    missing = order < 0
    for name, column in fields.items():
        column[missing] = layout.no_value(name)
    return fields, len(order) - int(missing.sum())

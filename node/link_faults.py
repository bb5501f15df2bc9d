"""Faults of the link between a radar and its receiver, each with a rate, repeatable by its seed.

=========  ===================  =============================================================
fault      rate: % of its       what it does
=========  ===================  =============================================================
drop       cluster list frames  the frame is lost
delay      cluster list frames  it comes up to 20 ms late, and those behind it wait for it
duplicate  cluster list frames  it comes twice
reorder    cluster list frames  it comes after up to four of its successors
corrupt    cluster list frames  one bit of its payload is flipped
freeze     scans                the last scan comes again, to the bit, instead of the new one
stuck      scans                the scan carries the MeasCounter of the one before it
silence    scans                from this scan to the next the wire is dead, for all frames
babble     scans                another node floods the bus with ID 0 for one cycle
=========  ===================  =============================================================

What is hit depends on nothing but seed, sensor and number of the scan; and what a rate hits is hit
by every higher rate too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.can_frames import CanFrames
from models.degrade.draw import DrawKey
from models.sensor import ARS408
from node.gateway_frames import TimedFrames

Hits = NDArray[np.bool_]

FULL_LOAD_SPACING_NS = 250_000
"""From frame to frame on a bus of 500 kbit/s that carries nothing but frames of 8 bytes."""

LONGEST_DELAY_NS = 20_000_000
MOST_OVERTAKEN = 4
BABBLE_ID = 0
"""Nothing else gets through while this ID, the one of the highest priority, is being sent."""

_BABBLE_FRAMES = round(ARS408.cycle_s * 1e9) // FULL_LOAD_SPACING_NS
_COUNTER = slice(2, 4)
"""Bytes of a status frame that are the MeasCounter."""


def _corrupt(scan: TimedFrames, hit: Hits, rng: np.random.Generator) -> TimedFrames:
    frames = scan.frames
    bit = (rng.random(len(scan)) * frames.length * 8).astype(np.intp)
    rows = np.flatnonzero(hit & (frames.length > 0))
    data = frames.data.copy()
    data[rows, bit[rows] // 8] ^= (1 << bit[rows] % 8).astype(np.uint8)
    return TimedFrames(replace(frames, data=data), scan.due_ns)


def _drop(scan: TimedFrames, hit: Hits, rng: np.random.Generator) -> TimedFrames:
    return scan[~hit]


def _duplicate(scan: TimedFrames, hit: Hits, rng: np.random.Generator) -> TimedFrames:
    return scan[np.repeat(np.arange(len(scan)), 1 + hit)]


def _reorder(scan: TimedFrames, hit: Hits, rng: np.random.Generator) -> TimedFrames:
    places = rng.integers(1, MOST_OVERTAKEN, len(scan), endpoint=True)
    order = np.argsort(np.arange(len(scan)) + hit * (places + 0.5), kind="stable")
    return TimedFrames(scan[order].frames, scan.due_ns)


def _delay(scan: TimedFrames, hit: Hits, rng: np.random.Generator) -> TimedFrames:
    late = (hit * rng.uniform(0, LONGEST_DELAY_NS, len(scan))).astype(np.int64)
    return replace(scan, due_ns=np.maximum.accumulate(scan.due_ns + late))


_FRAME_FAULTS: dict[str, Callable[[TimedFrames, Hits, np.random.Generator], TimedFrames]] = {
    "corrupt": _corrupt,
    "drop": _drop,
    "duplicate": _duplicate,
    "reorder": _reorder,
    "delay": _delay,
}

LINK_FAULTS = (*_FRAME_FAULTS, "freeze", "stuck", "silence", "babble")


class LinkFaults:
    """The faults of one radar's link, scan by scan.

    Parameters
    ----------
    sensor, seed:
        With the number of the scan, all that the draws depend on.

    Attributes
    ----------
    counts:
        Frames or scans hit so far, by fault.
    silent:
        Whether the wire is dead since the last scan.
    """

    def __init__(self, sensor: str, seed: int) -> None:
        self.counts: Counter[str] = Counter()
        self.silent = False
        self._sensor = sensor
        self._seed = seed
        self._last: TimedFrames | None = None

    def clear(self) -> None:
        """Let a scan go by that no fault touches: the wire works, and what was is forgotten."""
        self.silent = False
        self._last = None

    def apply(self, scan: TimedFrames, rates: Mapping[str, float], number: int) -> TimedFrames:
        """Return what the link makes of one scan.

        Parameters
        ----------
        scan:
            Its status frame, then its lists.
        rates:
            Rate in % by fault; one that is missing is 0.
        number:
            Of the scan, counted from the start.
        """
        if self._last is not None:
            scan = self._repeated(scan, self._last, rates, number)
        self._last = scan
        self.silent = self._hits_scan("silence", rates, number)
        if self.silent:
            return scan[:0]
        for fault, change in _FRAME_FAULTS.items():
            if rates.get(fault, 0) > 0:
                rng = self._generator(fault, number)
                hit = rng.random(len(scan)) < rates[fault] / 100
                self.counts[fault] += int(hit.sum())
                scan = change(scan, hit, rng)
        return scan

    def babble(self, scan: TimedFrames, rates: Mapping[str, float], number: int) -> TimedFrames:
        """Return what another node sends from the beginning of this scan on: mostly nothing."""
        if self.silent or not self._hits_scan("babble", rates, number):
            return scan[:0]
        count = _BABBLE_FRAMES
        frames = CanFrames(
            stamp_ns=np.full(count, scan.frames.stamp_ns[0]),
            can_id=np.full(count, BABBLE_ID, np.uint32),
            length=np.full(count, 8, np.uint8),
            data=self._generator("babble", number).integers(0, 256, (count, 8), np.uint8),
            flags=np.zeros(count, np.uint8),
            channel=np.zeros(count, np.uint8),
            channels=scan.frames.channels,
            stamp_source=scan.frames.stamp_source,
        )
        return TimedFrames(frames, scan.due_ns[0] + FULL_LOAD_SPACING_NS * np.arange(count))

    def _repeated(
        self, scan: TimedFrames, last: TimedFrames, rates: Mapping[str, float], number: int
    ) -> TimedFrames:
        """Return the last scan at this one's time, or this one with the last one's counter."""
        if self._hits_scan("freeze", rates, number):
            return TimedFrames(last.frames, last.due_ns - last.due_ns[0] + scan.due_ns[0])
        if self._hits_scan("stuck", rates, number):
            data = scan.frames.data.copy()
            data[0, _COUNTER] = last.frames.data[0, _COUNTER]
            return TimedFrames(replace(scan.frames, data=data), scan.due_ns)
        return scan

    def _hits_scan(self, fault: str, rates: Mapping[str, float], number: int) -> bool:
        rate = rates.get(fault, 0)
        hit = rate > 0 and bool(self._generator(fault, number).random() < rate / 100)
        if hit:
            self.counts[fault] += 1
        return hit

    def _generator(self, fault: str, number: int) -> np.random.Generator:
        return DrawKey(self._seed, self._sensor, number).generator(f"link {fault}")

"""What the assembler learns of a radar: the step of its counter, and which lists it sends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from drivers.ars408_layout import Kind
from drivers.scan import RadarState

PATIENCE = 3
"""Whole general lists in a row without an optional list, until that is no longer expected."""

_COUNTER_RANGE = 1 << 16
_SHORT_GAP = 1000  # cycles; a longer one must fit into the time that passed
_SHORTEST_CYCLE_NS = 50_000_000
_QUALITY = (Kind.CLUSTER_QUALITY, Kind.OBJECT_QUALITY)
_OPTIONAL = (*_QUALITY, Kind.OBJECT_EXTENDED)


@dataclass(slots=True)
class CycleCounter:
    """Turns MeasCounter into sequence numbers.

    Attributes
    ----------
    sequence:
        Of the last cycle, lost ones counted in; -1 before the first.
    """

    sequence: int = -1
    _counter: int = 0
    _stamp_ns: int = 0
    _change: int = 0
    _step: int | None = None

    def count(self, counter: int, stamp_ns: int) -> int:
        """Take the status frame of the next cycle; return how many cycles were lost before it."""
        lost = 0
        if self.sequence >= 0:
            change = (counter - self._counter) % _COUNTER_RANGE
            if change and change == self._change and change < (self._step or _COUNTER_RANGE):
                self._step = change
            self._change = change
            lost = max(0, change // self._step - 1) if self._step else 0
            if lost > _SHORT_GAP and lost * _SHORTEST_CYCLE_NS > stamp_ns - self._stamp_ns:
                lost = 0
        self._counter, self._stamp_ns = counter, stamp_ns
        self.sequence += 1 + lost
        return lost


@dataclass(slots=True)
class Expectations:
    """Which optional lists a cycle will have, by kind: True, False, or None where unknown."""

    of: dict[int, bool | None] = field(default_factory=lambda: dict.fromkeys(_OPTIONAL))
    _misses: dict[int, int] = field(default_factory=lambda: dict.fromkeys(_OPTIONAL, 0))

    def see(self, kind: int) -> None:
        """Take note that a frame of an optional list came."""
        self.of[kind] = True
        self._misses[kind] = 0

    def miss(self, kind: int) -> None:
        """Take note that a general list came whole, and an optional one not at all."""
        self._misses[kind] += 1
        if self.of[kind] is None or self._misses[kind] >= PATIENCE:
            self.of[kind] = False

    def tell(self, state: RadarState) -> None:
        """Believe what the radar says."""
        for kind, sent in _lists(state):
            self.of[kind] = sent
            self._misses[kind] = 0

    def knew(self, state: RadarState) -> bool:
        """Whether the radar says what was expected anyway."""
        return all(self.of[kind] == sent for kind, sent in _lists(state))


def _lists(state: RadarState) -> Iterator[tuple[int, bool]]:
    for kind in _QUALITY:
        yield kind, bool(state.values["RadarState_SendQualityCfg"])
    yield Kind.OBJECT_EXTENDED, bool(state.values["RadarState_SendExtInfoCfg"])

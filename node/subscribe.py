"""Noise levels as they come, from the bus in this process or a carrier: for whoever decides."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from dbc.errors import SceneError
from models.estimate.level import NoiseLevel
from node.bus.in_process import KEEP_LAST, Bus
from node.mailbox import Closed, Mailbox

TICK_S = 0.05
"""After so long without a level an iterator yields None, so that silence is noticed."""


def subscribe(source: Bus | str, sensors: Sequence[str]) -> Iterator[NoiseLevel | None]:
    """Return the levels of some sensors as they come, and None where none came for ``TICK_S``.

    A recording is read as fast as it is asked, without waiting: its time is that of the stamps.

    Parameters
    ----------
    source:
        A bus of this process; or a carrier by name: ``ros2:DOMAIN/NAMESPACE`` (each may be left
        out), ``can:BUS`` (``can:socketcan:can0``), or an MCAP recording's path.
    sensors:
        Names of the sensors; on CAN, which carries no names, in the order of the node's scene.

    Raises
    ------
    InputError
        If the carrier is none of these, or cannot be opened.
    """
    if isinstance(source, Bus):
        return iter(BusLevels(source, sensors))
    name, _, rest = source.partition(":")
    if name == "can" and rest:
        from node.bus.can_subscribe import can_levels

        return can_levels(rest, sensors)
    if name == "ros2":
        from node.bus.ros2_subscribe import ros2_levels

        return ros2_levels(rest, sensors)
    if Path(source).suffix == ".mcap":
        return _recorded_levels(Path(source), sensors)
    raise SceneError(source, "is no carrier of noise levels", "expected ros2:, can:BUS, FILE.mcap")


def _recorded_levels(path: Path, sensors: Sequence[str]) -> Iterator[NoiseLevel]:
    from node.bus.mcap_reader import open_mcap
    from node.bus.messages import from_ros, typestore

    entries = open_mcap(path).entries({f"/murk/{sensor}/noise_level" for sensor in sensors})
    return (from_ros(entry.type_name, entry.cdr, typestore()) for entry in entries)


class BusLevels:
    """Levels of some sensors from the bus of this process, in the order of publication.

    Parameters
    ----------
    depth:
        Levels that wait at most; the oldest is dropped, and counted.
    """

    def __init__(self, bus: Bus, sensors: Sequence[str], depth: int | None = None) -> None:
        depth = KEEP_LAST * len(sensors) if depth is None else depth
        self._mailbox: Mailbox[NoiseLevel] = Mailbox(depth, lossless=False)
        self._bus = bus
        self._topics = [f"/murk/{sensor}/noise_level" for sensor in sensors]
        for topic in self._topics:
            bus.attach(topic, self)

    @property
    def dropped(self) -> int:
        """Levels that came faster than they were taken."""
        return self._mailbox.dropped

    def deliver(self, message: NoiseLevel) -> None:
        """Take a level; called by the bus."""
        self._mailbox.put(message)

    def close(self) -> None:
        """Listen no more; what waits is still yielded."""
        for topic in self._topics:
            self._bus.detach(topic, self)
        self._mailbox.close()

    def __iter__(self) -> Iterator[NoiseLevel | None]:
        while True:
            try:
                yield self._mailbox.get(TICK_S)
            except TimeoutError:
                yield None
            except Closed:
                return

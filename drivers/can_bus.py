"""CAN buses: SocketCAN by our own socket, every other interface by python-can."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection
from types import TracebackType
from typing import Self

from dbc.errors import DeviceError, MurkError
from drivers.can_frames import CanFrames, FrameFlag

SEND_PATIENCE_S = 1.0
"""How long ``send`` tries again while the send buffer stays full."""


class BusDown(MurkError):  # noqa: N818  (a state that passes, not a mistake)
    """The bus went down while it was open.

    Attributes
    ----------
    gone:
        True where the interface itself has disappeared: close the bus and open it again once it is
        back. False where it is only down: read on, frames come again once it is up.
    """

    def __init__(self, bus: str, reason: str, gone: bool = False) -> None:
        super().__init__(f"{bus}: {reason}")
        self.gone = gone


class CanBus(ABC):
    """One CAN bus, open for reading and sending. Also a context manager that closes it.

    Attributes
    ----------
    name:
        As it was given to ``open_bus``.
    listen_only:
        Whether ``send`` is refused.
    dropped:
        Frames that the kernel dropped since the bus was opened because nobody read them; 0 where
        the interface does not tell.
    malformed:
        Messages that came in and were no CAN frames.
    retries:
        Times that a frame had to wait for the send buffer.
    """

    def __init__(self, name: str, listen_only: bool) -> None:
        self.name = name
        self.listen_only = listen_only
        self.dropped = 0
        self.malformed = 0
        self.retries = 0

    @abstractmethod
    def read(self, timeout_s: float) -> CanFrames:
        """Wait for a frame and return all that are there, error frames flagged among them.

        Parameters
        ----------
        timeout_s:
            How long to wait; then the answer is empty, as it is when only frames came that nobody
            wants.

        Raises
        ------
        BusDown
            If the network is down or the interface has gone.
        """

    def send(self, frames: CanFrames) -> None:
        """Send frames in order and return when the interface has taken the last.

        While the send buffer is full it tries again, and counts that in ``retries``.

        Raises
        ------
        DeviceError
            If the bus is listen-only, or cannot carry a frame.
        BusDown
            If the network is down, or the send buffer stays full for ``SEND_PATIENCE_S``.
        ValueError
            If an error frame is among them: those are made by controllers, not sent.
        """
        if self.listen_only:
            raise DeviceError(self.name, "is open for listening only", "open it for sending")
        if (frames.flags & FrameFlag.ERROR).any():
            raise ValueError("error frames cannot be sent")
        self._send(frames)

    @abstractmethod
    def _send(self, frames: CanFrames) -> None: ...

    @abstractmethod
    def close(self) -> None:
        """Close the bus; a second time does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def open_bus(spec: str, ids: Collection[int] | None = None, listen_only: bool = False) -> CanBus:
    """Open a CAN bus.

    Parameters
    ----------
    spec:
        ``INTERFACE:CHANNEL`` with an interface of python-can (``socketcan:can0``,
        ``udp_multicast:239.74.163.2``, ``virtual:test``), or the bare name of a SocketCAN
        interface.
    ids:
        Identifiers to receive, above 0x7FF extended ones; all by default. Error frames always come.
    listen_only:
        Never send. (That the controller does not acknowledge either is a setting of the interface:
        ``ip link set can0 type can listen-only on``.)

    Raises
    ------
    DeviceError
        If there is no such interface, it is down, or it may not be opened.
    """
    interface, colon, channel = spec.partition(":")
    if not colon:
        interface, channel = "socketcan", spec
    if not channel:
        raise DeviceError(spec, "names no channel", "give INTERFACE:CHANNEL, or can0")
    if interface == "socketcan":
        from drivers.socketcan import SocketCanBus

        return SocketCanBus(spec, channel, ids, listen_only)
    from drivers.python_can_bus import PythonCanBus

    return PythonCanBus(spec, interface, channel, ids, listen_only)

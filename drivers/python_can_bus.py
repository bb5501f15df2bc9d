"""CAN interfaces other than SocketCAN, by python-can."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Collection

import can
import numpy as np

from dbc.errors import DeviceError
from drivers.can_bus import SEND_PATIENCE_S, BusDown, CanBus
from drivers.can_frames import CanFrames, FrameFlag
from drivers.can_messages import from_messages, to_messages
from drivers.frame import StampSource

_BITRATE = 500_000
"""Of the ARS 408, bit/s; for interfaces that are configured by opening them."""
_MOST_FRAMES = 8192
_MOST_MALFORMED = 100
_RETRY_S = 0.0005
# linux/in.h and linux/in6.h; Python's socket module lacks them
_IP_MULTICAST_ALL, _IPV6_MULTICAST_ALL = 49, 29
_STAMP_SOURCES: dict[str, StampSource] = {"virtual": "read", "udp_multicast": "kernel"}


class PythonCanBus(CanBus):
    """An interface of python-can; see ``CanBus`` and ``open_bus``."""

    def __init__(
        self,
        name: str,
        interface: str,
        channel: str,
        ids: Collection[int] | None,
        listen_only: bool,
    ) -> None:
        super().__init__(name, listen_only)
        if interface not in can.VALID_INTERFACES:
            known = ", ".join(sorted(can.VALID_INTERFACES))
            raise DeviceError(name, f"unknown CAN interface {interface!r}", f"known are {known}")
        self._channel = channel
        self._stamp_source: StampSource = _STAMP_SOURCES.get(interface, "device")
        self._ids = None if ids is None else np.array(sorted(ids), np.uint32)
        try:
            self._bus = can.Bus(channel, interface, bitrate=_BITRATE)
        except Exception as error:  # each interface raises what its own library raises
            remedy = f"see python-can's documentation of {interface}"
            raise DeviceError(name, f"cannot be opened ({error})", remedy) from error
        if interface == "udp_multicast":
            _hear_one_group_only(self._bus)

    def read(self, timeout_s: float) -> CanFrames:
        """Return all frames that are there; see ``CanBus``."""
        messages: list[can.Message] = []
        malformed = 0
        while len(messages) < _MOST_FRAMES:
            try:
                message = self._bus.recv(0 if messages or malformed else timeout_s)
            except (can.CanError, OSError) as error:
                malformed += 1
                self.malformed += 1
                if malformed > _MOST_MALFORMED:
                    raise BusDown(self.name, f"cannot be read ({error})") from error
                continue
            if message is None:
                break
            messages.append(message)
        frames = from_messages(messages, (self._channel,), stamp_source=self._stamp_source)
        if self._ids is None:
            return frames
        is_error = (frames.flags & FrameFlag.ERROR) != 0
        return frames.select(np.isin(frames.can_id, self._ids) | is_error)

    def _send(self, frames: CanFrames) -> None:
        for message in to_messages(frames):
            self._send_one(message)

    def _send_one(self, message: can.Message) -> None:
        deadline_s = time.monotonic() + SEND_PATIENCE_S
        while True:
            try:
                self._bus.send(message)
                return
            except (can.CanError, OSError) as error:
                if time.monotonic() > deadline_s:
                    raise BusDown(self.name, f"cannot send ({error})") from error
                self.retries += 1
                time.sleep(_RETRY_S)

    def close(self) -> None:
        """Shut the interface down."""
        self._bus.shutdown()


def _hear_one_group_only(bus: can.BusABC) -> None:
    """Receive what is sent to this bus's group; by default, what any program here has joined."""
    with socket.socket(fileno=os.dup(bus.fileno())) as sock:
        if sock.family == socket.AF_INET6:
            sock.setsockopt(socket.IPPROTO_IPV6, _IPV6_MULTICAST_ALL, 0)
        else:
            sock.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)

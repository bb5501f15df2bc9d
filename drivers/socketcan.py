"""SocketCAN by a raw socket of our own, read in bulk with kernel stamps and drop counter."""

from __future__ import annotations

import errno
import select
import socket
import struct
import time
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

import numpy as np

from dbc.errors import DeviceError
from drivers.bulk_receive import BulkReceiver, Received, parse_ancillary
from drivers.can_bus import SEND_PATIENCE_S, BusDown, CanBus
from drivers.can_frames import CanFrames, concatenate
from drivers.hardware_clock import HardwareClock
from drivers.socketcan_frames import EXTENDED_BIT, FRAME, ID_MASK, pack_frames, unpack_frames

# Linux: asm-generic/socket.h and linux/can/raw.h
_SO_RCVBUFFORCE = 33
_CAN_RAW_ERR_FILTER = 2
_RECEIVE_BUFFER_BYTES = 8 << 20
"""Some 20,000 frames where it may be forced: five seconds of a full bus."""
_MOST_BATCHES = 16
_MOST_FILTERS = 512
_RETRY_S = 0.0005


class SocketCanBus(CanBus):
    """A SocketCAN interface; see ``CanBus`` and ``open_bus``."""

    def __init__(
        self, name: str, interface: str, ids: Collection[int] | None, listen_only: bool
    ) -> None:
        super().__init__(name, listen_only)
        self._interface = interface
        self._clock = HardwareClock()
        self._failure: OSError | None = None
        try:
            self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        except (OSError, AttributeError) as error:
            raise _refusal(interface, error) from error
        try:
            _set_up(self._socket, interface, ids)
            self._receiver = BulkReceiver(self._socket, FRAME.itemsize)
        except OSError as error:
            self._socket.close()
            raise _refusal(interface, error) from error
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def read(self, timeout_s: float) -> CanFrames:
        """Return all frames that are there; see ``CanBus``."""
        batches: list[CanFrames] = []
        if self._failure is None:
            self._poll.poll(timeout_s * 1000)
        try:
            while len(batches) < _MOST_BATCHES:
                received = self._receive()
                batches.append(self._frames(received))
                if len(received.length) < self._receiver.batch:
                    break
        except OSError as error:
            if batches or not _passes(error):
                self._failure = error
            if not batches:
                raise self._down(error) from error
        return concatenate(batches)

    def _receive(self) -> Received:
        if self._failure is None:
            return self._receiver.receive()
        failure = self._failure
        if _passes(failure):
            self._failure = None
        raise failure

    def _frames(self, received: Received) -> CanFrames:
        ancillary = parse_ancillary(received.control, received.control_length)
        self.dropped = max(self.dropped, ancillary.dropped)
        software_ns = ancillary.software_ns
        if not software_ns.all():  # the first frames after opening may come before the stamps
            software_ns = np.where(software_ns, software_ns, time.time_ns())
        by_hardware = len(software_ns) > 0 and bool(ancillary.hardware_ns.all())
        if by_hardware:
            stamp_ns = self._clock.to_system(ancillary.hardware_ns, software_ns)
        else:
            stamp_ns = software_ns
        return unpack_frames(
            received.data,
            received.length,
            received.flags,
            stamp_ns,
            channel=self._interface,
            stamp_source="hardware" if by_hardware else "kernel",
            dropped=self.dropped,
        )

    def _send(self, frames: CanFrames) -> None:
        for datagram in pack_frames(frames):
            self._send_one(datagram)

    def _send_one(self, datagram: bytes) -> None:
        deadline_s = time.monotonic() + SEND_PATIENCE_S
        while True:
            try:
                self._socket.send(datagram)
                return
            except OSError as error:
                if error.errno not in (errno.ENOBUFS, errno.EAGAIN):
                    raise self._down(error) from error
                if time.monotonic() > deadline_s:
                    raise self._down(error) from error
                self.retries += 1
                time.sleep(_RETRY_S)

    def _down(self, error: OSError) -> BusDown | DeviceError:
        if _passes(error):
            return BusDown(self.name, "the network is down")
        if error.errno in (errno.ENOBUFS, errno.EAGAIN):
            return BusDown(self.name, "the send buffer stays full: does another node acknowledge?")
        if error.errno in (errno.EINVAL, errno.EMSGSIZE):
            remedy = f"ip link set {self._interface} mtu 72, if its controller can"
            return DeviceError(self.name, "cannot carry CAN FD frames", remedy)
        return BusDown(self.name, f"the interface has gone ({error.strerror})", gone=True)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _passes(error: OSError) -> bool:
    """Tell a network that is down from an interface that has gone."""
    return error.errno == errno.ENETDOWN


def _set_up(sock: socket.socket, interface: str, ids: Collection[int] | None) -> None:
    """Filter, enlarge and bind a raw CAN socket.

    Raises
    ------
    OSError
        With the kernel's reason.
    """
    sock.setblocking(False)
    try:
        sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _RECEIVE_BUFFER_BYTES)
    except PermissionError:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
    sock.setsockopt(socket.SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, ID_MASK)
    with suppress(OSError):  # a kernel without CAN FD gives classic frames
        sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
    if ids is not None:
        sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, id_filters(ids))
    sock.bind((interface,))
    code = sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
    if code:  # binding succeeds on an interface that is down, and leaves the error behind
        raise OSError(code, "the interface is down")


def id_filters(ids: Collection[int]) -> bytes:
    """Return ``struct can_filter`` of each identifier, above 0x7FF an extended one.

    Raises
    ------
    ValueError
        If there are more than the kernel takes.
    """
    if len(ids) > _MOST_FILTERS:
        raise ValueError(f"{len(ids)} identifiers, but a socket filters at most {_MOST_FILTERS}")
    mask = EXTENDED_BIT | ID_MASK
    return b"".join(
        struct.pack("=II", can_id | (EXTENDED_BIT if can_id > 0x7FF else 0), mask) for can_id in ids
    )


def can_interfaces() -> list[str]:
    """Return the names of the SocketCAN interfaces, up or down."""
    folders = sorted(Path("/sys/class/net").glob("*"))
    hardware_type = "280"  # ARPHRD_CAN
    return [folder.name for folder in folders if _read(folder / "type") == hardware_type]


def _read(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def _refusal(interface: str, error: OSError | AttributeError) -> DeviceError:
    code = error.errno if isinstance(error, OSError) else errno.EAFNOSUPPORT
    if code in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
        what = "this system's kernel has no CAN"
        remedy = "modprobe can_raw, or use a bus such as udp_multicast:239.74.163.2"
    elif code == errno.ENETDOWN:
        what = "the interface is down"
        speed = "" if interface.startswith("vcan") else " type can bitrate 500000"
        remedy = f"ip link set {interface} up{speed}"
    elif code in (errno.EPERM, errno.EACCES):
        what = "may not be opened by this user"
        remedy = "allow it raw CAN sockets"
    elif code in (errno.ENODEV, None):
        what = "there is no such CAN interface"
        there_are = ", ".join(can_interfaces())
        remedy = (
            f"there are {there_are}"
            if there_are
            else "ip link add dev vcan0 type vcan && ip link set up vcan0 makes a virtual one"
        )
    else:
        what = f"cannot be opened ({error})"
        remedy = "see ip -details link show"
    return DeviceError(interface, what, remedy)

"""Datagrams from a socket in bulk: one system call for hundreds, and their stamps with them.

``recvmmsg`` fills arrays that stay where they are. Beside each datagram the kernel leaves, if the
socket was asked for it, when it was received and how many were dropped before it.
"""

from __future__ import annotations

import ctypes
import errno
import os
import socket
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Linux: asm-generic/socket.h and linux/net_tstamp.h; Python's socket module lacks them
SO_TIMESTAMPING = 37
SO_RXQ_OVFL = 40
_STAMPS_WANTED = (1 << 2) | (1 << 3) | (1 << 4) | (1 << 6)
"""SOF_TIMESTAMPING_: RX_HARDWARE, RX_SOFTWARE, SOFTWARE and RAW_HARDWARE."""

CONTROL = np.dtype(
    [
        ("stamp_bytes", np.uint64),
        ("stamp_level", np.int32),
        ("stamp_type", np.int32),
        ("software_s", np.int64),
        ("software_ns", np.int64),
        ("unused", np.int64, 2),
        ("hardware_s", np.int64),
        ("hardware_ns", np.int64),
        ("drop_bytes", np.uint64),
        ("drop_level", np.int32),
        ("drop_type", np.int32),
        ("dropped", np.uint32),
        ("padding", np.uint32),
    ]
)
"""What the kernel writes beside a datagram (``sock_recv_cmsgs``): its stamps, and from the first
drop on the drop counter."""
_STAMP_END = CONTROL.fields["drop_bytes"][1] if CONTROL.fields else 0

_HEADER = np.dtype(
    [
        ("name", np.uintp),
        ("name_bytes", np.uint32),
        ("vectors", np.uintp),
        ("vector_count", np.uintp),
        ("control", np.uintp),
        ("control_bytes", np.uintp),
        ("flags", np.intc),
    ],
    align=True,
)
_MESSAGE = np.dtype([("header", _HEADER), ("bytes", np.uintc)], align=True)
"""``struct mmsghdr``."""


@dataclass(frozen=True, slots=True, eq=False)
class Received:
    """n datagrams; the arrays are views that the next ``receive`` overwrites.

    Attributes
    ----------
    data:
        (n, datagram_bytes) uint8; what lies beyond ``length`` is of earlier datagrams.
    length:
        (n,) uint32, bytes of each.
    flags:
        (n,) int32, ``MSG_`` bits of each.
    control, control_length:
        (n,) of ``CONTROL``, and (n,) the bytes that were filled of each.
    """

    data: NDArray[np.uint8]
    length: NDArray[np.uint32]
    flags: NDArray[np.int32]
    control: NDArray[np.void]
    control_length: NDArray[np.uintp]


@dataclass(frozen=True, slots=True, eq=False)
class Ancillary:
    """What the kernel says beside n datagrams.

    Attributes
    ----------
    software_ns, hardware_ns:
        (n,) int64, when each was received, by the system's clock and by the device's own; 0 where
        nobody took the stamp.
    dropped:
        Datagrams dropped since the socket was opened; 0 where none of the n tells.
    """

    software_ns: NDArray[np.int64]
    hardware_ns: NDArray[np.int64]
    dropped: int


def parse_ancillary(control: NDArray[np.void], length: NDArray[np.uintp]) -> Ancillary:
    """Read what lies beside n datagrams.

    Parameters
    ----------
    control, length:
        As in ``Received``.
    """
    stamped = (length >= _STAMP_END) & (control["stamp_type"] == SO_TIMESTAMPING)
    software_ns = control["software_s"] * 10**9 + control["software_ns"]
    hardware_ns = control["hardware_s"] * 10**9 + control["hardware_ns"]
    if not stamped.all():
        software_ns[~stamped] = hardware_ns[~stamped] = 0
    dropped = 0
    if (length > _STAMP_END).any():
        counted = (length > _STAMP_END) & (control["drop_type"] == SO_RXQ_OVFL)
        dropped = int(control["dropped"].max(initial=0, where=counted))
    return Ancillary(software_ns, hardware_ns, dropped)


class BulkReceiver:
    """Receives datagrams of a socket in bulk, without blocking.

    Parameters
    ----------
    sock:
        The socket; stamps and drop counter are switched on. It stays the caller's.
    datagram_bytes:
        The longest datagram.
    batch:
        Datagrams received at most at once.

    Raises
    ------
    OSError
        If the system has no ``recvmmsg`` or the socket refuses stamps.
    """

    def __init__(self, sock: socket.socket, datagram_bytes: int, batch: int = 512) -> None:
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPING, _STAMPS_WANTED)
        sock.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
        self._socket = sock
        self._recvmmsg = _recvmmsg()
        self._data = np.zeros((batch, datagram_bytes), np.uint8)
        self._control = np.zeros(batch, CONTROL)
        self._vectors = np.zeros((batch, 2), np.uintp)
        self._vectors[:, 0] = _addresses(self._data)
        self._vectors[:, 1] = datagram_bytes
        self._messages = np.zeros(batch, _MESSAGE)
        header = self._messages["header"]
        header["vectors"], header["vector_count"] = _addresses(self._vectors), 1
        header["control"], header["control_bytes"] = _addresses(self._control), CONTROL.itemsize
        self._address = self._messages.ctypes.data
        self._used = 0

    @property
    def batch(self) -> int:
        """Datagrams received at most at once."""
        return len(self._data)

    def receive(self) -> Received:
        """Return what waits, up to a batch; nothing is an empty batch.

        Raises
        ------
        OSError
            What the kernel reports on the socket, such as ENETDOWN.
        """
        header = self._messages["header"]
        header["control_bytes"][: self._used] = CONTROL.itemsize
        count = self._recvmmsg(
            self._socket.fileno(), self._address, self.batch, socket.MSG_DONTWAIT, None
        )
        if count < 0:
            code = ctypes.get_errno()
            if code not in (errno.EAGAIN, errno.EINTR):
                raise OSError(code, os.strerror(code))
            count = 0
        self._used = count
        return Received(
            data=self._data[:count],
            length=self._messages["bytes"][:count],
            flags=header["flags"][:count],
            control=self._control[:count],
            control_length=header["control_bytes"][:count],
        )


def _recvmmsg() -> ctypes._NamedFuncPointer:
    try:
        function = ctypes.CDLL(None, use_errno=True).recvmmsg
    except AttributeError as error:
        raise OSError(errno.ENOSYS, "the system has no recvmmsg") from error
    pointer, unsigned = ctypes.c_void_p, ctypes.c_uint
    function.argtypes = [ctypes.c_int, pointer, unsigned, ctypes.c_int, pointer]
    return function


def _addresses(array: NDArray[np.generic]) -> NDArray[np.uintp]:
    """Return where each element of the first axis begins in memory."""
    rows = np.arange(len(array), dtype=np.uintp)
    return array.ctypes.data + rows * np.uintp(array.strides[0])

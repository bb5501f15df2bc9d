"""How the process keeps memory: work arrays of the last message serve the next one."""

from __future__ import annotations

import ctypes
import sys

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # glibc, malloc.h
_LARGEST_KEPT_BLOCK = 32 << 20  # the most that glibc allows
_KEPT_IN_ALL = 256 << 20


def keep_freed_memory() -> None:
    """Have glibc keep freed blocks instead of giving them back to the kernel.

    By default a block of some 128 KiB or more is mapped anew by every allocation, and the kernel
    clears its pages one by one as they are touched. Arrays that live for one message pay that
    again and again: a chain of three operations on a 1600×900 frame takes twice as long. Where
    there is no glibc, nothing happens.
    """
    if not sys.platform.startswith("linux"):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, _LARGEST_KEPT_BLOCK)
        mallopt(_M_TRIM_THRESHOLD, _KEPT_IN_ALL)

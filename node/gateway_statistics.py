"""What a gateway counts while it runs."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np

LATENCIES_KEPT = 65536


class Latencies:
    """Added latencies of the last frames."""

    def __init__(self) -> None:
        self._kept_ns: deque[int] = deque(maxlen=LATENCIES_KEPT)

    def add(self, latencies_ns: Iterable[int]) -> None:
        """Take in the latencies of frames that were sent, nanoseconds."""
        self._kept_ns.extend(latencies_ns)

    def summary(self) -> dict[str, Any]:
        """Return median and 99th percentile, for JSON; nothing where nothing was sent."""
        if not self._kept_ns:
            return {}
        p50, p99 = np.percentile(self._kept_ns, [50, 99])
        return {"latency_p50_ns": int(p50), "latency_p99_ns": int(p99)}

"""What the pipeline counts of each sensor, and the summary of a run."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drivers.frame import Frame
from drivers.scan import RadarScan
from models.estimate.level import NoiseLevel
from node.pace import CLOCK_STEP_NS

LATENCIES_KEPT = 65536


@dataclass(slots=True)
class SensorStatistics:
    """Counts of one sensor since the start of the run.

    Attributes
    ----------
    received:
        Frames or scans that the source yielded.
    estimated:
        Noise levels published.
    dropped_by_source:
        Messages that the source lost (kernel drops, frames that did not decode).
    dropped_by_queue:
        Messages that made room for newer ones.
    frames_lost, cycles_lost:
        CAN frames missing from scans, and whole radar cycles missing between scans.
    clock_set_back:
        How often the stamps of the source went back by more than a second.
    late:
        Messages with a stamp a little before the newest: they change no filtered level.
    left_aside:
        Messages that came while the node was inactive.
    failures:
        Messages that could not be processed.
    reading_cpu_s, working_cpu_s:
        CPU time of the thread that reads the source, and of the one that degrades and estimates, s.
    events:
        How often a live sensor came into each state; see ``node.health``.
    """

    received: int = 0
    estimated: int = 0
    dropped_by_source: int = 0
    dropped_by_queue: int = 0
    frames_lost: int = 0
    cycles_lost: int = 0
    clock_set_back: int = 0
    late: int = 0
    left_aside: int = 0
    failures: int = 0
    reading_cpu_s: float = 0.0
    working_cpu_s: float = 0.0
    events: dict[str, int] = field(default_factory=dict)
    first_stamp_ns: int | None = None
    last_stamp_ns: int = 0
    level_sum: float = 0.0
    error_sum: float = 0.0
    latencies_ns: deque[int] = field(default_factory=lambda: deque(maxlen=LATENCIES_KEPT))

    @property
    def dropped(self) -> int:
        """Messages lost so far, by the source and by the queue."""
        return self.dropped_by_source + self.dropped_by_queue

    def receive(self, message: Frame | RadarScan) -> None:
        """Take in one message of the source."""
        self.received += 1
        self.dropped_by_source = message.dropped
        if self.first_stamp_ns is None:
            self.first_stamp_ns = message.stamp_ns
        behind_ns = self.last_stamp_ns - message.stamp_ns
        self.clock_set_back += behind_ns > CLOCK_STEP_NS
        self.late += 0 < behind_ns <= CLOCK_STEP_NS
        self.last_stamp_ns = message.stamp_ns
        if isinstance(message, RadarScan):
            self.frames_lost += message.frames_lost
            self.cycles_lost += message.cycles_lost

    def count(self, level: NoiseLevel) -> None:
        """Take in one published noise level."""
        self.estimated += 1
        self.level_sum += level.level
        self.error_sum += abs(level.level - level.true_level)
        self.latencies_ns.append(level.latency_ns)

    def summary(self) -> dict[str, Any]:
        """Return the counts, the mean level and the latencies, for JSON.

        ``mean_error`` is the mean of abs(level − injected level), %, as if the source were clean.
        """
        seen = "seen" if self.received else "never seen"
        record: dict[str, Any] = {"state": seen, "received": self.received}
        record |= {
            name: getattr(self, name)
            for name in (
                "estimated",
                "dropped_by_source",
                "dropped_by_queue",
                "frames_lost",
                "cycles_lost",
                "failures",
            )
        }
        record["cpu_s"] = round(self.reading_cpu_s + self.working_cpu_s, 3)
        for name in ("clock_set_back", "late", "left_aside"):
            if getattr(self, name):
                record[name] = getattr(self, name)
        if self.events:
            record["events"] = dict(self.events)
        if self.first_stamp_ns is not None and self.last_stamp_ns > self.first_stamp_ns:
            span_s = (self.last_stamp_ns - self.first_stamp_ns) * 1e-9
            record["rate_hz"] = round((self.received - 1) / span_s, 3)
        if self.estimated:
            p50, p99 = np.percentile(self.latencies_ns, [50, 99])
            record["mean_level"] = self.level_sum / self.estimated
            record["mean_error"] = self.error_sum / self.estimated
            record["latency_p50_ns"], record["latency_p99_ns"] = int(p50), int(p99)
        return record

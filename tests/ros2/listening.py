"""What listens to ROS 2 from another process, and what is said to it."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable
from queue import Empty, Queue
from threading import Thread
from typing import Any

import numpy as np

from models.degrade import radar
from models.degrade.draw import DrawKey
from models.estimate.level import NoiseLevel

GHOSTS = radar.draw("ghosts", 5.0, DrawKey(1, "front", 3))
PATIENCE_S = 20.0
"""How long a test waits for what must come; far longer than it takes."""


class ListenerProcess:
    """A subscriber of another process that prints what it receives as JSON."""

    def __init__(self, command: list[str]) -> None:
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._lines: Queue[str] = Queue()
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()
        assert self._lines.get(timeout=PATIENCE_S) == "ready\n"

    def next(self, timeout_s: float = PATIENCE_S) -> Any:
        """Return the next message; fail if none comes."""
        return json.loads(self._lines.get(timeout=timeout_s))

    def until(self, wanted: Callable[[Any], bool]) -> Any:
        """Return the first message that is wanted."""
        while not wanted(message := self.next()):
            pass
        return message

    def waiting(self) -> list[Any]:
        """Return what has come already."""
        messages = []
        try:
            while True:
                messages.append(self.next(0.2))
        except Empty:
            return messages

    def leave(self) -> None:
        """Have it leave the domain in good order."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait(PATIENCE_S)

    def close(self) -> None:
        """End it, whatever it does."""
        self.process.kill()
        self.process.wait()
        self._reader.join()
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            pipe.close()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line)


def noise_level(sequence: int = 0, sensor: str = "front", level: float = 12.5) -> NoiseLevel:
    """Return a level whose every field differs from every other's."""
    return NoiseLevel(
        sensor=sensor,
        stamp_ns=1_700_000_000_123_456_789 + sequence,
        level=level,
        std=3.25,
        probabilities=np.arange(1, 12) / 66,
        kind="snr",
        kind_probabilities={"clean": 0.25, "snr": 0.75},
        raw=14.5,
        effort=0.25,
        injected={"snr": 40.0, "ghosts": 5.0},
        drawn={"ghosts": GHOSTS},
        latency_ns=777,
        sequence=sequence,
        dropped=9,
    )


def wait_until(true: Callable[[], Any]) -> Any:
    """Return what ``true`` returns once it is true; fail if it never is."""
    end_s = time.monotonic() + PATIENCE_S
    while not (value := true()):
        assert time.monotonic() < end_s, "it never came true"
        time.sleep(0.01)
    return value

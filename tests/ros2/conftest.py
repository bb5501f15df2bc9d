"""Domains of DDS for tests, one each, and what listens in them from another process."""

from __future__ import annotations

import itertools
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from node.bus.in_process import Bus
from tests.ros2.listening import ListenerProcess

_DOMAINS = itertools.count(os.getpid())


@pytest.fixture
def domain() -> int:
    """Return a DDS domain that no other test of this process has."""
    return 1 + next(_DOMAINS) % 100  # beyond, its ports may be taken by others


@pytest.fixture
def bus() -> Iterator[Bus]:
    """Return a bus within this process."""
    with Bus() as opened:
        yield opened


@pytest.fixture
def listen(domain: int) -> Iterator[Callable[..., ListenerProcess]]:
    """Return a function that starts a listener of a topic, with Cyclone DDS's own serialiser."""
    started = []

    def start(topic: str, type_name: str = "NoiseLevel", *how: str) -> ListenerProcess:
        script = str(Path(__file__).with_name("listener.py"))
        one = ListenerProcess([sys.executable, script, str(domain), topic, type_name, *how])
        started.append(one)
        return one

    yield start
    for one in started:
        one.close()

"""Marks of tests by where they can run."""

from __future__ import annotations

import os

import pytest

INSIDE = os.environ.get("MURK_VM") == "1"

needs_machine = pytest.mark.skipif(
    not INSIDE, reason="needs real CAN and V4L2: make test-vm runs it in the micro-machine"
)

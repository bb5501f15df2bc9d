"""Where tests find real data: ``MURK_DATA``, else ``../shared/data`` beside the checkout."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# How fast the machine is decides nothing; CI judges a change by the same examples each time.
settings.register_profile("murk", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("murk")

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def data() -> Path:
    """Return the folder of real recordings; skip the test where there is none."""
    folder = Path(os.environ.get("MURK_DATA") or ROOT.parent / "shared" / "data")
    if not (folder / "radar").is_dir():
        pytest.skip(f"no real data at {folder} (set MURK_DATA)")
    return folder

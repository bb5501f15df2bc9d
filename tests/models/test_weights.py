"""What ships with murk: small files with a card each, and nothing of the machine they came from."""

from __future__ import annotations

from pathlib import Path

import pytest

WEIGHTS = sorted((Path(__file__).parents[2] / "models" / "weights").glob("*.onnx"))


@pytest.mark.parametrize("path", WEIGHTS, ids=lambda path: path.stem)
def test_weights_are_small_have_a_card_and_name_no_machine(path: Path) -> None:
    content = path.read_bytes()
    assert len(content) < 2_000_000
    assert "- Reproduce: `" in path.with_suffix(".md").read_text()
    assert b'File "' not in content
    assert b".py" not in content

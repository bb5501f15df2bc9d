from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from dbc.errors import InputError
from node.cli import app

pytest.importorskip("torch")


def fake_train(
    data: Path, output: Path, *, quick: bool, seed: int, report: Callable[[dict[str, object]], None]
) -> dict[str, object]:
    report({"epoch": 1})
    return {"data": str(data), "output": str(output), "quick": quick, "seed": seed}


def test_options_reach_the_training(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("models.training.camera.train", fake_train)
    arguments = ["train", "camera", "--data", str(tmp_path), "--quick", "--seed", "7", "--json"]
    result = CliRunner().invoke(app, arguments)
    assert [json.loads(line) for line in result.stdout.splitlines()] == [
        {"type": "progress", "epoch": 1},
        {
            "type": "summary",
            "data": str(tmp_path),
            "output": "camera.onnx",
            "quick": True,
            "seed": 7,
        },
    ]


def test_it_says_where_the_network_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("models.training.camera.train", fake_train)
    arguments = ["train", "camera", "--data", str(tmp_path), "--output", "new.onnx"]
    result = CliRunner().invoke(app, arguments)
    assert "epoch 1" in result.stdout
    assert "new.onnx" in result.stdout


def test_a_folder_without_data(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["train", "camera", "--data", str(tmp_path), "--quick"])
    assert isinstance(result.exception, InputError)
    assert result.exception.exit_code == 2
    assert "index.csv" in str(result.exception)


def test_the_lens_has_no_opponents(tmp_path: Path) -> None:
    arguments = ["train", "lens", "--data", str(tmp_path), "--opponent", "trees"]
    result = CliRunner().invoke(app, arguments)
    assert isinstance(result.exception, InputError)
    assert "--opponent" in str(result.exception)


def test_a_sensor_without_a_network() -> None:
    assert CliRunner().invoke(app, ["train", "sonar", "--data", "."]).exit_code == 2

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dbc.errors import ModelError
from models.estimate.camera import VERSION
from models.estimate.exposure import SEEN
from models.estimate.image_features import FEATURES
from models.estimate.level import FRAME_KINDS
from models.estimate.network import WEIGHTS, Network, softmax

CAMERA = WEIGHTS / "camera.onnx"


def load(
    path: Path, model: str = "camera", version: int = VERSION, features: int = FEATURES
) -> Network:
    inputs = {"features": (1, features), "history": (1, SEEN)}
    return Network(path, model=model, version=version, inputs=inputs)


def test_shipped_camera_network_knows_its_kinds() -> None:
    assert load(CAMERA).kinds == FRAME_KINDS


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"none\.onnx: No such file"):
        load(tmp_path / "none.onnx")


@pytest.mark.parametrize("content", [b"", b"not a network", bytes(1000)])
def test_corrupt_file(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "corrupt.onnx"
    path.write_bytes(content)
    with pytest.raises(ModelError) as caught:
        load(path)
    assert "corrupt.onnx" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_truncated_file(tmp_path: Path) -> None:
    path = tmp_path / "short.onnx"
    path.write_bytes(CAMERA.read_bytes()[:-1000])
    with pytest.raises(ModelError):
        load(path)


def test_network_of_another_make(tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    model = onnx.load(CAMERA)
    del model.metadata_props[:]
    onnx.save(model, tmp_path / "other.onnx")
    with pytest.raises(ModelError, match="not a network of murk"):
        load(tmp_path / "other.onnx")


def test_network_of_another_sensor() -> None:
    with pytest.raises(ModelError, match="is murk's camera network"):
        load(CAMERA, model="radar")


def test_network_of_another_version() -> None:
    with pytest.raises(ModelError, match=rf"version {VERSION} of the inputs, not {VERSION + 1}"):
        load(CAMERA, version=VERSION + 1)


def test_network_with_other_inputs() -> None:
    with pytest.raises(ModelError, match="input features"):
        load(CAMERA, features=FEATURES + 1)
    with pytest.raises(ModelError, match="has inputs"):
        Network(CAMERA, model="camera", version=VERSION, inputs={"points": (1, None)})


@given(
    st.lists(st.floats(-1e30, 1e30), min_size=1, max_size=20),
)
@settings(deadline=None)
def test_softmax_is_a_distribution(logits: list[float]) -> None:
    probabilities = softmax(np.array(logits))
    assert np.all(probabilities >= 0)
    assert probabilities.sum() == pytest.approx(1, abs=1e-12)

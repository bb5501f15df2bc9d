"""A network of murk in an ONNX file: checked when loaded, run on one thread.

Each file names itself in its metadata, so that a file of another make, of another sensor or of
another version is refused when it is loaded instead of answering nonsense:

``murk.model``
    What it is for: ``camera``, ``lens`` or ``radar``.
``murk.version``
    Version of the inputs' meaning; it changes when the features of that sensor change.
``murk.kinds``
    The kinds in the order of the output ``kind``, separated by commas.

Outputs of a sensor's network: ``level`` (n, 11) and ``kind`` (n, number of kinds), float32 logits;
n is 1, or 2 for the radar (a window of scans and the newest of them).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from dbc.errors import ModelError
from models.estimate.level import LEVELS, Estimate

WEIGHTS = Path(__file__).resolve().parents[1] / "weights"
"""Folder of the networks that murk ships."""

_OUTPUTS = ("level", "kind")
_ERRORS_ONLY = 3


class Network:
    """A session of ONNX Runtime on one thread that never spins; safe to share between threads.

    Parameters
    ----------
    path:
        The ONNX file.
    model:
        The sensor that it must be for: ``camera`` or ``radar``.
    version:
        The version of the inputs' meaning that the caller prepares.
    inputs:
        Shape of each input by name, all float32; None stands for any length.

    Attributes
    ----------
    kinds:
        The kinds that it tells apart.

    Raises
    ------
    ModelError
        If the file is missing, corrupt, or not the network that was asked for.
    """

    def __init__(
        self,
        path: Path,
        *,
        model: str,
        version: int,
        inputs: Mapping[str, tuple[int | None, ...]],
    ) -> None:
        self._session = open_network(path, model=model, version=version)
        metadata = self._session.get_modelmeta().custom_metadata_map
        self.kinds = tuple(metadata.get("murk.kinds", "").split(","))
        _check_inputs(path, self._session, inputs)
        _check_outputs(path, self._session, len(self.kinds))

    def run(self, inputs: Mapping[str, NDArray[np.float32]]) -> Estimate:
        """Return the estimate for one frame or scan (leading dimension 1)."""
        return self.run_each(inputs)[0]

    def run_each(self, inputs: Mapping[str, NDArray[np.float32]]) -> list[Estimate]:
        """Return the estimate for each of several (leading dimension)."""
        level, kind = self._session.run(_OUTPUTS, dict(inputs))
        return [
            Estimate(probabilities, dict(zip(self.kinds, kind_probabilities, strict=True)))
            for probabilities, kind_probabilities in zip(
                softmax(level), softmax(kind).tolist(), strict=True
            )
        ]


def softmax(logits: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return probabilities over the last axis, float64, summing to 1."""
    shifted = np.asarray(logits, np.float64)
    exponential = np.exp(shifted - shifted.max(axis=-1, keepdims=True))
    return np.asarray(exponential / exponential.sum(axis=-1, keepdims=True))


def open_network(path: Path, *, model: str, version: int) -> ort.InferenceSession:
    """Open an ONNX file that must be murk's, for this model and of this version.

    Raises
    ------
    ModelError
        If the file cannot be read, or is not that.
    """
    session = open_session(path)
    metadata = session.get_modelmeta().custom_metadata_map
    found = metadata.get("murk.model")
    if found != model:
        what = f"is murk's {found} network" if found else "is not a network of murk"
        raise ModelError(path, what, f"expected one made by 'murk train {model}'")
    if metadata.get("murk.version") != str(version):
        raise ModelError(
            path,
            f"has version {metadata.get('murk.version')} of the inputs, not {version}",
            f"train it again: murk train {model}",
        )
    return session


def open_session(path: Path) -> ort.InferenceSession:
    """Open an ONNX file on one thread that never spins.

    Raises
    ------
    ModelError
        If the file cannot be read or is no ONNX file.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ModelError(
            path, error.strerror or "cannot be read", "expected an ONNX file"
        ) from None
    options = ort.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = _ERRORS_ONLY
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        return ort.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception:  # ONNX Runtime's exceptions share no other base
        raise ModelError(path, "is no ONNX file that ONNX Runtime can load") from None


def _check_inputs(
    path: Path, session: ort.InferenceSession, inputs: Mapping[str, tuple[int | None, ...]]
) -> None:
    found = {node.name: node for node in session.get_inputs()}
    if set(found) != set(inputs):
        raise ModelError(path, f"has inputs {sorted(found)}", f"expected {sorted(inputs)}")
    for name, shape in inputs.items():
        free = tuple(n if isinstance(n, int) else None for n in found[name].shape)
        if free != shape or found[name].type != "tensor(float)":
            raise ModelError(
                path,
                f"input {name} is {found[name].type} of shape {list(free)}",
                f"expected tensor(float) of shape {list(shape)}",
            )


def _check_outputs(path: Path, session: ort.InferenceSession, kinds: int) -> None:
    found = {node.name: list(node.shape[1:]) for node in session.get_outputs()}
    if found != {"level": [len(LEVELS)], "kind": [kinds]}:
        raise ModelError(
            path, f"has outputs {found}", f"expected level [{len(LEVELS)}] and kind [{kinds}]"
        )

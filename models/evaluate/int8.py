"""A network with weights of 8 bit, to compare with."""

from __future__ import annotations

import logging
from pathlib import Path


def int8_copy(network: Path, folder: Path) -> Path | None:
    """Write a network's copy with weights of 8 bit; None where the extra ``train`` is missing."""
    try:
        import onnx
        from onnxruntime.quantization import quantize_dynamic
    except ImportError:
        return None
    model = onnx.load(network)
    del model.graph.value_info[:]  # the quantiser takes them amiss where weights are transposed
    copy = folder / network.name
    logging.disable(logging.WARNING)
    quantize_dynamic(model, copy)
    logging.disable(logging.NOTSET)
    return copy

"""Writes a trained network as an ONNX file that ``models.estimate.network`` takes for murk's."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Mapping
from pathlib import Path

import onnx
import torch
from torch import Tensor


def export(
    network: torch.nn.Module,
    example: Mapping[str, Tensor],
    output: Path,
    *,
    model: str,
    version: int,
    kinds: tuple[str, ...] = (),
    outputs: tuple[str, ...] = ("level", "kind"),
    free: Mapping[str, Mapping[int, str]] | None = None,
) -> None:
    """Write a network with the metadata that murk asks for.

    Parameters
    ----------
    network:
        Returns logits of level (1, 11) and of kind (1, number of kinds), or what ``outputs`` names.
    example:
        An input by name, in the order of the network's arguments; its shapes are the file's.
    output:
        The ONNX file; its folder is made if need be.
    model, version, kinds:
        See ``models.estimate.network``.
    outputs:
        Names of what the network returns.
    free:
        By input, the axes of any length, and what they are called.
    """
    # The exporter reports, as warnings, the parts of PyTorch that are not installed.
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            network.eval(),
            tuple(example.values()),
            input_names=list(example),
            output_names=list(outputs),
            dynamic_shapes=[dict(free.get(name, {})) for name in example] if free else None,
            dynamo=True,
            verbose=False,
        )
    if program is None:  # only ever so with dynamo=False
        raise RuntimeError("torch.onnx.export returned no program")
    content = _without_traces(program.model_proto)
    onnx.helper.set_model_props(
        content,
        {
            "murk.model": model,
            "murk.version": str(version),
            "murk.kinds": ",".join(kinds),
        },
    )
    output.parent.mkdir(parents=True, exist_ok=True)
    onnx.save(content, output)


def _without_traces(content: onnx.ModelProto) -> onnx.ModelProto:
    """Drop what the exporter notes of this machine: paths and source lines of every operator."""
    graph = content.graph
    for part in (graph, *graph.node, *graph.input, *graph.output, *graph.value_info):
        del part.metadata_props[:]
    for initializer in graph.initializer:
        del initializer.metadata_props[:]
    return content

"""Trains the detector of road users in the camera's picture: ``python -m models.training.bev``.

A small convolutional network that answers for each cell of 4 × 4 pixels: is a road user's middle
here, how far away is it, and how far beside the cell (X. Zhou et al., "Objects as points", 2019).
It learns from clean frames of the simulated world alone, so what a degradation does to it is what
it does to a detector that was never prepared for it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dbc.errors import MissingExtra
from models.bev.camera_first import INPUT, MODEL, OUTPUT, VERSION
from models.bev.picture import CELL, DEPTH_M, FOCAL, HEIGHT, HORIZON, WIDTH, horizon_of, strip
from models.bev.truth import faces, visible
from models.world.camera import MOUNT_Z, WorldCamera
from models.world.objects import VEHICLES, Kind
from models.world.road import World

try:
    import torch
    from torch import nn
    from torch.nn import functional

    from models.training.bev_card import write_card
    from models.training.export import export
except ImportError:
    raise MissingExtra("train", "python -m models.training.bev") from None

if TYPE_CHECKING:
    from torch import Tensor

FIRST_SEED = 2_000_000  # far from the seeds that people type: a demonstration shows new worlds
DURATION_S = 20.0
WORLDS, FRAMES = 90, 30
EPOCHS, BATCH = 10, 12
DRIVES = 12
"""Drives that the result is measured on."""
PEAK_RATE = 6e-3
DEPTH_WEIGHT = 2.0
HIDDEN = 0.3
"""Share of its width in sight below which a road user is neither to be found nor to be missed."""
NEAREST_M, FARTHEST_M, LEARNT_M = 2.5, 90.0, 75.0

_ROWS, _COLUMNS = HEIGHT // CELL, WIDTH // CELL
_WANTED = np.isin(np.arange(len(Kind)), (*VEHICLES, Kind.PEDESTRIAN))

Report = Callable[[dict[str, object]], None]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Pictures and what is to be answered to them.

    Attributes
    ----------
    pictures:
        (n, HEIGHT, WIDTH, 3) uint8.
    answers:
        (n, 5, rows, columns) float32: heat, its weight in the loss, logarithm of the depth,
        shift, and whether the last two count.
    """

    pictures: NDArray[np.uint8]
    answers: NDArray[np.float32]


def make_samples(worlds: int, frames: int, first_seed: int = FIRST_SEED) -> Samples:
    """Return frames spread evenly over simulated drives, with every road user in sight."""
    pictures, answers = [], []
    for seed in range(first_seed, first_seed + worlds):
        camera = WorldCamera(World(seed, DURATION_S))
        horizon = horizon_of(camera)
        last = int(DURATION_S * camera.rate_hz) - 1
        for sequence in np.linspace(0, last, frames).astype(int).tolist():
            pictures.append(strip(camera.frame(sequence).image, horizon))
            answers.append(_answers(camera, camera.time(sequence)))
    return Samples(np.array(pictures), np.array(answers))


def _answers(camera: WorldCamera, t_s: float) -> NDArray[np.float32]:
    """Return what is right at a moment, (5, rows, columns); see ``Samples``."""
    view, objects = camera.view(t_s), camera.world.objects(t_s)
    wanted = _WANTED[objects.kind]
    seen, place, objects = (
        visible(view, objects)[wanted],
        faces(view, objects)[wanted],
        objects[wanted],
    )
    heat, weight, log_depth, shift, counts = np.zeros((5, _ROWS, _COLUMNS), np.float32)
    weight += 1
    rows, columns = np.mgrid[:_ROWS, :_COLUMNS] + 0.5
    for i in np.argsort(-place[:, 0]):
        depth, left = place[i]
        column = (WIDTH / 2 - left * FOCAL / depth) / CELL
        if not (NEAREST_M < depth < FARTHEST_M and -1 < column < _COLUMNS + 1 and seen[i] > 0.02):
            continue
        row = (HORIZON + (MOUNT_Z - objects.height[i] / 2) * FOCAL / depth) / CELL
        column, row = np.clip(column, 0, _COLUMNS - 0.01), np.clip(row, 0, _ROWS - 0.01)
        width = max(objects.width[i], 0.5) * FOCAL / depth / CELL
        spread = np.clip(0.16 * width, 0.7, 2.5)
        peak = np.exp(-((columns - column) ** 2 + (rows - row) ** 2) / (2 * spread**2))
        if seen[i] < HIDDEN or depth > LEARNT_M:
            weight[peak > 0.3] = 0
            continue
        peak[int(row), int(column)] = 1.0
        own = (peak > 0.6) & (peak > heat)
        heat[:] = np.maximum(heat, peak)
        log_depth[own], shift[own] = np.log(depth / DEPTH_M), (column - columns)[own]
        counts[own] = weight[own] = 1
    return np.stack([heat, weight, log_depth, shift, counts])


class Detector(nn.Module):
    """From a picture's counts to heat (as a logit), logarithm of the depth, and shift."""

    rows: Tensor
    columns: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.to_half = _layer(5, 8, 2)
        self.to_quarter = nn.Sequential(_layer(8, 16, 2), _layer(16, 16))
        self.to_eighth = nn.Sequential(_layer(16, 32, 2), _layer(32, 32))
        self.to_sixteenth = nn.Sequential(
            _layer(32, 48, 2), _layer(48, 48), _layer(48, 48, reach=2)
        )
        self.up_eighth, self.mix_eighth = nn.Conv2d(48, 32, 1), _layer(32, 32)
        self.up_quarter, self.mix_quarter = nn.Conv2d(32, 16, 1), _layer(16, 16)
        self.answer = nn.Conv2d(16, 3, 1)
        self.answer.bias = nn.Parameter(torch.tensor([-3.0, 0.0, 0.0]))  # few cells hold one
        self.register_buffer("rows", torch.linspace(-1, 1, HEIGHT).view(1, 1, HEIGHT, 1))
        self.register_buffer("columns", torch.linspace(-1, 1, WIDTH).view(1, 1, 1, WIDTH))

    def forward(self, picture: Tensor) -> Tensor:
        """Return (batch, 3, rows, columns) for (batch, 3, HEIGHT, WIDTH) counts."""
        rows = self.rows.expand(len(picture), -1, -1, WIDTH)
        columns = self.columns.expand(len(picture), -1, HEIGHT, -1)
        placed = torch.cat([picture / 127.5 - 1, rows, columns], dim=1)
        quarter = self.to_quarter(self.to_half(placed))
        eighth = self.to_eighth(quarter)
        coarse = self.up_eighth(self.to_sixteenth(eighth))
        eighth = self.mix_eighth(eighth + functional.interpolate(coarse, scale_factor=2.0))
        coarse = self.up_quarter(eighth)
        answer: Tensor = self.answer(
            self.mix_quarter(quarter + functional.interpolate(coarse, scale_factor=2.0))
        )
        return answer


def _layer(before: int, after: int, step: int = 1, reach: int = 1) -> nn.Module:
    convolution = nn.Conv2d(before, after, 3, step, padding=reach, dilation=reach, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(after), nn.ReLU())


def fit(samples: Samples, epochs: int, seed: int, report: Report) -> Detector:
    """Train a detector; deterministic on one machine."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    pictures = torch.from_numpy(samples.pictures).permute(0, 3, 1, 2).contiguous()
    answers = torch.from_numpy(samples.answers)
    detector = Detector()
    steps = epochs * (len(pictures) // BATCH)
    optimizer = torch.optim.AdamW(detector.parameters(), weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, PEAK_RATE, total_steps=steps)
    for epoch in range(epochs):
        total = 0.0
        order = torch.randperm(len(pictures))[: steps // epochs * BATCH]
        for batch in torch.split(order, BATCH):
            picture, answer = _varied(pictures[batch].float(), answers[batch].clone())
            loss = _loss(detector(picture), answer)
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
            total += loss.item()
        report({"epoch": epoch + 1, "of": epochs, "loss": total * epochs / steps})
    return detector.eval()


def _varied(picture: Tensor, answer: Tensor) -> tuple[Tensor, Tensor]:
    """Return pictures and answers mirrored half of the time, a little brighter or darker."""
    if torch.rand(()) < 0.5:
        picture, answer = picture.flip(-1), answer.flip(-1)
        answer[:, 3] = -answer[:, 3]
    gain = torch.empty(len(picture), 1, 1, 1).uniform_(0.85, 1.15)
    offset = torch.empty(len(picture), 1, 1, 1).uniform_(-15, 15)
    return ((picture - 110) * gain + 110 + offset).clamp(0, 255), answer


def _loss(output: Tensor, answer: Tensor) -> Tensor:
    """Return the focal loss of the heat and the absolute errors of depth and shift."""
    heat, weight, counts = answer[:, 0], answer[:, 1], answer[:, 4]
    score = output[:, 0].sigmoid().clamp(1e-4, 1 - 1e-4)
    middle = (heat >= 0.999).float()
    missed = middle * (1 - score) ** 2 * score.log()
    false = (1 - middle) * (1 - heat) ** 4 * score**2 * (1 - score).log()
    focal = -((missed + false) * weight).sum() / middle.sum().clamp(min=1)
    errors = functional.smooth_l1_loss(output[:, 1:], answer[:, 2:4], reduction="none", beta=0.05)
    off = (errors.sum(dim=1) * counts).sum() / counts.sum().clamp(min=1)
    return focal + DEPTH_WEIGHT * off


def train(output: Path, *, quick: bool, seed: int, report: Report) -> None:
    """Train the detector, and write it and its card.

    Parameters
    ----------
    output:
        The ONNX file to write; its card goes beside it with the suffix ``.md``.
    quick:
        A few frames and one epoch, in seconds: to see that it runs, not to be used.
    seed:
        Of the network and the order of the frames.
    report:
        Called with a record of the progress after every epoch.
    """
    worlds, frames = (1, BATCH) if quick else (WORLDS, FRAMES)
    detector = fit(make_samples(worlds, frames), 1 if quick else EPOCHS, seed, report)
    example = {INPUT: torch.zeros(1, 3, HEIGHT, WIDTH)}
    export(detector, example, output, model=MODEL, version=VERSION, outputs=(OUTPUT,))
    write_card(
        output,
        parameters=sum(parameter.numel() for parameter in detector.parameters()),
        frames=worlds * frames,
        worlds=worlds,
        seed=seed,
        drives=1 if quick else DRIVES,
    )


def _say(progress: dict[str, object]) -> None:
    sys.stdout.write(f"{progress}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    train(Path(sys.argv[1]), quick=False, seed=0, report=_say)

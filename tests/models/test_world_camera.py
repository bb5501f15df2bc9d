"""The simulated camera: frames, geometry that agrees with the radar's, pictures like real ones."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from numpy.typing import NDArray

from models.degrade.camera import apply, draw
from models.degrade.draw import DrawKey
from models.estimate.camera import CameraEstimator
from models.estimate.network import WEIGHTS
from models.world.camera import WorldCamera
from models.world.objects import VEHICLES, Objects
from models.world.radar import WorldRadar
from models.world.render.view import View
from models.world.road import World


@pytest.fixture(scope="module")
def camera() -> WorldCamera:
    return WorldCamera(World(3, 60.0))


def test_frames_are_as_asked() -> None:
    camera = WorldCamera(World(1, 0.5), sensor="front", width=320, height=180, rate_hz=10)
    frames = list(camera.frames())
    assert [frame.sequence for frame in frames] == [0, 1, 2, 3, 4]
    assert np.all(np.diff([frame.stamp_ns for frame in frames]) == 100_000_000)
    for frame in frames:
        assert frame.image.shape == (180, 320, 3)
        assert frame.image.dtype == np.uint8
        assert frame.image.flags.c_contiguous
        assert (frame.sensor, frame.stamp_source) == ("front", "simulated")


def test_a_frame_is_the_same_whoever_asks_and_in_whatever_order(camera: WorldCamera) -> None:
    other = WorldCamera(World(3, 60.0))
    third = list(islice(other.frames(), 3))[2]
    assert np.array_equal(camera.frame(2).image, third.image)
    assert not np.array_equal(camera.frame(2).image, camera.frame(3).image)
    assert not np.array_equal(WorldCamera(World(4, 60.0)).frame(2).image, third.image)


def test_the_picture_moves_while_the_ego_drives_and_rests_while_it_stands() -> None:
    world = next(w for w in (World(seed, 120.0) for seed in range(50)) if w.drive.stops)
    camera = WorldCamera(world, width=480, height=270)
    t = np.arange(0.0, 118.0, 0.5)
    speed = np.array([world.ego(float(s)).speed for s in t])
    driving = int(t[speed.argmax()] * 12.5)
    stood = np.flatnonzero((speed == 0) & (np.roll(speed, -1) == 0))
    standing = int(t[stood[len(stood) // 2]] * 12.5)

    def change(sequence: int) -> float:
        a, b = (camera.frame(k).image[180:].astype(int) for k in (sequence, sequence + 1))
        return float(np.median(np.abs(a - b)))

    assert change(standing) <= 2
    assert change(driving) > 4


def columns(view: View, objects: Objects) -> NDArray[np.float64]:
    """Return (N, 2) first and last image column of each object's box."""
    corners = objects.corners()
    ahead, left = view.to_camera(corners[..., 0], corners[..., 1])
    pixels = view.pixels(np.stack([np.maximum(ahead, 0.5), left, np.zeros(ahead.shape)], axis=-1))
    return np.stack([pixels[..., 0].min(axis=1), pixels[..., 0].max(axis=1)], axis=1)


def test_where_the_radar_sees_vehicles_the_camera_has_them_too() -> None:
    hits = total = 0
    for seed in range(6):
        world = World(seed, 40.0)
        camera, radar = WorldCamera(world, width=320, height=180), WorldRadar(world)
        for sequence in range(0, 500, 100):
            scan, t_s = radar.scan(sequence), radar.time(sequence)
            view, antenna = camera.view(t_s), radar.antenna(t_s)
            movers = world.moving(t_s)
            spans = columns(view, movers[np.isin(movers.kind, VEHICLES)])
            chosen = np.isin(scan.dyn_prop, (0, 2)) & (scan.x > 12) & (scan.x < 70)
            cos, sin = np.cos(antenna.heading), np.sin(antenna.heading)
            x = antenna.x + scan.x[chosen] * cos - scan.y[chosen] * sin
            y = antenna.y + scan.x[chosen] * sin + scan.y[chosen] * cos
            ahead, left = view.to_camera(x.astype(float), y.astype(float))
            column = view.pixels(np.stack([ahead, left, np.zeros(len(x))], axis=-1))[:, 0]
            margin = 0.02 * camera.width
            inside = (column[:, None] > spans[:, 0] - margin) & (
                column[:, None] < spans[:, 1] + margin
            )
            hits += int(inside.any(axis=1).sum())
            total += len(column)
    assert total > 30
    assert hits / total > 0.8


def test_the_horizon_and_the_road_are_where_the_projection_says(camera: WorldCamera) -> None:
    view = camera.view(10.0)
    far = view.pixels(np.array([[1e6, 0.0, 0.0]]))[0]
    assert far == pytest.approx([view.width / 2, view.horizon], abs=0.01)
    near = view.pixels(np.array([[10.0, 0.0, 0.0], [20.0, 0.0, 0.0]]))
    assert near[0, 1] - view.horizon == pytest.approx(2 * (near[1, 1] - view.horizon))


def test_pictures_have_texture_contrast_and_a_few_clipped_highlights() -> None:
    for seed in (3, 17, 22):
        image = WorldCamera(World(seed, 20.0)).frame(100).image
        green = image[..., 1].astype(float)
        assert 60 < image.mean() < 150
        assert np.percentile(image.max(axis=2), 99) > 235
        assert (image == 255).all(axis=2).mean() < 0.15
        assert np.percentile(image, 2) < 60
        road = green[-120:]
        assert 1.0 < np.abs(np.diff(road, axis=1)).mean() < 20.0


@pytest.mark.skipif(not (WEIGHTS / "camera.onnx").exists(), reason="no trained camera network")
def test_a_network_trained_on_real_pictures_rates_the_simulated_ones_as_their_truth() -> None:
    estimator = CameraEstimator()
    errors: dict[tuple[str, float], list[float]] = {}
    for seed in (3, 17, 20):
        image = WorldCamera(World(seed, 20.0)).frame(100).image
        for kind, level in (("blur", 0.0), ("blur", 50.0), ("under", 50.0), ("noise", 50.0)):
            degraded = apply(draw(kind, level, DrawKey(1, "camera", seed)), image)
            found = estimator.estimate(degraded)
            errors.setdefault((kind, level), []).append(abs(found.level - level))
            assert found.kind == (kind if level else "clean")
    for case, found_errors in errors.items():
        assert np.median(found_errors) < 10, case

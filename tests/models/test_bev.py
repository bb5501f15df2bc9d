"""Road users in bird's-eye view: truth, what each detector finds, and what noise does to it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dbc.errors import ModelError
from drivers.frame import Frame
from drivers.scan import RadarScan
from models.bev.camera_first import CameraFirst
from models.bev.ospa import ospa
from models.bev.picture import CELL, FOCAL, HEIGHT, HORIZON, WIDTH, horizon_of, places, strip
from models.bev.radar_only import RADAR_AHEAD_M, RadarOnly, speed_over_ground
from models.bev.truth import Truth, faces, truth, visible
from models.degrade import camera as degrade_camera
from models.degrade.draw import DrawKey
from models.world.camera import WorldCamera
from models.world.objects import Floats, Kind, Objects
from models.world.radar import WorldRadar
from models.world.render.view import View
from models.world.road import World
from tests.models.degrade_scans import make_scan

VIEW = View(x=0, y=0, heading=0, s=0, above=1.45, focal=749, width=960, height=540, horizon=250)
EGO = 10.0


def cars(*places: tuple[float, float, float]) -> Objects:
    """Return cars of 4 × 2 m at (x, y, heading)."""
    x, y, heading = np.array(places).T
    n, zero = len(places), np.zeros(len(places))
    length, width = np.full(n, 4.0), np.full(n, 2.0)
    kind = np.full(n, Kind.CAR, np.uint8)
    look = np.arange(n, dtype=np.uint32)
    return Objects(kind, x, x, y, zero, heading, length, width, zero + 1.5, zero, zero, look)


def scan(*echoes: tuple[float, float, float]) -> RadarScan:
    """Return echoes at (x, y) in the radar's frame that move along x over ground, m/s."""
    x, y, speed = np.array(echoes).reshape(-1, 3).T
    standing = np.where(speed == 0, 1, 0).astype(np.uint8)
    return make_scan(x, y, speed - EGO, stamp_ns=0, dyn_prop=standing)


ROADSIDE = tuple((float(x), float(y), 0.0) for x in range(5, 60, 4) for y in (-8, 8))


def frame(stamp_ns: int = 0) -> Frame:
    return Frame(np.zeros((54, 96, 3), np.uint8), "camera", 0, stamp_ns, "simulated")


def test_a_place_is_the_middle_of_the_side_that_faces_the_camera() -> None:
    ahead, crossing = faces(VIEW, cars((20, 1, 0), (20, 0, np.pi / 2)))
    np.testing.assert_allclose(ahead, (18, 1), atol=1e-9)
    np.testing.assert_allclose(crossing, (19, 0), atol=1e-9)


def test_who_is_behind_another_is_hidden() -> None:
    shares = visible(VIEW, cars((10, 0, 0), (20, 0, 0), (20, 8, 0), (20, 30, 0), (-9, 0, 0)))
    np.testing.assert_allclose(shares[:4], (1, 0, 1, 0), atol=0.01)
    half = visible(VIEW, cars((10, 0, 0), (20, 2.5, 0)))[1]
    assert 0.1 < half < 0.9


def test_the_truth_of_a_drive_is_within_what_is_asked() -> None:
    world = World(3, 6.0)
    camera = WorldCamera(world)
    found = [truth(world, camera.view(t), t) for t in np.arange(0, 6, 0.5)]
    every = np.concatenate([one.places for one in found])
    assert len(every) > 10
    assert not Truth(every, np.empty((0, 5))).ignores(every).any()
    assert ((every[:, 0] > 4) & (every[:, 0] < 60)).all()


def test_standing_clutter_does_not_move_over_ground() -> None:
    seen = scan(*ROADSIDE, (30.0, 0.0, 12.0))
    over_ground = speed_over_ground(seen)
    np.testing.assert_allclose(over_ground[:-1], 0, atol=1e-4)
    np.testing.assert_allclose(over_ground[-1], 12, atol=1e-4)


def test_the_radar_alone_reports_what_moves_once_and_nothing_else() -> None:
    car = [(30.0, 0.0, 12.0), (30.5, 0.8, 12.0), (33.0, 0.4, 12.0)]
    found = RadarOnly()(frame(), scan(*ROADSIDE, *car, (40.0, -3.0, -15.0)))
    assert len(found) == 2
    np.testing.assert_allclose(found[0], (30.6 + RADAR_AHEAD_M, 0.4), atol=0.6)
    np.testing.assert_allclose(found[1], (40.0 + RADAR_AHEAD_M, -3.0), atol=1e-4)
    assert RadarOnly()(frame(), scan(*ROADSIDE)).shape == (0, 2)
    assert RadarOnly()(frame(), scan()).shape == (0, 2)


def test_two_that_pass_each_other_are_two() -> None:
    assert len(RadarOnly()(frame(), scan(*ROADSIDE, (30.0, 0.0, 12.0), (31.0, 2.0, -12.0)))) == 2


def test_places_are_told_for_the_frame_s_moment() -> None:
    seen = scan(*ROADSIDE, (40.0, -3.0, -15.0))
    early, late = (RadarOnly()(frame(t), seen)[0] for t in (0, 50_000_000))
    np.testing.assert_allclose(late - early, (-0.05 * (15 + EGO), 0), atol=1e-4)


def test_false_alarms_by_the_sensor_s_own_judgement_are_left_out() -> None:
    seen = scan(*ROADSIDE, (40.0, -3.0, -15.0))
    doubted = replace(seen, pdh0=np.full(len(seen), 6, np.uint8))
    assert len(RadarOnly()(frame(), seen)) == 1
    assert len(RadarOnly()(frame(), doubted)) == 0


@pytest.mark.parametrize("size", [(540, 960), (270, 480), (90, 160)])
def test_the_strip_has_its_horizon_where_the_network_expects_it(size: tuple[int, int]) -> None:
    height, width = size
    image = np.zeros((height, width, 3), np.uint8)
    image[round(0.45 * height) :] = 200
    cut = strip(image, 0.45)
    assert cut.shape == (HEIGHT, WIDTH, 3)
    edge = int((cut[:, WIDTH // 2, 0] > 100).argmax())
    assert abs(edge - HORIZON) <= 1 + WIDTH / width


def test_a_peak_tells_the_place() -> None:
    heat, depth, shift = np.zeros((3, HEIGHT // CELL, WIDTH // CELL))
    heat[10, 50], heat[10, 51], heat[20, 5], heat[3, 3] = 0.9, 0.8, 0.5, 0.2
    depth[10, 50], shift[10, 50] = np.log(2.0), 0.5
    found, scores = places(heat, depth, shift, threshold=0.3)
    np.testing.assert_allclose(scores, (0.9, 0.5))
    expected = (WIDTH / 2 - 51 * CELL) * 30.0 / FOCAL
    np.testing.assert_allclose(found[0], (30.0, expected))


def errors(kind: str, level: float) -> Floats:
    """Return the mean error of the camera, the radar, and of saying nothing, on a drive."""
    world = World(7, 12.0)
    camera, radar = WorldCamera(world, rate_hz=1.0), WorldRadar(world)
    detectors = (CameraFirst(horizon_of(camera)), RadarOnly(), lambda *_: np.empty((0, 2)))
    rows = []
    for sight in camera.frames():
        t_s = camera.time(sight.sequence)
        drawn = degrade_camera.draw(kind, level, DrawKey(0, "camera", sight.sequence))
        seen = replace(sight, image=degrade_camera.apply(drawn, sight.image))
        newest = radar.scan(max(0, int(t_s / 0.072) - 1))
        right = truth(world, camera.view(t_s), t_s)
        rows.append([ospa(find(seen, newest), right) for find in detectors])
    return np.mean(rows, axis=0)


def test_both_find_road_users_and_darkness_blinds_the_camera_only() -> None:
    clean, dark = errors("under", 0), errors("under", 100)
    assert clean[0] < 0.6 * clean[2]
    assert clean[1] < 0.8 * clean[2]
    assert dark[0] > clean[0] + 0.5
    assert dark[1] == clean[1]


def test_a_file_that_is_not_the_network_is_refused(tmp_path: Path) -> None:
    other = Path(__file__).resolve().parents[2] / "models" / "weights" / "camera.onnx"
    with pytest.raises(ModelError, match="bev_camera"):
        CameraFirst(path=other)
    with pytest.raises(ModelError):
        CameraFirst(path=tmp_path / "missing.onnx")


def test_training_writes_a_network_that_runs(tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="needs the extra 'train'")
    pytest.importorskip("onnxscript", reason="needs the extra 'train'")
    from models.training.bev import train

    progress: list[dict[str, object]] = []
    train(tmp_path / "net.onnx", quick=True, seed=0, report=progress.append)
    assert progress[-1]["epoch"] == progress[-1]["of"]
    found = CameraFirst(path=tmp_path / "net.onnx")(frame(), scan(*ROADSIDE))
    assert found.shape[1:] == (2,)

from __future__ import annotations

import time
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from dbc.errors import InputError, MurkError
from drivers.camera import open_camera_source
from drivers.frame import Frame
from drivers.video_writer import VideoWriter
from node.gateway import Gateway
from node.gateway_scene import GatewayScene, build_gateway_scene

WIDTH, HEIGHT, FRAMES, STEP_NS = 96, 64, 20, 30_000_000


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    """A clip whose frames tell their number by their brightness; a checkerboard lies over them."""
    path = tmp_path / "clip.mp4"
    board = np.indices((HEIGHT, WIDTH)).sum(axis=0) // 8 % 2 * 40
    with VideoWriter(path, lossless=True) as writer:
        for number in range(FRAMES):
            grey = (board + 10 + 10 * number).astype(np.uint8)
            writer.write(np.repeat(grey[..., None], 3, axis=2), number * STEP_NS)
    return path


def scene(source: Path, *inject: str, fault: tuple[str, ...] = (), **more: object) -> GatewayScene:
    flags: dict[str, object] = {"inject": inject, "fault": fault, **more}
    return build_gateway_scene(None, "camera", str(source), **flags)  # type: ignore[arg-type]


def through(wanted: GatewayScene, target: Path) -> tuple[list[Frame], dict[str, object]]:
    """Run a gateway into a file, and return what is in the file."""
    with Gateway(wanted, str(target)) as gateway:
        assert gateway.wait(30)
    with open_camera_source(target, "camera") as source:
        return list(source), gateway.summary()


def numbers(frames: list[Frame]) -> list[int]:
    return [round((float(frame.image.mean()) - 30) / 10) for frame in frames]


def contrast(frame: Frame) -> float:
    return float(frame.image.std())


def test_a_clip_comes_through_and_blur_takes_its_contrast(clip: Path, tmp_path: Path) -> None:
    clear, summary = through(scene(clip), tmp_path / "clear.mp4")
    blurred, _ = through(scene(clip, "camera:blur:100"), tmp_path / "blurred.mp4")
    assert numbers(clear) == numbers(blurred) == list(range(FRAMES))
    assert [frame.stamp_ns for frame in clear] == [k * STEP_NS for k in range(FRAMES)]
    assert contrast(blurred[9]) < 0.5 * contrast(clear[9])
    assert summary["frames_in"] == summary["frames_out"] == FRAMES
    assert summary["degraded"] == 0


def test_the_schedule_is_followed(clip: Path, tmp_path: Path) -> None:
    scene_file = tmp_path / "scene.toml"
    scene_file.write_text(
        'sensors = [{name = "front", type = "camera", source = "elsewhere.mp4"}]\n'
        '[[injections]]\nsensor = "front"\nkind = "blur"\npoints = [[0.3, 100], [0.45, 0]]\n'
        '[[faults]]\nsensor = "front"\nkind = "dropped"\npoints = [[0.48, 100]]\n'
    )
    wanted = build_gateway_scene(scene_file, "camera", str(clip))
    frames, summary = through(wanted, tmp_path / "out.mp4")
    blurred = [k for k, frame in enumerate(frames) if contrast(frame) < 0.5 * contrast(frames[0])]
    assert blurred == list(range(10, 15))
    assert numbers(frames) == list(range(16))
    assert summary["faults"] == {"dropped": 4}


@pytest.mark.parametrize("fault", ["frozen", "black", "torn", "late", "dropped"])
def test_each_fault_shows(fault: str, clip: Path, tmp_path: Path) -> None:
    frames, summary = through(scene(clip, fault=(f"{fault}:50",)), tmp_path / "out.mp4")
    faults = summary["faults"]
    assert isinstance(faults, dict)
    hit = faults[fault]
    assert 4 < hit < 16
    if fault == "late":
        stamps = np.array([frame.stamp_ns for frame in frames])
        assert (np.diff(stamps) >= 0).all()
        assert (stamps > np.arange(FRAMES) * STEP_NS).sum() >= hit
    elif fault == "dropped":
        assert len(frames) == FRAMES - hit
    elif fault == "frozen":
        assert len(set(numbers(frames))) == FRAMES - hit
    elif fault == "black":
        assert sum(frame.image.max() < 20 for frame in frames) == hit


def test_a_pipe_gets_a_clip_at_its_own_pace(clip: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "frames"
    got: list[int] = []

    def read() -> None:
        with pipe.open("rb") as stream:
            while len(data := stream.read(WIDTH * HEIGHT * 3)) == WIDTH * HEIGHT * 3:
                got.append(round((np.frombuffer(data, np.uint8).mean() - 30) / 10))

    gateway = Gateway(scene(clip), f"pipe:{pipe}")
    reader = Thread(target=read)
    reader.start()
    began_s = time.monotonic()
    with gateway:
        assert gateway.wait(30)
    reader.join()
    assert got == list(range(FRAMES))
    assert time.monotonic() - began_s >= (FRAMES - 1) * STEP_NS * 1e-9


def test_the_duration_and_a_stop_end_it(clip: Path, tmp_path: Path) -> None:
    frames, _ = through(scene(clip, duration_s=0.3), tmp_path / "out.mp4")
    assert len(frames) == 10
    with Gateway(scene(clip), f"pipe:{tmp_path / 'unread'}") as gateway:
        assert not gateway.wait(0.1), "nobody reads"


def test_a_reader_that_goes_ends_the_run_with_a_line(clip: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "frames"
    gateway = Gateway(scene(clip), f"pipe:{pipe}")
    reader = Thread(target=lambda: pipe.open("rb").close())
    reader.start()
    gateway.start()
    assert gateway.wait(30)
    with pytest.raises(MurkError, match="frames: the reader has gone"):
        gateway.stop()
    reader.join()


def test_nothing_is_left_half_open(clip: Path, tmp_path: Path) -> None:
    before = set(tmp_path.iterdir())
    with pytest.raises(InputError):
        Gateway(scene(tmp_path / "missing.mp4"), str(tmp_path / "out.mp4"))
    with pytest.raises(InputError):
        Gateway(scene(clip), str(tmp_path / "missing" / "out.mp4"))
    assert set(tmp_path.iterdir()) == before

"""Road users from the camera; the radar, where it confirms one, says how far away it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dbc.errors import ModelError
from drivers.frame import Frame
from drivers.scan import RadarScan
from models.bev.picture import HEIGHT, WIDTH, places, strip
from models.bev.radar_only import RADAR_AHEAD_M, mobile, moved, speed_over_ground
from models.estimate.network import WEIGHTS, open_session
from models.world.objects import Floats

MODEL, VERSION = "bev_camera", 1
"""As the network's file names itself."""
INPUT, OUTPUT = "picture", "answer"

ALONE, CONFIRMED = 0.6, 0.3
"""Score from which a place is reported, without and with a radar echo of something mobile there."""
APART_M = 2.5
"""Two places nearer to each other are one road user."""
NEAR_ANGLE, NEAR_RANGE = np.radians(2.5), 0.25
"""So near in direction (rad) and in range (share), an echo is of what the camera saw."""


class CameraFirst:
    """Finds road users in the picture, moving or not; an echo confirms one, and tells its range.

    The network was trained for a camera 1.45 m above the ground, 0.78 image widths of focal length.
    Building one loads the network and runs it once: it is warm.

    Parameters
    ----------
    horizon:
        Row of the camera's horizon, as a share of the image's height.
    ahead_m:
        Place of the radar ahead of the camera.
    path:
        A network made by ``python -m models.training.bev``; the one that murk ships when None.

    Raises
    ------
    ModelError
        If the file is missing, corrupt or another network.
    """

    def __init__(
        self, horizon: float = 0.46, ahead_m: float = RADAR_AHEAD_M, path: Path | None = None
    ) -> None:
        path = path or WEIGHTS / "bev_camera.onnx"
        self._horizon = horizon
        self._ahead_m = ahead_m
        self._session = open_session(path)
        about = self._session.get_modelmeta().custom_metadata_map
        if (about.get("murk.model"), about.get("murk.version")) != (MODEL, str(VERSION)):
            what = f"is not version {VERSION} of the network '{MODEL}'"
            raise ModelError(path, what, "expected one made by 'python -m models.training.bev'")
        self._session.run([OUTPUT], {INPUT: np.zeros((1, 3, HEIGHT, WIDTH), np.float32)})

    def __call__(self, frame: Frame, scan: RadarScan) -> Floats:
        """Return the places of road users at the frame's moment, (k, 2) m, camera coordinates.

        Parameters
        ----------
        scan:
            The newest scan before the frame, in cluster mode.
        """
        found, scores = self.from_picture(frame)
        echoing = mobile(scan, speed_over_ground(scan))
        echoes = moved(scan, frame.stamp_ns, self._ahead_m)[echoing]
        kept: list[Floats] = []
        for place, score in zip(found, scores, strict=True):
            near = _near(place, echoes)
            if score < (CONFIRMED if near.any() else ALONE):
                continue
            if near.any():
                strongest = echoes[near][scan.rcs[echoing][near].argmax()]
                place = place * (np.hypot(*strongest) / np.hypot(*place))
            if all(np.hypot(*(place - other)) > APART_M for other in kept):
                kept.append(place)
        return np.array(kept).reshape(-1, 2)

    def from_picture(self, frame: Frame) -> tuple[Floats, Floats]:
        """Return the places that the picture tells, (k, 2) m, and their scores, best first."""
        picture = strip(frame.image, self._horizon).transpose(2, 0, 1)[np.newaxis]
        (answer,) = self._session.run([OUTPUT], {INPUT: picture.astype(np.float32)})
        logit, log_depth, shift = answer[0].astype(np.float64)
        return places(1 / (1 + np.exp(-logit)), log_depth, shift, CONFIRMED)


def _near(place: Floats, echoes: Floats) -> NDArray[np.bool_]:
    """Return which of (n, 2) echoes lie in the direction of a place, and about as far away."""
    share = np.hypot(echoes[:, 0], echoes[:, 1]) / np.hypot(*place) - 1
    turn = np.arctan2(echoes[:, 1], echoes[:, 0]) - np.arctan2(place[1], place[0])
    return np.asarray((np.abs(turn) < NEAR_ANGLE) & (np.abs(share) < NEAR_RANGE))

"""Road users from the radar alone: what moves, or has stopped, gathered into objects."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.frame import Frame
from drivers.scan import RadarScan
from models.world.objects import Floats

RADAR_AHEAD_M = 1.7
"""Default place of the radar ahead of the camera."""

MOVING = 1.0
"""Radial speed over ground from which something moves, m/s."""
LINK_M, LINK_SPEED = 3.5, 2.0
"""Clusters nearer to each other than this, in place and in radial speed (m/s), are one object."""
_STOPPED = 7
_TRUSTED = 5
_STANDS = 0.5


class RadarOnly:
    """Road users by their Doppler; what has always stood it does not tell from the roadside.

    Parameters
    ----------
    ahead_m:
        Place of the radar ahead of the camera.
    """

    def __init__(self, ahead_m: float = RADAR_AHEAD_M) -> None:
        self._ahead_m = ahead_m

    def __call__(self, frame: Frame, scan: RadarScan) -> Floats:
        """Return the places of road users at the frame's moment, (k, 2) m, camera coordinates.

        Parameters
        ----------
        frame:
            Only its stamp is read.
        scan:
            The newest scan before it, in cluster mode.
        """
        over_ground = speed_over_ground(scan)
        chosen = mobile(scan, over_ground)
        place = moved(scan, frame.stamp_ns, self._ahead_m)[chosen]
        group = linked(place, over_ground[chosen])
        strength = 10 ** (scan.rcs[chosen].astype(np.float64) / 20)
        return np.array(
            [_face(place[group == g], strength[group == g]) for g in set(group)]
        ).reshape(-1, 2)


def mobile(scan: RadarScan, over_ground: Floats) -> NDArray[np.bool_]:
    """Return which clusters are echoes of what moves, or has moved and stopped, (n,).

    Where the scan tells its quality, those that are false alarms by 99 % or more are left out.
    """
    chosen = (np.abs(over_ground) > MOVING) | (scan.dyn_prop == _STOPPED)
    if scan.pdh0 is not None:
        chosen &= scan.pdh0 <= _TRUSTED
    return np.asarray(chosen)


def speed_over_ground(scan: RadarScan) -> Floats:
    """Return each cluster's radial speed less what the radar's own motion explains, (n,) m/s.

    The own motion is what most clusters agree on, in least squares over those that do (D. Kellner
    et al., "Instantaneous ego-motion estimation using Doppler radar", IEEE ITSC 2013).
    """
    x, y = scan.x.astype(np.float64), scan.y.astype(np.float64)
    sight = np.stack([x, y], axis=1) / np.maximum(np.hypot(x, y), 0.2)[:, None]
    radial = (sight * np.stack([scan.vx, scan.vy], axis=1)).sum(axis=1)
    ahead = sight[:, 0] > 0.5
    own = np.array([-np.median(radial[ahead] / sight[ahead, 0]) if ahead.any() else 0.0, 0.0])
    for _ in range(3):
        stands = np.abs(radial + sight @ own) < _STANDS
        if np.count_nonzero(stands) < 3:
            break
        own = -np.linalg.lstsq(sight[stands], radial[stands], rcond=None)[0]
    result: Floats = radial + sight @ own
    return result


def moved(scan: RadarScan, stamp_ns: int, ahead_m: float) -> Floats:
    """Return where the clusters are by ``stamp_ns``, (n, 2) m, camera coordinates."""
    later_s = (stamp_ns - scan.stamp_ns) * 1e-9
    x = scan.x.astype(np.float64) + scan.vx * later_s + ahead_m
    return np.stack([x, scan.y + scan.vy * later_s], axis=1)


def linked(place: Floats, speed: Floats) -> NDArray[np.intp]:
    """Return a number for each of n points, the same for those that a chain of near ones links."""
    gap = np.hypot(*np.moveaxis(place[:, None] - place, -1, 0))
    near = (gap < LINK_M) & (np.abs(speed[:, None] - speed) < LINK_SPEED)
    group = np.arange(len(place))
    while True:
        lowest = np.where(near, group, len(place)).min(axis=1, initial=len(place))
        if np.array_equal(lowest, group):
            return group
        group = lowest


def _face(place: Floats, strength: Floats) -> Floats:
    """Return where an object turns to the sensor: half way to its nearest echo, across by power."""
    middle = np.average(place, axis=0, weights=strength)
    return np.array([(middle[0] + place[:, 0].min()) / 2, middle[1]])

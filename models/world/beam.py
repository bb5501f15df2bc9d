"""The radar's two scans: field of view, sensitivity, resolution and accuracy of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.world.objects import Floats

DETECTION_DB = 13.0
"""SNR that a detection needs."""

RCS_FLOOR = -5.0
"""The sensor reports nothing weaker, dBm²."""

NOMINAL_DB = 20.0
"""SNR at which an echo has its scan's ``range_error`` and ``azimuth_error``."""


@dataclass(frozen=True, slots=True)
class Beam:
    """One of the radar's two scans.

    Attributes
    ----------
    far:
        Whether it is the far scan.
    half_width:
        Half field of view, rad.
    fringe:
        How far beyond it strong echoes still come in, rad.
    range_min, range_max:
        m.
    reach:
        Range at which a target of ``RCS_FLOOR`` on boresight has an SNR of ``DETECTION_DB``, m.
    edge_loss_db:
        Two-way loss of gain at the edge of the field of view (parabolic in azimuth), dB.
    outside_loss_db:
        Further loss in the fringe, dB.
    typical_m:
        A range at which the sensor's tables hold this scan's values, m.
    bin_m:
        Range within which only the strongest echo of one speed is reported, m.
    wave_number:
        Of its carrier, rad/m.
    pitch:
        By how much its speckle turns faster than the near scan's; the two fade independently.
    calm:
        Factor on the reflectors' steady share.
    range_error, azimuth_error:
        Standard deviation of an echo of ``NOMINAL_DB``, as a share of the data sheet's accuracy.
    range_bias, azimuth_bias:
        Standard deviation, over reflectors, of where this scan finds a reflector against where
        the near scan does, m and rad; it stays as it is from scan to scan.
    """

    far: bool
    half_width: float
    fringe: float
    range_min: float
    range_max: float
    reach: float
    edge_loss_db: float
    outside_loss_db: float
    typical_m: float
    bin_m: float
    wave_number: float
    pitch: float
    calm: float
    range_error: float
    azimuth_error: float
    range_bias: float
    azimuth_bias: float


NEAR = Beam(
    far=False,
    half_width=np.radians(60.0),
    fringe=np.radians(15.0),
    range_min=0.5,
    range_max=129.7,
    reach=83.0,
    edge_loss_db=10.0,
    outside_loss_db=15.0,
    typical_m=20.0,
    bin_m=0.75,
    wave_number=2 * np.pi / 0.00394,
    pitch=1.0,
    calm=1.0,
    range_error=0.8,
    azimuth_error=0.45,
    range_bias=0.0,
    azimuth_bias=0.0,
)

FAR = Beam(
    far=True,
    half_width=np.radians(9.0),
    fringe=np.radians(4.0),
    range_min=10.0,
    range_max=258.0,
    reach=160.0,
    edge_loss_db=3.0,
    outside_loss_db=0.0,
    typical_m=200.0,
    bin_m=1.9,
    wave_number=2 * np.pi / 0.00391,
    pitch=1.6,
    calm=0.3,
    range_error=1.0,
    azimuth_error=0.8,
    range_bias=0.4,
    azimuth_bias=np.radians(0.45),
)


def noise_db(beam: Beam, r: Floats, azimuth: Floats) -> Floats:
    """Return the radar cross section that equals the noise, dBm²: the radar equation.

    SNR = RCS − 40 log10(r) + const − antenna loss; doubling r costs 12.04 dB.
    """
    off = np.abs(azimuth) / beam.half_width
    loss = beam.edge_loss_db * off**2 + beam.outside_loss_db * (off > 1)
    quiet = RCS_FLOOR - DETECTION_DB
    result: Floats = quiet + 40 * np.log10(np.maximum(r, 0.2) / beam.reach) + loss
    return result

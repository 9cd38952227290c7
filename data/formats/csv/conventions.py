"""What a file of readings leaves open, and how it is taken: the quantity, the azimuth of the mirror side, coverage."""

import math
from typing import NamedTuple

from gonio.data.quantities import QUANTITIES
from gonio.models.errors import GonioError, nearest

MIRROR_AZIMUTHS = (0.0, 180.0)


class Convention(NamedTuple):
    """What a file leaves open, as it is taken."""

    quantity: str = "brdf"
    """A key of `gonio.data.quantities.QUANTITIES`."""
    quantity_known: bool = True
    """Whether the format or the caller says the quantity."""
    mirror_azimuth: float = 180.0
    """phi_o − phi_i of the mirror side, degrees: 180, or 0 where azimuths are of the light's way."""


def convention(quantity: str | None, mirror_azimuth: float | None) -> Convention:
    """The convention that a caller states, or the usual one. Raises GonioError for an unknown one."""
    if quantity is not None and quantity not in QUANTITIES:
        raise GonioError(f"quantity {str(quantity)[:40]!r} is unknown; {nearest(str(quantity), QUANTITIES)}")
    if mirror_azimuth is not None and mirror_azimuth not in MIRROR_AZIMUTHS:
        raise GonioError(f"the azimuth of the mirror side is {mirror_azimuth}; give 0 or 180 degrees")
    mirror = 180.0 if mirror_azimuth is None else float(mirror_azimuth)
    return Convention(quantity or "brdf", quantity is not None, mirror)


def coverage_factor(stated: float | None) -> float:
    """k of a file's uncertainties, by what a caller states. Raises GonioError for what is none."""
    k = 1.0 if stated is None else stated
    if not 0 < k < math.inf:
        raise GonioError(f"the coverage factor is {k}; give a number above 0, such as 2")
    return float(k)

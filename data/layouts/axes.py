"""The angles that cells are laid out by."""

import math
from typing import NamedTuple

import numpy as np

TURN = 2 * math.pi


class AxisKind(NamedTuple):
    """One angle that cells are laid out by: its closed domain, radians, and its period if it is an azimuth."""

    name: str
    long_name: str
    low: float
    high: float
    period: float | None = None
    quadratic: bool = False
    """Whether grids often step evenly in the angle's square root."""


THETA_I = AxisKind("theta_i", "polar angle of the direction to the light", 0.0, math.pi)
PHI_I = AxisKind("phi_i", "azimuth of the direction to the light", 0.0, TURN, TURN)
THETA_O = AxisKind("theta_o", "polar angle of the direction to the detector", 0.0, math.pi)
PHI_O = AxisKind("phi_o", "azimuth of the direction to the detector", 0.0, TURN, TURN)


class OutgoingGrid(NamedTuple):
    """The directions of the detector that are the same for every incidence, and the incidences; radians."""

    theta_i: np.ndarray
    phi_i: np.ndarray
    theta_o: np.ndarray
    azimuth: np.ndarray
    """Azimuths of the detector, relative to the surface or, for `phi_i` = 0 alone, to the light."""

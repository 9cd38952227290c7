"""Samples at any directions, without a grid."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from gonio.data.layouts.axes import PHI_I, PHI_O, THETA_I, THETA_O
from gonio.data.layouts.base import Angles, Layout
from gonio.data.layouts.spherical_grid import angles_of_pair, pair_by_angles
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction


class ScatteredSamples(Layout):
    """One dimension, "sample"; the axes theta_i, phi_i, theta_o, phi_o hold the angles of each sample."""

    name = "scattered"
    axis_kinds = (THETA_I, PHI_I, THETA_O, PHI_O)
    gridded = False
    pair = staticmethod(pair_by_angles)
    coordinates = staticmethod(angles_of_pair)

    def __init__(self, axes: Mapping[str, Angles]) -> None:
        super().__init__(axes)
        if len({a.size for a in self.axes.values()}) > 1:
            sizes = ", ".join(f"{n} {a.size}" for n, a in self.axes.items())
            raise GonioError(f"a scattered layout needs axes of one length, but they have {sizes} angles")

    @property
    def dims(self) -> tuple[str, ...]:
        return ("sample",)

    @property
    def shape(self) -> tuple[int, ...]:
        return (self.axes["theta_i"].size,)

    def directions(self, start: int = 0, stop: int | None = None) -> tuple["Direction", "Direction"]:
        return self.directions_at(np.arange(*self._range(start, stop)))

    def directions_at(self, cells: np.ndarray) -> tuple["Direction", "Direction"]:
        return self.pair([(np.cos(a[cells]), np.sin(a[cells])) for a in self.axes.values()])

    def angles(self, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, ...]:
        return tuple(a[slice(start, stop)] for a in self.axes.values())

    def cosines(self, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        return np.cos(self.axes["theta_i"][slice(start, stop)]), np.cos(self.axes["theta_o"][slice(start, stop)])

    def solid_angles(self, wi: "Direction", wo: "Direction") -> None:
        return None


def scattered(theta_i: Angles, phi_i: Angles, theta_o: Angles, phi_o: Angles) -> ScatteredSamples:
    """Samples anywhere: four lists of one length; radians, azimuths in [0, 2π)."""
    return ScatteredSamples({"theta_i": theta_i, "phi_i": phi_i, "theta_o": theta_o, "phi_o": phi_o})

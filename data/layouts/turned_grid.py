"""A grid of an anisotropic sample whose detector's azimuths are counted from the light's, as Speos has it."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gonio.data.layouts.angle_layouts import DELTA_PHI, PHI_I, THETA_I, THETA_O, IsotropicGrid
from gonio.data.layouts.base import TURN, Layout, NodeMap, Pair, Trig, node_numbers

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction


class TurnedGrid(Layout):
    """Axes theta_i, phi_i, theta_o and delta_phi = phi_o − phi_i, the same for every phi_i; specular at π."""

    name = "turned"
    sees_behind = True
    axis_kinds = (THETA_I, PHI_I, THETA_O, DELTA_PHI)
    pole_axes = (("theta_o", "delta_phi"),)
    turning_axes = ("phi_i",)

    @property
    def mirrored_axes(self) -> tuple[str, ...]:
        return ("delta_phi",) if self.axes["delta_phi"][-1] <= np.pi * (1 + 1e-9) else ()

    @staticmethod
    def pair(trig: Trig) -> Pair:
        (ci, si), (ca, sa), (co, so), (cp, sp) = trig
        return (si * ca, si * sa, ci), (so * (ca * cp - sa * sp), so * (sa * cp + ca * sp), co)

    @staticmethod
    def coordinates(wi: "Direction", wo: "Direction") -> dict[str, Any]:
        from gonio.models.geometry.directions import to_spherical

        return {**IsotropicGrid.coordinates(wi, wo), "phi_i": to_spherical(wi)[1]}

    def exchanged(self, cells: np.ndarray) -> np.ndarray:
        theta_i, phi_i, theta_o, delta_phi = self.axes.values()
        i, p, o, d = np.unravel_index(cells, self.shape)
        back = delta_phi if self.mirrored_axes else -delta_phi
        nodes = (
            node_numbers(theta_i, theta_o)[o],
            node_numbers(phi_i, phi_i[p] + delta_phi[d], TURN),
            node_numbers(theta_o, theta_i)[i],
            node_numbers(delta_phi, back, TURN)[d],
        )
        known = np.min(nodes, axis=0) >= 0
        return np.where(known, np.ravel_multi_index([np.maximum(n, 0) for n in nodes], self.shape), -1)

    def mirror_map(self) -> NodeMap | None:
        if self.mirrored_axes:
            return None
        nodes, (_, phi_i, _, delta_phi) = self._same_nodes(), self.axes.values()
        nodes[1] = (1, node_numbers(phi_i, 2 * phi_i[0] - phi_i, TURN))
        nodes[3] = (3, node_numbers(delta_phi, -delta_phi, TURN))
        return nodes


def turned(theta_i: ArrayLike, phi_i: ArrayLike, theta_o: ArrayLike, delta_phi: ArrayLike) -> TurnedGrid:
    """A grid over all four angles, the detector's azimuth counted from the light's; radians."""
    return TurnedGrid({"theta_i": theta_i, "phi_i": phi_i, "theta_o": theta_o, "delta_phi": delta_phi})

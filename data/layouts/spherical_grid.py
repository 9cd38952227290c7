"""A grid over both hemispheres."""

from typing import TYPE_CHECKING, Any

import numpy as np

from gonio.data.layouts.axes import PHI_I, PHI_O, THETA_I, THETA_O, TURN, OutgoingGrid
from gonio.data.layouts.base import Angles, Layout, NodeMap, Trig
from gonio.data.layouts.nodes import node_numbers

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction


def pair_by_angles(trig: Trig) -> tuple["Direction", "Direction"]:
    """(wi, wo) by the cosines and sines of theta_i, phi_i, theta_o and phi_o."""
    from gonio.models.geometry.directions import Direction

    (ci, si), (ca, sa), (co, so), (cb, sb) = trig
    return Direction(si * ca, si * sa, ci), Direction(so * cb, so * sb, co)


def angles_of_pair(wi: "Direction", wo: "Direction") -> dict[str, Any]:
    """theta_i, phi_i, theta_o and phi_o of one pair of directions (JAX)."""
    from gonio.models.geometry.directions import to_spherical

    return dict(zip(("theta_i", "phi_i", "theta_o", "phi_o"), (*to_spherical(wi), *to_spherical(wo)), strict=True))


class SphericalGrid(Layout):
    """Axes theta_i, phi_i, theta_o, phi_o."""

    name = "spherical"
    axis_kinds = (THETA_I, PHI_I, THETA_O, PHI_O)
    pole_axes = (("theta_i", "phi_i"), ("theta_o", "phi_o"))
    turning_axes = ("phi_i", "phi_o")
    pair = staticmethod(pair_by_angles)
    coordinates = staticmethod(angles_of_pair)

    def angles(self, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, ...]:
        return tuple(self._axis_angles(start, stop))

    def outgoing_grid(self) -> OutgoingGrid:
        return OutgoingGrid(*self.axes.values())

    def exchange_map(self) -> NodeMap:
        theta_i, phi_i, theta_o, phi_o = self.axes.values()
        nodes = [
            (2, node_numbers(theta_i, theta_o)),
            (3, node_numbers(phi_i, phi_o, TURN)),
            (0, node_numbers(theta_o, theta_i)),
            (1, node_numbers(phi_o, phi_i, TURN)),
        ]
        if self.one_light_azimuth:
            nodes[1] = (1, np.arange(1))
            nodes[3] = (3, node_numbers(phi_o, 2 * phi_i[0] - phi_o, TURN))
        return nodes

    def mirror_map(self) -> NodeMap:
        nodes, plane = self._same_nodes(), self.axes["phi_i"][0]
        for k, name in ((1, "phi_i"), (3, "phi_o")):
            nodes[k] = (k, node_numbers(self.axes[name], 2 * plane - self.axes[name], TURN))
        return nodes


def spherical(theta_i: Angles, phi_i: Angles, theta_o: Angles, phi_o: Angles) -> SphericalGrid:
    """A grid over both hemispheres; radians."""
    return SphericalGrid({"theta_i": theta_i, "phi_i": phi_i, "theta_o": theta_o, "phi_o": phi_o})

"""A grid over both polar angles and the difference of azimuths."""

from typing import TYPE_CHECKING, Any

import numpy as np

from gonio.data.layouts.axes import THETA_I, THETA_O, TURN, AxisKind, OutgoingGrid
from gonio.data.layouts.base import Angles, Layout, NodeMap, Trig
from gonio.data.layouts.nodes import SAME, node_numbers

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction

DELTA_PHI = AxisKind("delta_phi", "azimuth of the detector minus that of the light, specular at pi", 0.0, TURN, TURN)


class IsotropicGrid(Layout):
    """Axes theta_i, theta_o and delta_phi = phi_o − phi_i in [0, 2π), specular at π (phi_i = 0)."""

    name = "isotropic"
    axis_kinds = (THETA_I, THETA_O, DELTA_PHI)
    pole_axes = (("theta_i", "delta_phi"), ("theta_o", "delta_phi"))

    @property
    def mirrored_axes(self) -> tuple[str, ...]:
        return ("delta_phi",) if self.axes["delta_phi"][-1] <= np.pi + SAME else ()

    @staticmethod
    def pair(trig: Trig) -> tuple["Direction", "Direction"]:
        from gonio.models.geometry.directions import Direction

        (ci, si), (co, so), (cp, sp) = trig
        return Direction(si, 0.0, ci), Direction(so * cp, so * sp, co)

    @staticmethod
    def coordinates(wi: "Direction", wo: "Direction") -> dict[str, Any]:
        import jax.numpy as jnp

        from gonio.models.geometry.directions import safe_atan2, to_spherical

        theta_i, _ = to_spherical(wi)
        theta_o, phi_o = to_spherical(wo)
        # By the products of components, not by phi_o − phi_i: no azimuth is lost where one of them is at the pole.
        cos_delta, sin_delta = wi.x * wo.x + wi.y * wo.y, wi.x * wo.y - wi.y * wo.x
        no_azimuth = wi.x**2 + wi.y**2 == 0
        delta = jnp.where(no_azimuth, phi_o, safe_atan2(sin_delta, cos_delta))
        return {"theta_i": theta_i, "theta_o": theta_o, "delta_phi": jnp.where(delta < 0, delta + TURN, delta)}

    def angles(self, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, ...]:
        theta_i, theta_o, delta_phi = self._axis_angles(start, stop)
        return theta_i, np.zeros_like(theta_i), theta_o, delta_phi

    def outgoing_grid(self) -> OutgoingGrid:
        return OutgoingGrid(self.axes["theta_i"], np.zeros(1), self.axes["theta_o"], self.axes["delta_phi"])

    def exchange_map(self) -> NodeMap:
        theta_i, theta_o, delta_phi = self.axes.values()
        back = delta_phi if self.mirrored_axes else -delta_phi
        return [
            (1, node_numbers(theta_i, theta_o)),
            (0, node_numbers(theta_o, theta_i)),
            (2, node_numbers(delta_phi, back, TURN)),
        ]

    def mirror_map(self) -> NodeMap | None:
        if self.mirrored_axes:
            return None
        delta_phi = self.axes["delta_phi"]
        return [*self._same_nodes()[:2], (2, node_numbers(delta_phi, -delta_phi, TURN))]


def isotropic(theta_i: Angles, theta_o: Angles, delta_phi: Angles) -> IsotropicGrid:
    """A grid over both polar angles and delta_phi = phi_o − phi_i (specular at π); radians."""
    return IsotropicGrid({"theta_i": theta_i, "theta_o": theta_o, "delta_phi": delta_phi})

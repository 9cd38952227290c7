"""A grid in the plane of incidence."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from gonio.data.layouts.axes import THETA_I, AxisKind
from gonio.data.layouts.base import Angles, Layout, Trig
from gonio.data.layouts.nodes import node_numbers

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction

PLANE_WIDTH = 1e-6
"""|wo.y| in the plane's frame beyond which a direction is out of the plane of incidence."""
SIGNED_THETA_O = AxisKind(
    "theta_o",
    "polar angle of the detector, positive on the specular side, negative on the light's",
    -math.pi,
    math.pi,
)


class InPlaneGrid(Layout):
    """Axes theta_i and a signed theta_o, positive on the specular side (delta_phi = π), negative on the light's."""

    name = "in_plane"
    axis_kinds = (THETA_I, SIGNED_THETA_O)
    in_one_plane = True

    @staticmethod
    def pair(trig: Trig) -> tuple["Direction", "Direction"]:
        from gonio.models.geometry.directions import Direction

        (ci, si), (co, so) = trig
        return Direction(si, 0.0, ci), Direction(-so, 0.0, co)

    @staticmethod
    def coordinates(wi: "Direction", wo: "Direction") -> dict[str, Any]:
        import jax.numpy as jnp

        from gonio.models.geometry.directions import to_spherical

        theta_i, theta_o = to_spherical(wi)[0], to_spherical(wo)[0]
        cos_delta = wi.x * wo.x + wi.y * wo.y
        return {"theta_i": theta_i, "theta_o": jnp.where(cos_delta > 0, -theta_o, theta_o)}

    @staticmethod
    def covers(wi: "Direction", wo: "Direction") -> Any:
        """Whether a pair of directions lies in a plane through the normal (JAX)."""
        import jax.numpy as jnp

        across = jnp.abs(wi.x * wo.y - wi.y * wo.x)
        sin_i = jnp.sqrt(wi.x**2 + wi.y**2)
        return (across <= PLANE_WIDTH * sin_i) | (sin_i <= PLANE_WIDTH)

    def angles(self, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, ...]:
        theta_i, signed = self._axis_angles(start, stop)
        return theta_i, np.zeros_like(theta_i), np.abs(signed), np.where(signed > 0, np.pi, 0.0)

    def exchanged(self, cells: np.ndarray) -> np.ndarray:
        i, o = np.unravel_index(cells, self.shape)
        theta_i, signed = self.axes["theta_i"][i], self.axes["theta_o"][o]
        light = node_numbers(self.axes["theta_i"], np.abs(signed))
        detector = node_numbers(self.axes["theta_o"], np.where(signed < 0, -theta_i, theta_i))
        return np.where((light >= 0) & (detector >= 0), light * self.row_size + detector, -1)


def in_plane(theta_i: Angles, theta_o: Angles) -> InPlaneGrid:
    """A grid in the plane of incidence; `theta_o` is signed, positive on the specular side; radians."""
    return InPlaneGrid({"theta_i": theta_i, "theta_o": theta_o})

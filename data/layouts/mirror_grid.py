"""A grid about the mirror direction, as ASTM E2387 and Zemax have it."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gonio.data.layouts.angle_layouts import THETA_I
from gonio.data.layouts.base import TURN, AxisKind, Layout, NodeMap, Pair, Trig, node_numbers, spacing

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction


class MirrorGrid(Layout):
    """Axes theta_i, theta_m and phi_m: the detector's angle from the mirror direction, and its azimuth about that.

    phi_m is 0 from the mirror direction towards the normal. The surface is taken as isotropic (phi_i = 0).
    """

    name = "mirror"
    axis_kinds = (
        THETA_I,
        AxisKind("theta_m", "angle of the detector from the mirror direction", 0.0, math.pi),
        AxisKind("phi_m", "azimuth of the detector about the mirror direction, 0 to the normal", 0.0, TURN, TURN),
    )
    pole_axes = (("theta_m", "phi_m"),)

    @property
    def mirrored_axes(self) -> tuple[str, ...]:
        return ("phi_m",) if self.axes["phi_m"][-1] <= np.pi * (1 + 1e-9) else ()

    @staticmethod
    def pair(trig: Trig) -> Pair:
        (ci, si), (cm, sm), (cp, sp) = trig
        # The mirror direction (−si, 0, ci), and across it (ci, 0, si) towards the normal.
        return (si, 0.0, ci), (ci * (sm * cp) - si * cm, sm * sp, ci * cm + si * (sm * cp))

    @staticmethod
    def coordinates(wi: "Direction", wo: "Direction") -> dict[str, Any]:
        import jax.numpy as jnp

        from gonio.models.geometry.directions import rotate_z, safe_atan2, to_spherical

        theta_i, phi_i = to_spherical(wi)
        o = rotate_z(wo, jnp.cos(phi_i), -jnp.sin(phi_i))
        sin_i, cos_i = jnp.sin(theta_i), jnp.cos(theta_i)
        along, up = cos_i * o.z - sin_i * o.x, cos_i * o.x + sin_i * o.z
        theta_m = safe_atan2(jnp.sqrt(jnp.maximum(up**2 + o.y**2, 0.0)), along)
        phi_m = safe_atan2(o.y, up)
        return {"theta_i": theta_i, "theta_m": theta_m, "phi_m": jnp.where(phi_m < 0, phi_m + TURN, phi_m)}

    def solid_angles(self, wi: "Direction", wo: "Direction") -> np.ndarray:
        """dωi dωo of the cells at these directions (n,), up to a factor: rings about the mirror direction."""
        theta_i = np.arctan2(np.hypot(wi.x, wi.y), wi.z)
        cos_m = wi.z * wo.z - wi.x * wo.x - wi.y * wo.y
        theta_m, axis, light = np.arccos(np.clip(cos_m, -1, 1)), self.axes["theta_m"], self.axes["theta_i"]
        least = np.sin(axis[1] / 4) if axis.size > 1 and axis[0] == 0 else 0.0
        ring = np.maximum(np.sin(theta_m), least) * spacing(axis, theta_m)
        return np.maximum(np.sin(theta_i), 1e-3) * spacing(light, theta_i) * ring

    def mirror_map(self) -> NodeMap | None:
        if self.mirrored_axes:
            return None
        phi_m = self.axes["phi_m"]
        return [*self._same_nodes()[:2], (2, node_numbers(phi_m, -phi_m, TURN))]


def mirror(theta_i: ArrayLike, theta_m: ArrayLike, phi_m: ArrayLike) -> MirrorGrid:
    """A grid about the mirror direction; radians."""
    return MirrorGrid({"theta_i": theta_i, "theta_m": theta_m, "phi_m": phi_m})

"""Grids about the mirror direction, as ASTM E2387 and Zemax have it, or about the direction straight through."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gonio.data.layouts.angle_layouts import PHI_I, THETA_I
from gonio.data.layouts.base import TURN, AxisKind, Layout, NodeMap, Pair, Trig, node_numbers, spacing
from gonio.models.geometry.sides import HORIZON, Sides, side

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction


class MirrorGrid(Layout):
    """Axes theta_i, theta_m and phi_m: the detector's angle from the mirror direction, and its azimuth about that.

    phi_m is 0 from the mirror direction towards the normal, and counter-clockwise as seen from outside. phi_i is the
    azimuth of the light; without it the surface is taken as isotropic (phi_i = 0).
    """

    name = "mirror"
    axis_kinds = (
        THETA_I,
        AxisKind("theta_m", "angle of the detector from the mirror direction", 0.0, math.pi),
        AxisKind("phi_m", "azimuth of the detector about the mirror direction, 0 to the normal", 0.0, TURN, TURN),
        PHI_I,
    )
    optional_axes = frozenset({"phi_i"})
    pole_axes = (("theta_m", "phi_m"),)
    turning_axes = ("phi_i",)

    @property
    def mirrored_axes(self) -> tuple[str, ...]:
        return ("phi_m",) if self.axes["phi_m"][-1] <= np.pi * (1 + 1e-9) else ()

    @staticmethod
    def pair(trig: Trig) -> Pair:
        (ci, si), (cm, sm), (cp, sp), *turn = trig
        # The mirror direction (−si, 0, ci), and across it (ci, 0, si) towards the normal.
        wi, wo = (si, 0.0, ci), (ci * (sm * cp) - si * cm, sm * sp, ci * cm + si * (sm * cp))
        if not turn:
            return wi, wo
        c, s = turn[0]
        return (si * c, si * s, ci), (wo[0] * c - wo[1] * s, wo[0] * s + wo[1] * c, wo[2])

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
        phi_m = jnp.where(phi_m < 0, phi_m + TURN, phi_m)
        return {"theta_i": theta_i, "theta_m": theta_m, "phi_m": phi_m, "phi_i": phi_i}

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
        nodes = self._same_nodes()
        nodes[2] = (2, node_numbers(self.axes["phi_m"], -self.axes["phi_m"], TURN))
        if (phi_i := self.axes.get("phi_i")) is not None:
            nodes[3] = (3, node_numbers(phi_i, 2 * phi_i[0] - phi_i, TURN))
        return nodes


class StraightGrid(MirrorGrid):
    """The same behind the sample: theta_m and phi_m are about the direction straight through, mirrored to the front.

    Cells that the grid has in front of the sample cannot be read.
    """

    name = "straight"
    sees_behind = True

    @property
    def sides(self) -> Sides:
        """Light in front of the sample, the detector behind."""
        return frozenset({(1, -1)})

    @staticmethod
    def pair(trig: Trig) -> Pair:
        wi, (x, y, z) = MirrorGrid.pair(trig)
        return wi, (x, y, -z)

    @staticmethod
    def coordinates(wi: "Direction", wo: "Direction") -> dict[str, Any]:
        return MirrorGrid.coordinates(wi, wo._replace(z=-wo.z))

    def are_readable(self, cos_i: np.ndarray, cos_o: np.ndarray) -> np.ndarray:
        return (cos_i > HORIZON) & (side(cos_o) < 0)

    def folded(self, light: int, detector: int) -> tuple[Layout, tuple[Any, ...]]:
        return MirrorGrid(self.axes), np.ix_(*(np.arange(n) for n in self.shape))

    def solid_angles(self, wi: "Direction", wo: "Direction") -> np.ndarray:
        return super().solid_angles(wi, wo._replace(z=-wo.z))


def mirror(theta_i: ArrayLike, theta_m: ArrayLike, phi_m: ArrayLike, phi_i: ArrayLike | None = None) -> MirrorGrid:
    """A grid about the mirror direction, `phi_i` only for anisotropic surfaces; radians."""
    return MirrorGrid(_axes(theta_i, theta_m, phi_m, phi_i))


def straight(theta_i: ArrayLike, theta_m: ArrayLike, phi_m: ArrayLike, phi_i: ArrayLike | None = None) -> StraightGrid:
    """A grid behind the sample about the direction straight through, `phi_i` for anisotropic samples; radians."""
    return StraightGrid(_axes(theta_i, theta_m, phi_m, phi_i))


def _axes(theta_i: ArrayLike, theta_m: ArrayLike, phi_m: ArrayLike, phi_i: ArrayLike | None) -> dict[str, ArrayLike]:
    axes = {"theta_i": theta_i, "theta_m": theta_m, "phi_m": phi_m}
    return axes if phi_i is None else {**axes, "phi_i": phi_i}

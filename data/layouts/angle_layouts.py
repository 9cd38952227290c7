"""Layouts by the angles of both directions: grids over the hemispheres, and samples without a grid."""

import abc
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gonio.data.layouts.base import SAME, TURN, AxisKind, Layout, NodeMap, OutgoingGrid, Pair, Trig, node_numbers

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction

THETA_I = AxisKind("theta_i", "polar angle of the direction to the light", 0.0, math.pi)
PHI_I = AxisKind("phi_i", "azimuth of the direction to the light", 0.0, TURN, TURN)
THETA_O = AxisKind("theta_o", "polar angle of the direction to the detector", 0.0, math.pi)
PHI_O = AxisKind("phi_o", "azimuth of the direction to the detector", 0.0, TURN, TURN)
DELTA_PHI = AxisKind("delta_phi", "azimuth of the detector minus that of the light, specular at pi", 0.0, TURN, TURN)
PLANE_WIDTH = 1e-6
"""|wo.y| in the plane's frame beyond which a direction is out of the plane of incidence."""
SIGNED_THETA_O = AxisKind(
    "theta_o", "polar angle of the detector, positive on the specular side, negative on the light's", -math.pi, math.pi
)


class _ByAngles(Layout):
    """A layout whose axes are the angles of the arms: they stand even at the pole, where directions have no azimuth."""

    @staticmethod
    @abc.abstractmethod
    def arm_angles(axes: list[np.ndarray]) -> tuple[np.ndarray, ...]:
        """(theta_i, phi_i, theta_o, phi_o) of cells by their angles on each axis; radians."""

    def angles(self, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, ...]:
        if not self.gridded:
            return self.arm_angles([a[start:stop] for a in self.axes.values()])
        return self.angles_at(np.arange(*self._range(start, stop)))

    def angles_at(self, cells: np.ndarray) -> tuple[np.ndarray, ...]:
        nodes = np.unravel_index(cells, self.shape) if self.gridded else [cells] * len(self.axes)
        return self.arm_angles([a[k] for a, k in zip(self.axes.values(), nodes, strict=True)])


class _FourAngles(_ByAngles):
    sees_behind = True
    axis_kinds = (THETA_I, PHI_I, THETA_O, PHI_O)

    @staticmethod
    def pair(trig: Trig) -> Pair:
        (ci, si), (ca, sa), (co, so), (cb, sb) = trig
        return (si * ca, si * sa, ci), (so * cb, so * sb, co)

    @staticmethod
    def coordinates(wi: "Direction", wo: "Direction") -> dict[str, Any]:
        from gonio.models.geometry.directions import to_spherical

        return dict(zip(("theta_i", "phi_i", "theta_o", "phi_o"), (*to_spherical(wi), *to_spherical(wo)), strict=True))

    @staticmethod
    def arm_angles(axes: list[np.ndarray]) -> tuple[np.ndarray, ...]:
        return tuple(axes)


class ScatteredSamples(_FourAngles):
    """Samples at any directions: one dimension, "sample"; the axes hold the four angles of each."""

    name = "scattered"
    gridded = False

    def cosines(self, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        first, last = self._range(start, stop)
        cos_i, cos_o = (np.cos(self.axes[name][first:last]) for name in ("theta_i", "theta_o"))
        return cos_i, cos_o


class FrontSamples(ScatteredSamples):
    """Samples of the front alone, of which a warp has carried some below the horizon."""

    sees_behind = False


class SphericalGrid(_FourAngles):
    """Axes theta_i, phi_i, theta_o, phi_o."""

    name = "spherical"
    pole_axes = (("theta_i", "phi_i"), ("theta_o", "phi_o"))
    turning_axes = ("phi_i", "phi_o")

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


class IsotropicGrid(_ByAngles):
    """Axes theta_i, theta_o and delta_phi = phi_o − phi_i in [0, 2π), specular at π (phi_i = 0)."""

    name = "isotropic"
    sees_behind = True
    axis_kinds = (THETA_I, THETA_O, DELTA_PHI)
    pole_axes = (("theta_i", "delta_phi"), ("theta_o", "delta_phi"))

    @property
    def mirrored_axes(self) -> tuple[str, ...]:
        return ("delta_phi",) if self.axes["delta_phi"][-1] <= np.pi + SAME else ()

    @staticmethod
    def pair(trig: Trig) -> Pair:
        (ci, si), (co, so), (cp, sp) = trig
        return (si, 0.0, ci), (so * cp, so * sp, co)

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

    @staticmethod
    def arm_angles(axes: list[np.ndarray]) -> tuple[np.ndarray, ...]:
        theta_i, theta_o, delta_phi = axes
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


class InPlaneGrid(_ByAngles):
    """Axes theta_i and a signed theta_o, positive on the specular side (delta_phi = π), negative on the light's.

    Behind the sample too: of what goes straight through, theta_o is π − theta_i.
    """

    name = "in_plane"
    sees_behind = True
    axis_kinds = (THETA_I, SIGNED_THETA_O)
    in_one_plane = True

    @staticmethod
    def pair(trig: Trig) -> Pair:
        (ci, si), (co, so) = trig
        return (si, 0.0, ci), (-so, 0.0, co)

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

    @staticmethod
    def arm_angles(axes: list[np.ndarray]) -> tuple[np.ndarray, ...]:
        theta_i, signed = axes
        return theta_i, np.zeros_like(theta_i), np.abs(signed), np.where(signed > 0, np.pi, 0.0)

    def exchanged(self, cells: np.ndarray) -> np.ndarray:
        i, o = np.unravel_index(cells, self.shape)
        theta_i, signed = self.axes["theta_i"][i], self.axes["theta_o"][o]
        light = node_numbers(self.axes["theta_i"], np.abs(signed))
        detector = node_numbers(self.axes["theta_o"], np.where(signed < 0, -theta_i, theta_i))
        return np.where((light >= 0) & (detector >= 0), light * self.row_size + detector, -1)


def spherical(theta_i: ArrayLike, phi_i: ArrayLike, theta_o: ArrayLike, phi_o: ArrayLike) -> SphericalGrid:
    """A grid over both hemispheres; radians."""
    return SphericalGrid({"theta_i": theta_i, "phi_i": phi_i, "theta_o": theta_o, "phi_o": phi_o})


def isotropic(theta_i: ArrayLike, theta_o: ArrayLike, delta_phi: ArrayLike) -> IsotropicGrid:
    """A grid over both polar angles and delta_phi = phi_o − phi_i (specular at π); radians."""
    return IsotropicGrid({"theta_i": theta_i, "theta_o": theta_o, "delta_phi": delta_phi})


def in_plane(theta_i: ArrayLike, theta_o: ArrayLike) -> InPlaneGrid:
    """A grid in the plane of incidence; `theta_o` is signed, positive on the specular side; radians."""
    return InPlaneGrid({"theta_i": theta_i, "theta_o": theta_o})


def scattered(theta_i: ArrayLike, phi_i: ArrayLike, theta_o: ArrayLike, phi_o: ArrayLike) -> ScatteredSamples:
    """Samples anywhere: four lists of one length; radians, azimuths in [0, 2π)."""
    return ScatteredSamples({"theta_i": theta_i, "phi_i": phi_i, "theta_o": theta_o, "phi_o": phi_o})


def front_samples(theta_i: ArrayLike, phi_i: ArrayLike, theta_o: ArrayLike, phi_o: ArrayLike) -> FrontSamples:
    """The same of the front alone: what a warp has carried below the horizon is no transmission."""
    return FrontSamples({"theta_i": theta_i, "phi_i": phi_i, "theta_o": theta_o, "phi_o": phi_o})

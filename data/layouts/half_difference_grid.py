"""A grid over half and difference angles [Rusinkiewicz 1998], MERL's among them."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gonio.data.layouts.base import TURN, AxisKind, Layout, NodeMap, Pair, Trig, node_numbers, spacing
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction
    from gonio.models.geometry.half_vector import HalfAngles


class HalfDifferenceGrid(Layout):
    """Axes theta_h, theta_d, phi_d and, for anisotropic surfaces, phi_h (0 if absent).

    phi_d is the azimuth of `wi` in the half vector's frame, over [0, π) where phi_d and phi_d + π are one by
    reciprocity, or over [0, 2π).
    """

    name = "half_difference"
    axis_kinds = (
        AxisKind("theta_h", "polar angle of the half vector", 0.0, math.pi / 2, quadratic=True),
        AxisKind("theta_d", "angle between the light and the half vector", 0.0, math.pi / 2),
        AxisKind("phi_d", "azimuth of the light in the half vector's frame", 0.0, TURN, TURN),
        AxisKind("phi_h", "azimuth of the half vector", 0.0, TURN, TURN),
    )
    optional_axes = frozenset({"phi_h"})
    in_half_vectors = True
    pole_axes = (("theta_d", "phi_d"),)
    turning_axes = ("phi_h",)

    @property
    def has_azimuth_of_light(self) -> bool:
        return "phi_h" in self.axes and self.axes["phi_h"].size > 1

    @property
    def reciprocal_by_construction(self) -> bool:
        return bool(self.axes["phi_d"][-1] <= math.pi * (1 + 1e-12))

    @property
    def periods(self) -> dict[str, float | None]:
        return super().periods | {"phi_d": math.pi if self.reciprocal_by_construction else TURN}

    @staticmethod
    def pair(trig: Trig) -> Pair:
        from gonio.models.geometry.directions import pair_from_half_difference_trig, rotate_z

        (ch, sh), (cd, sd), (cp, sp), *turn = trig
        wi, wo = pair_from_half_difference_trig(ch, sh, cd, sd, cp, sp)
        return (rotate_z(wi, *turn[0]), rotate_z(wo, *turn[0])) if turn else (wi, wo)

    @staticmethod
    def half_angles(trig: Trig) -> "HalfAngles":
        from gonio.models.geometry.directions import Direction, rotate_z
        from gonio.models.geometry.half_vector import HalfAngles

        (ch, sh), (cd, _), _, *turn = trig
        h = Direction(sh, 0.0, ch)
        return HalfAngles(rotate_z(h, *turn[0]) if turn else h, abs(cd), sh * sh)

    @staticmethod
    def coordinates(wi: "Direction", wo: "Direction") -> dict[str, Any]:
        from gonio.models.geometry.directions import to_half_difference

        return dict(zip(("theta_h", "phi_h", "theta_d", "phi_d"), to_half_difference(wi, wo), strict=True))

    def solid_angles(self, wi: "Direction", wo: "Direction") -> np.ndarray:
        """dωi dωo = 4 cosθd dωh dωd [Walter 2007, eq. 14] of the cells at these directions (n,), up to a factor."""
        theta_h_axis, theta_d_axis = self.axes["theta_h"], self.axes["theta_d"]
        plus, minus = ([a + s * b for a, b in zip(wi, wo, strict=True)] for s in (1, -1))
        theta_h = np.arctan2(np.hypot(plus[0], plus[1]), plus[2])
        theta_d = np.arctan2(*(np.sqrt(sum(c * c for c in v)) for v in (minus, plus)))
        h = np.maximum(np.sin(theta_h), np.sin(theta_h_axis[1:2] / 2).sum()) * spacing(theta_h_axis, theta_h)
        d = np.maximum(np.sin(theta_d), np.sin(theta_d_axis[1:2] / 2).sum()) * np.cos(theta_d)
        return h * d * spacing(theta_d_axis, theta_d)

    def exchange_map(self) -> NodeMap | None:
        if self.reciprocal_by_construction:
            return None
        nodes, phi_d = self._same_nodes(), self.axes["phi_d"]
        nodes[2] = (2, node_numbers(phi_d, phi_d + np.pi, TURN))
        return nodes

    def mirror_map(self) -> NodeMap:
        nodes = self._same_nodes()
        for k, (name, period) in list(enumerate(self.periods.items()))[2:]:
            nodes[k] = (k, node_numbers(self.axes[name], -self.axes[name], period))
        return nodes

    def _cosines_of(self, trig: Trig) -> tuple[np.ndarray, np.ndarray]:
        (ch, sh), (cd, sd), (cp, _), *_ = trig
        up, across = ch * cd, sh * (sd * cp)
        return up - across, up + across


def half_difference(
    theta_h: ArrayLike, theta_d: ArrayLike, phi_d: ArrayLike, phi_h: ArrayLike | None = None
) -> HalfDifferenceGrid:
    """A grid over Rusinkiewicz's half/difference angles, `phi_h` only for anisotropic surfaces; radians."""
    axes = {"theta_h": theta_h, "theta_d": theta_d, "phi_d": phi_d}
    return HalfDifferenceGrid(axes if phi_h is None else {**axes, "phi_h": phi_h})


def merl(
    nodes: str = "lower", counts: tuple[int, int, int] = (90, 90, 180), phi_d_range: float = math.pi
) -> HalfDifferenceGrid:
    """MERL's half/difference grid [Matusik 2003]: theta_h = (i/90)²·90°, theta_d and phi_d in equal steps.

    `nodes`: a node is its bin's "lower" edge (the original code's look-up) or its "centre" (ALTA's reading).
    """
    if nodes not in ("lower", "centre"):
        raise GonioError(f"MERL nodes {nodes!r} are unknown; expected 'lower' (the default) or 'centre'")
    shift = 0.0 if nodes == "lower" else 0.5
    h, d, p = ((np.arange(n) + shift) / n for n in counts)
    return half_difference(h**2 * math.pi / 2, d * math.pi / 2, p * phi_d_range)

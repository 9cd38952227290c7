"""Where the cells of a table are: the five layouts, their axes and the directions of every cell.

Conventions as in `gonio.models.geometry.directions`: radians, +z the normal, `wi` to the light, `wo` to the detector.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction

AXES = {
    "spherical": ("theta_i", "phi_i", "theta_o", "phi_o"),
    "isotropic": ("theta_i", "theta_o", "delta_phi"),
    "half_difference": ("theta_h", "theta_d", "phi_d", "phi_h"),
    "in_plane": ("theta_i", "theta_o"),
    "scattered": ("theta_i", "phi_i", "theta_o", "phi_o"),
}
HORIZON = 1e-12
"""A cosine up to this is at the horizon: cos(π/2) is 6e-17 in float64, not 0."""

Angles = Sequence[float] | np.ndarray


@dataclasses.dataclass(frozen=True, eq=False)
class Layout:
    """The cells of a table: a name out of `AXES` and its axes, float64 radians, in the dimensions' order.

    Gridded layouts have one dimension an axis, strictly increasing; the cells are numbered in C order. A
    scattered layout has the one dimension "sample", and its four axes are the angles of each sample.

    - spherical: theta_i, phi_i, theta_o, phi_o
    - isotropic: theta_i, theta_o, delta_phi = phi_o − phi_i in [0, 2π), specular at π (phi_i = 0)
    - half_difference: theta_h, theta_d, phi_d and, for anisotropic surfaces, phi_h (0 if absent); phi_d is
      the azimuth of wi in the half vector's frame, over [0, π) where phi_d and phi_d + π are one by
      reciprocity, or over [0, 2π)
    - in_plane: theta_i and a signed theta_o, positive on the specular side (delta_phi = π), negative on the
      light's

    Domain: polar angles in [0, π] (theta_h, theta_d in [0, π/2]; in_plane theta_o in [−π, π]), azimuths in
    [0, 2π).
    Raises GonioError where an axis is missing, empty, not finite, out of its domain or out of order.
    """

    name: str
    axes: dict[str, np.ndarray]

    def __post_init__(self):
        if self.name not in AXES:
            raise GonioError(f"layout {self.name!r} is unknown; expected one of {', '.join(AXES)}")
        names = AXES[self.name]
        if set(self.axes) not in ({*names}, {*names} - {"phi_h"}):
            raise GonioError(f"layout {self.name} has axes {', '.join(self.axes)}; give it {', '.join(names)}")
        axes = {n: _axis(self.name, n, self.axes[n]) for n in names if n in self.axes}
        if self.name == "scattered" and len({a.size for a in axes.values()}) > 1:
            sizes = ", ".join(f"{n} {a.size}" for n, a in axes.items())
            raise GonioError(f"a scattered layout needs axes of one length, but they have {sizes} angles")
        object.__setattr__(self, "axes", axes)

    def __eq__(self, other):
        if not isinstance(other, Layout):
            return NotImplemented
        same = self.name == other.name and self.axes.keys() == other.axes.keys()
        return same and all(np.array_equal(a, other.axes[n]) for n, a in self.axes.items())

    def __hash__(self):
        return hash((self.name, self.shape))

    @property
    def gridded(self) -> bool:
        """Whether the cells stand on a grid of axes (all layouts but scattered)."""
        return self.name != "scattered"

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the dimensions, without the channel."""
        return tuple(self.axes) if self.gridded else ("sample",)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of cells along each dimension, without the channel."""
        sizes = tuple(a.size for a in self.axes.values())
        return sizes if self.gridded else sizes[:1]

    @property
    def size(self) -> int:
        """Number of cells."""
        return math.prod(self.shape)

    @property
    def row_size(self) -> int:
        """Number of cells at one node of the leading dimension."""
        return math.prod(self.shape[1:])

    @property
    def phi_d_period(self) -> float | None:
        """π where the axis phi_d stays within [0, π] (reciprocal data), else 2π; None for other layouts."""
        if self.name != "half_difference":
            return None
        return math.pi if self.axes["phi_d"][-1] <= math.pi * (1 + 1e-12) else 2 * math.pi

    def directions(self, start: int = 0, stop: int | None = None) -> tuple["Direction", "Direction"]:
        """(wi, wo) of the cells start..stop in C order: components of shape (stop − start,), float64."""
        start, stop = self._range(start, stop)
        if not self.gridded or stop - start < self.row_size:
            return self.directions_at(np.arange(start, stop))
        from gonio.models.geometry.directions import Direction

        flat = self._on_rows(start, stop, lambda trig: [c for w in self._pair(trig) for c in w])
        return Direction(*flat[:3]), Direction(*flat[3:])

    def directions_at(self, cells: np.ndarray) -> tuple["Direction", "Direction"]:
        """(wi, wo) of the cells of these C-order numbers, shape (n,): components of shape (n,), float64."""
        from gonio.models.geometry.directions import Direction

        if self.gridded:
            at = np.unravel_index(cells, self.shape)
            trig = [(np.cos(a)[k], np.sin(a)[k]) for a, k in zip(self.axes.values(), at, strict=True)]
        else:
            trig = [(np.cos(a[cells]), np.sin(a[cells])) for a in self.axes.values()]
        wi, wo = self._pair(trig)
        shape = np.shape(cells)
        return Direction(*(np.broadcast_to(c, shape) for c in wi)), Direction(*(np.broadcast_to(c, shape) for c in wo))

    def angles(self, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, ...]:
        """(theta_i, phi_i, theta_o, phi_o) of the cells start..stop, radians; azimuths in [0, 2π)."""
        start, stop = self._range(start, stop)
        if self.name == "scattered":
            return tuple(a[start:stop] for a in self.axes.values())
        if self.name == "half_difference":
            return tuple(angle for w in self.directions(start, stop) for angle in spherical_angles(*w))
        at = np.unravel_index(np.arange(start, stop), self.shape)
        angle = {n: a[k] for (n, a), k in zip(self.axes.items(), at, strict=True)}
        zero = np.zeros(stop - start)
        if self.name == "isotropic":
            return angle["theta_i"], zero, angle["theta_o"], angle["delta_phi"]
        if self.name == "in_plane":
            signed = angle["theta_o"]
            return angle["theta_i"], zero, np.abs(signed), np.where(signed > 0, np.pi, 0.0)
        return tuple(angle.values())

    def cosines(self, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(cos theta_i, cos theta_o) of the cells start..stop, shape (stop − start,)."""
        start, stop = self._range(start, stop)
        if self.gridded and stop - start >= self.row_size:
            return self._on_rows(start, stop, self._z_of_pair)
        if self.name == "scattered":
            return np.cos(self.axes["theta_i"][start:stop]), np.cos(self.axes["theta_o"][start:stop])
        wi, wo = self.directions_at(np.arange(start, stop))
        return wi.z, wo.z

    def above_horizon(self, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Whether both directions of the cells start..stop are above the horizon (cosine > `HORIZON`)."""
        cos_i, cos_o = self.cosines(start, stop)
        return (cos_i > HORIZON) & (cos_o > HORIZON)

    def _range(self, start, stop):
        return slice(start, stop).indices(self.size)[:2]

    def _on_rows(self, start, stop, function):
        """Flat results of a function of the axes' trigonometry, evaluated on whole rows: no index is gathered."""
        row = self.row_size
        first, last = start // row, -(-stop // row)
        shape = (last - first, *self.shape[1:])
        cut = slice(start - first * row, stop - first * row)
        return tuple(np.broadcast_to(c, shape).reshape(-1)[cut] for c in function(self._row_trig(first, last)))

    def _z_of_pair(self, trig):
        if self.name == "half_difference":
            (ch, sh), (cd, sd), (cp, _), *_ = trig
            up, across = ch * cd, sh * (sd * cp)
            return up - across, up + across
        return trig[0][0], trig[1 if self.name in ("isotropic", "in_plane") else 2][0]

    def _row_trig(self, first: int, last: int):
        shaped = []
        for k, a in enumerate(self.axes.values()):
            angle = (a[first:last] if k == 0 else a).reshape([-1 if j == k else 1 for j in range(len(self.axes))])
            shaped.append((np.cos(angle), np.sin(angle)))
        return shaped

    def _pair(self, trig):
        from gonio.models.geometry.directions import Direction, pair_from_half_difference_trig, rotate_z

        if self.name == "half_difference":
            (ch, sh), (cd, sd), (cp, sp), *turn = trig
            wi, wo = pair_from_half_difference_trig(ch, sh, cd, sd, cp, sp)
            return (rotate_z(wi, *turn[0]), rotate_z(wo, *turn[0])) if turn else (wi, wo)
        if self.name == "isotropic":
            (ci, si), (co, so), (cp, sp) = trig
            return Direction(si, 0.0, ci), Direction(so * cp, so * sp, co)
        if self.name == "in_plane":
            (ci, si), (co, so) = trig
            return Direction(si, 0.0, ci), Direction(-so, 0.0, co)
        (ci, si), (ca, sa), (co, so), (cb, sb) = trig
        return Direction(si * ca, si * sa, ci), Direction(so * cb, so * sb, co)


def _axis(layout: str, name: str, values: Angles) -> np.ndarray:
    try:
        axis = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise GonioError(f"axis {name} of a {layout} layout is not a list of numbers; give angles in radians") from None
    what = f"axis {name} of a {layout} layout"
    if axis.ndim != 1 or axis.size == 0:
        raise GonioError(f"{what} has shape {axis.shape}; give a list of at least one angle")
    low, high = _domain(layout, name)
    bad = ~((axis >= low - 1e-12) & (axis <= high + 1e-12))
    if bad.any():
        first = axis[bad][0]
        raise GonioError(
            f"{what} has the angle {first:.6g} rad, outside {low:.6g} to {high:.6g}; give radians in there"
        )
    if layout != "scattered" and not (np.diff(axis) > 0).all():
        raise GonioError(f"{what} is not strictly increasing; sort its angles and drop doubles")
    axis.setflags(write=False)
    return axis


def _domain(layout: str, name: str) -> tuple[float, float]:
    if name in ("theta_h", "theta_d"):
        return 0.0, math.pi / 2
    if name.startswith("theta"):
        return (-math.pi if layout == "in_plane" and name == "theta_o" else 0.0), math.pi
    return 0.0, 2 * math.pi


def spherical_angles(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(theta in [0, π], phi in [0, 2π)), radians, of directions by their components (NumPy)."""
    phi = np.arctan2(y, x) % (2 * np.pi)
    return np.arctan2(np.hypot(x, y), z), np.where(phi >= 2 * np.pi, 0.0, phi)


def spherical(theta_i: Angles, phi_i: Angles, theta_o: Angles, phi_o: Angles) -> Layout:
    """A grid over both hemispheres; radians."""
    return Layout("spherical", {"theta_i": theta_i, "phi_i": phi_i, "theta_o": theta_o, "phi_o": phi_o})


def isotropic(theta_i: Angles, theta_o: Angles, delta_phi: Angles) -> Layout:
    """A grid over both polar angles and delta_phi = phi_o − phi_i (specular at π); radians."""
    return Layout("isotropic", {"theta_i": theta_i, "theta_o": theta_o, "delta_phi": delta_phi})


def half_difference(theta_h: Angles, theta_d: Angles, phi_d: Angles, phi_h: Angles | None = None) -> Layout:
    """A grid over Rusinkiewicz's half/difference angles, `phi_h` only for anisotropic surfaces; radians."""
    axes = {"theta_h": theta_h, "theta_d": theta_d, "phi_d": phi_d}
    return Layout("half_difference", axes if phi_h is None else {**axes, "phi_h": phi_h})


def in_plane(theta_i: Angles, theta_o: Angles) -> Layout:
    """A grid in the plane of incidence; `theta_o` is signed, positive on the specular side; radians."""
    return Layout("in_plane", {"theta_i": theta_i, "theta_o": theta_o})


def scattered(theta_i: Angles, phi_i: Angles, theta_o: Angles, phi_o: Angles) -> Layout:
    """Samples anywhere: four lists of one length; radians, azimuths in [0, 2π)."""
    return Layout("scattered", {"theta_i": theta_i, "phi_i": phi_i, "theta_o": theta_o, "phi_o": phi_o})


def merl(nodes: str = "lower", counts: tuple[int, int, int] = (90, 90, 180), phi_d_range: float = math.pi) -> Layout:
    """MERL's half/difference grid [Matusik 2003]: theta_h = (i/90)²·90°, theta_d and phi_d in equal steps.

    `nodes`: a node is its bin's "lower" edge (the original code's look-up) or its "centre" (ALTA's reading).
    """
    if nodes not in ("lower", "centre"):
        raise GonioError(f"MERL nodes {nodes!r} are unknown; expected 'lower' (the default) or 'centre'")
    shift = 0.0 if nodes == "lower" else 0.5
    h, d, p = ((np.arange(n) + shift) / n for n in counts)
    return half_difference(h**2 * math.pi / 2, d * math.pi / 2, p * phi_d_range)

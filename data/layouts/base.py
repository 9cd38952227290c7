"""What every layout of a table can tell of its cells: axes, directions, angles, and the cells that physics relates.

Conventions as in `gonio.models.geometry.directions`: radians, +z the normal, `wi` to the light, `wo` to the detector.
"""

import abc
import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from gonio.models.errors import GonioError
from gonio.models.geometry.sides import FRONT, HORIZON, Hemispheres, Sides, hemispheres_of, side

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction
    from gonio.models.geometry.half_vector import HalfAngles

TURN = 2 * math.pi
SAME = 1e-9
"""ArrayLike of nodes that differ by less than this many radians are one."""
MANY = 1 << 15
"""Cells whose directions are computed at a time: their intermediate values stay in a cache."""
Trig = Sequence[tuple[Any, Any]]
"""(cosine, sine) of the angles on each axis, arrays that broadcast."""
Pair = tuple[tuple[Any, Any, Any], tuple[Any, Any, Any]]
"""Components of wi and wo, arrays that broadcast."""
NodeMap = list[tuple[int, np.ndarray]]
"""For each dimension of the related cell: the dimension of the cell that decides it, and the node for each node."""


class AxisKind(NamedTuple):
    """One angle that cells are laid out by: its closed domain, radians, and its period if it is an azimuth."""

    name: str
    long_name: str
    low: float
    high: float
    period: float | None = None
    quadratic: bool = False
    """Whether grids often step evenly in the angle's square root."""


class OutgoingGrid(NamedTuple):
    """The directions of the detector that are the same for every incidence, and the incidences; radians."""

    theta_i: np.ndarray
    phi_i: np.ndarray
    theta_o: np.ndarray
    azimuth: np.ndarray
    """Azimuths of the detector, relative to the surface or, for `phi_i` = 0 alone, to the light."""


class Layout(abc.ABC):
    """The cells of a table: axes of angles, float64 radians, in the order of the dimensions.

    A gridded layout has one dimension an axis, strictly increasing; cells are numbered in C order. To add a layout:
    one subclass, imported in `gonio.data.layouts`, which the readers of files then know by its `name`.

    Raises GonioError where an axis is missing, empty, not finite, out of its domain or out of order.
    """

    name: ClassVar[str]
    """As in files."""
    axis_kinds: ClassVar[tuple[AxisKind, ...]]
    optional_axes: ClassVar[frozenset[str]] = frozenset()
    gridded: ClassVar[bool] = True
    """Whether the cells stand on a grid of axes."""
    sees_behind: ClassVar[bool] = False
    """Whether light and detector may be behind the sample: polar angles beyond a right angle; else such cells are what
    a grid has below the horizon, where nothing can be read."""
    in_one_plane: ClassVar[bool] = False
    """Whether all cells lie in the plane of incidence."""
    in_half_vectors: ClassVar[bool] = False
    """Whether the axes are half and difference angles [Rusinkiewicz 1998]."""
    turning_axes: ClassVar[tuple[str, ...]] = ()
    """The azimuths that change together when the sample is turned about its normal."""
    pole_axes: ClassVar[tuple[tuple[str, str], ...]] = ()
    """(polar angle, azimuth) whose azimuth has no meaning where the polar angle is 0 or π."""

    def __init__(self, axes: Mapping[str, ArrayLike]) -> None:
        names = [kind.name for kind in self.axis_kinds]
        if not set(names) - self.optional_axes <= set(axes) <= set(names):
            raise GonioError(f"layout {self.name} has axes {', '.join(axes)}; give it {', '.join(names)}")
        self.axes = {k.name: self._checked_axis(k, axes[k.name]) for k in self.axis_kinds if k.name in axes}
        sizes = tuple(a.size for a in self.axes.values())
        if not self.gridded and len(set(sizes)) > 1:
            listed = ", ".join(f"{n} {a.size}" for n, a in self.axes.items())
            raise GonioError(f"a {self.name} layout needs axes of one length, but they have {listed} angles")
        self.dims = tuple(self.axes) if self.gridded else ("sample",)
        """Names of the dimensions, without those of the values."""
        self.shape = sizes if self.gridded else sizes[:1]
        """Number of cells along each dimension."""
        self.size = math.prod(self.shape)
        """Number of cells."""
        self.row_size = math.prod(self.shape[1:])
        """Number of cells at one node of the leading dimension."""

    def __init_subclass__(cls) -> None:
        if "name" in vars(cls):
            LAYOUTS[cls.name] = cls

    def _checked_axis(self, kind: AxisKind, values: ArrayLike) -> np.ndarray:
        what = f"axis {kind.name} of a {self.name} layout"
        try:
            axis = np.array(values, dtype=np.float64)
        except (TypeError, ValueError):
            raise GonioError(f"{what} is not a list of numbers; give angles in radians") from None
        if axis.ndim != 1 or axis.size == 0:
            raise GonioError(f"{what} has shape {axis.shape}; give a list of at least one angle")
        outside = ~((axis >= kind.low - 1e-12) & (axis <= kind.high + 1e-12))
        if outside.any():
            domain = f"{kind.low:.6g} to {kind.high:.6g}"
            raise GonioError(
                f"{what} has the angle {axis[outside][0]:.6g} rad, outside {domain}; give radians in there"
            )
        if self.gridded and not (np.diff(axis) > 0).all():
            raise GonioError(f"{what} is not strictly increasing; sort its angles and drop doubles")
        axis.setflags(write=False)
        return axis

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Layout):
            return NotImplemented
        same = self.name == other.name and self.axes.keys() == other.axes.keys()
        return same and all(np.array_equal(a, other.axes[n]) for n, a in self.axes.items())

    def __hash__(self) -> int:
        return hash((self.name, *((n, a.tobytes()) for n, a in self.axes.items())))

    def __repr__(self) -> str:
        lines = [f"<{self.name} layout, {self.size} cells>"]
        for name, a in self.axes.items():
            lines.append(f"  {name:<10}{np.degrees(a.min()):.6g}° to {np.degrees(a.max()):.6g}°, {a.size} values")
        return "\n".join(lines)

    def part(self, **nodes: np.ndarray | slice) -> Self:
        """The layout of these nodes of some axes, by the axes' names, and of all nodes of the others."""
        return type(self)({name: axis[nodes.get(name, slice(None))] for name, axis in self.axes.items()})

    def pole_nodes(self, polar: str) -> list[int]:
        """Numbers of the nodes of a polar angle, of one of `pole_axes`, at which the azimuth has no meaning."""
        axis = self.axes[polar]
        return [k for k, pole in ((0, 0.0), (axis.size - 1, math.pi)) if abs(axis[k] - pole) <= SAME]

    @property
    def has_azimuth_of_light(self) -> bool:
        """Whether cells may differ by the light's azimuth about the surface's own x axis."""
        return "phi_i" in self.axes

    @property
    def reciprocal_by_construction(self) -> bool:
        """Whether one value is stored for a pair of directions and for the exchanged pair."""
        return False

    @property
    def one_light_azimuth(self) -> bool:
        """Whether the axis of the light's azimuth has one node only: the surface is taken as isotropic."""
        return self.gridded and "phi_i" in self.axes and self.axes["phi_i"].size == 1

    @property
    def mirrored_axes(self) -> tuple[str, ...]:
        """Azimuths that stop at π because the other half is taken as its mirror image."""
        return ()

    @property
    def periods(self) -> dict[str, float | None]:
        """The period of each axis, radians; None for polar angles and `mirrored_axes`."""
        mirrored = self.mirrored_axes
        return {k.name: None if k.name in mirrored else k.period for k in self.axis_kinds if k.name in self.axes}

    @staticmethod
    @abc.abstractmethod
    def pair(trig: Trig) -> Pair:
        """(wi, wo) by the cosines and sines of the axes' angles; NumPy or JAX, components that broadcast."""

    @staticmethod
    def half_angles(trig: Trig) -> "HalfAngles | None":
        """Half vector, cosθ_d and sin²θ_h of a cell by the same cosines and sines; None where axes do not tell."""
        return None

    @staticmethod
    @abc.abstractmethod
    def coordinates(wi: "Direction", wo: "Direction") -> dict[str, Any]:
        """The angles of one pair of unit directions, traced by JAX.

        Args:
            wi: direction of the light.
            wo: direction of the detector.

        Returns:
            The angle on each axis, radians, by its name; azimuths in [0, 2π).
        """

    @staticmethod
    def covers(wi: "Direction", wo: "Direction") -> Any:
        """Whether a pair of directions is among those that the layout can hold (JAX)."""
        return True

    def directions(self, start: int = 0, stop: int | None = None) -> tuple["Direction", "Direction"]:
        """(wi, wo) of the cells start..stop in C order: components of shape (stop − start,), float64."""
        return _directions(self._on_cells(self._components_of, start, stop))

    def directions_at(self, cells: np.ndarray) -> tuple["Direction", "Direction"]:
        """(wi, wo) of the cells of these C-order numbers, shape (n,): components of shape (n,), float64."""
        if np.ndim(cells) != 1 or np.size(cells) <= MANY:
            return _directions(np.broadcast_to(c, np.shape(cells)) for c in self._components_of(self._trig_at(cells)))
        components = np.empty((6, len(cells)))
        for some in (slice(first, first + MANY) for first in range(0, len(cells), MANY)):
            for c, part in zip(components, self._components_of(self._trig_at(cells[some])), strict=True):
                c[some] = part
        return _directions(components)

    def angles(self, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, ...]:
        """(theta_i, phi_i, theta_o, phi_o) of the cells start..stop, radians; azimuths in [0, 2π)."""
        return tuple(angle for w in self.directions(start, stop) for angle in spherical_angles(*w))

    def angles_at(self, cells: np.ndarray) -> tuple[np.ndarray, ...]:
        """(theta_i, phi_i, theta_o, phi_o) of the cells of these C-order numbers, shape (n,), as `angles` has them."""
        return tuple(angle for w in self.directions_at(cells) for angle in spherical_angles(*w))

    def cosines(self, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(cos theta_i, cos theta_o) of the cells start..stop, shape (stop − start,)."""
        cos_i, cos_o = self._on_cells(self._cosines_of, start, stop)
        return cos_i, cos_o

    @functools.cached_property
    def sides(self) -> Sides:
        """The sides of the sample on which light and detector are in its cells."""
        if not self.sees_behind:
            return FRONT
        light, detector = (side(np.cos(self.axes[name])) for name in ("theta_i", "theta_o"))
        if min(light.min(), detector.min()) >= 0:
            return FRONT
        codes = np.unique(3 * light[:, None] + detector if self.gridded else 3 * light + detector)
        pairs = ((int(code + 4) // 3 - 1, int(code + 4) % 3 - 1) for code in codes)
        return frozenset(pair for pair in pairs if all(pair)) or FRONT

    @property
    def hemispheres(self) -> Hemispheres:
        """The hemispheres, that of the light or the opposite one, in which the detector is in its cells."""
        return hemispheres_of(self.sides)

    def readable(self, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Whether the cells start..stop can be read, see `are_readable`."""
        return self.are_readable(*self.cosines(start, stop))

    def are_readable(self, cos_i: np.ndarray, cos_o: np.ndarray) -> np.ndarray:
        """Whether cells with these cosines of light and detector can be read: none of them lies on the horizon, nor
        behind the sample where the layout holds its front alone."""
        if self.sides == FRONT:
            return (cos_i > HORIZON) & (cos_o > HORIZON)
        return (side(cos_i) != 0) & (side(cos_o) != 0)

    def folded(self, light: int, detector: int) -> tuple["Layout", tuple[Any, ...]]:
        """(layout, index): the cells with light and detector on these sides, mirrored into the front hemisphere.

        `index` takes their values out of arrays of the shape of the layout.
        """
        polar: dict[str, int] = {"theta_i": light, "theta_o": detector}
        there = {name: side(np.cos(self.axes[name])) == s for name, s in polar.items()}
        upright = {n: a if polar.get(n, 1) > 0 else _mirrored(a) for n, a in self.axes.items()}
        if not self.gridded:
            cells = np.flatnonzero(np.all(list(there.values()), axis=0))
            return type(self)({n: a[cells] for n, a in upright.items()}), (cells,)
        axes, nodes = dict(upright), [np.arange(a.size) for a in upright.values()]
        for k, name in enumerate(axes):
            if name in there:
                kept = np.flatnonzero(there[name])
                axes[name], first = np.unique(upright[name][kept], return_index=True)
                nodes[k] = kept[first]
        return type(self)(axes), np.ix_(*nodes)

    def solid_angles(self, wi: "Direction", wo: "Direction") -> np.ndarray | None:
        """Sizes dωi dωo of cells, up to a common factor.

        Args:
            wi: unit directions of the light with components of shape (n,).
            wo: those of the detector.

        Returns:
            Array (n,), in which the rim of a grid counts half a step outwards; None where cells have no extent.
        """
        if not self.gridded:
            return None
        sizes = []
        for name, w in (("theta_i", wi), ("theta_o", wo)):
            theta, axis = np.arctan2(np.hypot(w.x, w.y), w.z), np.unique(np.abs(self.axes[name]))
            # A node at the pole stands for the cap around it, not for nothing.
            least = np.sin(axis[1] / 4) if axis.size > 1 and axis[0] == 0 else 0.0
            sizes.append(np.maximum(np.sin(theta), least) * spacing(axis, theta))
        return sizes[0] * sizes[1]

    def outgoing_grid(self) -> OutgoingGrid | None:
        """The detector's directions where they are the same for every incidence, which leads the dimensions."""
        return None

    def exchange_map(self) -> NodeMap | None:
        """The map to the cells with `wi` and `wo` exchanged; None where `reciprocal_by_construction`."""
        return [(k, np.full(n, -1)) for k, n in enumerate(self.shape)]

    def mirror_map(self) -> NodeMap | None:
        """The map to the cells mirrored at a plane through the normal; None where the cells lie on one side of it."""
        return None

    def exchanged(self, cells: np.ndarray) -> np.ndarray | None:
        """The numbers of the cells with `wi` and `wo` exchanged, −1 where the grid has none; None as `exchange_map`."""
        return self._mapped(cells, self.exchange_map())

    def mirrored(self, cells: np.ndarray) -> np.ndarray | None:
        """The numbers of the cells mirrored at a plane, −1 where the grid has none; None as `mirror_map`."""
        return self._mapped(cells, self.mirror_map())

    def turned(self, cells: np.ndarray, angle: float) -> np.ndarray:
        """The numbers of the cells with both directions turned by `angle`, radians; −1 where the grid has none."""
        nodes = self._same_nodes()
        for k, (name, axis) in enumerate(self.axes.items()):
            if name in self.turning_axes:
                nodes[k] = (k, node_numbers(axis, axis + angle, TURN))
        return self._mapped(cells, nodes)

    def _same_nodes(self) -> NodeMap:
        return [(k, np.arange(n)) for k, n in enumerate(self.shape)]

    def _mapped(self, cells: np.ndarray, node_map: NodeMap | None) -> Any:
        if node_map is None:
            return None
        nodes = np.unravel_index(cells, self.shape)
        related = [numbers[nodes[source]] for source, numbers in node_map]
        known = np.all([r >= 0 for r in related], axis=0)
        return np.where(known, np.ravel_multi_index([np.maximum(r, 0) for r in related], self.shape), -1)

    def _range(self, start: int, stop: int | None) -> tuple[int, int]:
        first, last, _ = slice(start, stop).indices(self.size)
        return first, last

    def _trig_at(self, cells: np.ndarray) -> Trig:
        if not self.gridded:
            return [(np.cos(a[cells]), np.sin(a[cells])) for a in self.axes.values()]
        nodes = np.unravel_index(cells, self.shape)
        return [(np.cos(a)[k], np.sin(a)[k]) for a, k in zip(self.axes.values(), nodes, strict=True)]

    def _on_cells(
        self, function: Callable[[Trig], Sequence[np.ndarray]], start: int, stop: int | None
    ) -> tuple[np.ndarray, ...]:
        """Flat results of a function of the axes' trigonometry; whole rows are evaluated without an index."""
        start, stop = self._range(start, stop)
        if not self.gridded:
            trig = [(np.cos(a[start:stop]), np.sin(a[start:stop])) for a in self.axes.values()]
            return tuple(np.broadcast_to(c, stop - start) for c in function(trig))
        if stop - start < self.row_size:
            return tuple(np.broadcast_to(c, stop - start) for c in function(self._trig_at(np.arange(start, stop))))
        first, last = start // self.row_size, -(-stop // self.row_size)
        leading, *others = self.axes.values()
        angles = np.ix_(leading[first:last], *others)
        cut = slice(start - first * self.row_size, stop - first * self.row_size)
        shape = (last - first, *self.shape[1:])
        results = function([(np.cos(a), np.sin(a)) for a in angles])
        return tuple(np.broadcast_to(c, shape).reshape(-1)[cut] for c in results)

    def _components_of(self, trig: Trig) -> Sequence[np.ndarray]:
        wi, wo = self.pair(trig)
        return *wi, *wo

    def _cosines_of(self, trig: Trig) -> tuple[np.ndarray, np.ndarray]:
        (*_, cos_i), (*_, cos_o) = self.pair(trig)
        return cos_i, cos_o


LAYOUTS: dict[str, type[Layout]] = {}
"""The layouts by the names that files have for them."""


def _directions(components: Iterable[np.ndarray]) -> tuple["Direction", "Direction"]:
    from gonio.models.geometry.directions import Direction

    x_i, y_i, z_i, x_o, y_o, z_o = components
    return Direction(x_i, y_i, z_i), Direction(x_o, y_o, z_o)


def node_numbers(axis: np.ndarray, angles: np.ndarray, period: float | None = None) -> np.ndarray:
    """Number of the node of an increasing axis at each angle (modulo the period), or −1 where there is none."""
    if period is not None:
        angles = np.mod(angles - axis[0] + SAME, period) + axis[0] - SAME
    upper = np.clip(np.searchsorted(axis, angles), 1, max(axis.size - 1, 1))
    low, high = upper - 1, np.minimum(upper, axis.size - 1)
    nearest = np.where(np.abs(axis[low] - angles) <= np.abs(axis[high] - angles), low, high)
    return np.where(np.abs(axis[nearest] - angles) <= SAME, nearest, -1)


def spherical_angles(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(theta in [0, π], phi in [0, 2π)), radians, of directions by their components (NumPy)."""
    phi = np.arctan2(y, x) % (2 * np.pi)
    return np.arctan2(np.hypot(x, y), z), np.where(phi >= 2 * np.pi, 0.0, phi)


def _mirrored(theta: np.ndarray) -> np.ndarray:
    """Polar angles, which may be signed, mirrored at the plane of the sample; 0 has no sign."""
    return np.where(theta < 0, -np.pi - theta, np.pi - theta) + 0.0


def spacing(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The step of an axis at each angle; 1 for an axis of one node."""
    return np.interp(angle, axis, np.gradient(axis)) if axis.size > 1 else np.ones_like(angle)

"""What every layout of a table can tell of its cells: axes, directions, angles, and the cells that physics relates.

Conventions as in `gonio.models.geometry.directions`: radians, +z the normal, `wi` to the light, `wo` to the detector.
"""

import abc
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from gonio.data.layouts.axes import TURN, AxisKind, OutgoingGrid
from gonio.data.layouts.nodes import node_numbers, spherical_angles
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction


Angles = Sequence[float] | np.ndarray
Trig = Sequence[tuple[Any, Any]]
"""(cosine, sine) of the angles on each axis, arrays that broadcast."""
NodeMap = list[tuple[int, np.ndarray]]
"""For each dimension of the related cell: the dimension of the cell that decides it, and the node for each node."""


class Layout(abc.ABC):
    """The cells of a table: axes of angles, float64 radians, in the order of the dimensions.

    A gridded layout has one dimension an axis, strictly increasing; cells are numbered in C order. To add a layout:
    one subclass in a file of its own, and its name in `gonio.data.layouts.registry`.

    Raises GonioError where an axis is missing, empty, not finite, out of its domain or out of order.
    """

    name: ClassVar[str]
    """As in files."""
    axis_kinds: ClassVar[tuple[AxisKind, ...]]
    optional_axes: ClassVar[frozenset[str]] = frozenset()
    gridded: ClassVar[bool] = True
    """Whether the cells stand on a grid of axes."""
    in_one_plane: ClassVar[bool] = False
    """Whether all cells lie in the plane of incidence."""
    in_half_vectors: ClassVar[bool] = False
    """Whether the axes are half and difference angles [Rusinkiewicz 1998]."""
    turning_axes: ClassVar[tuple[str, ...]] = ()
    """The azimuths that change together when the sample is turned about its normal."""
    pole_axes: ClassVar[tuple[tuple[str, str], ...]] = ()
    """(polar angle, azimuth) whose azimuth has no meaning where the polar angle is 0."""

    def __init__(self, axes: Mapping[str, Angles]) -> None:
        names = [kind.name for kind in self.axis_kinds]
        if not set(names) - self.optional_axes <= set(axes) <= set(names):
            raise GonioError(f"layout {self.name} has axes {', '.join(axes)}; give it {', '.join(names)}")
        self.axes = {k.name: self._checked_axis(k, axes[k.name]) for k in self.axis_kinds if k.name in axes}

    def _checked_axis(self, kind: AxisKind, values: Angles) -> np.ndarray:
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

    def with_axes(self, axes: Mapping[str, Angles]) -> Self:
        """A layout of this kind with other axes."""
        return type(self)(axes)

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the dimensions, without those of the values."""
        return tuple(self.axes)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of cells along each dimension."""
        return tuple(a.size for a in self.axes.values())

    @property
    def size(self) -> int:
        """Number of cells."""
        return math.prod(self.shape)

    @property
    def row_size(self) -> int:
        """Number of cells at one node of the leading dimension."""
        return math.prod(self.shape[1:])

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
    def pair(trig: Trig) -> tuple["Direction", "Direction"]:
        """(wi, wo) by the cosines and sines of the axes' angles; NumPy or JAX, components that broadcast."""

    @staticmethod
    @abc.abstractmethod
    def coordinates(wi: "Direction", wo: "Direction") -> dict[str, Any]:
        """The angle on each axis of one pair of unit directions (JAX); azimuths in [0, 2π)."""

    @staticmethod
    def covers(wi: "Direction", wo: "Direction") -> Any:
        """Whether a pair of directions is among those that the layout can hold (JAX)."""
        return True

    def directions(self, start: int = 0, stop: int | None = None) -> tuple["Direction", "Direction"]:
        """(wi, wo) of the cells start..stop in C order: components of shape (stop − start,), float64."""
        start, stop = self._range(start, stop)
        if stop - start < self.row_size:
            return self.directions_at(np.arange(start, stop))
        from gonio.models.geometry.directions import Direction

        flat = self._on_rows(start, stop, lambda trig: [c for w in self.pair(trig) for c in w])
        return Direction(*flat[:3]), Direction(*flat[3:])

    def directions_at(self, cells: np.ndarray) -> tuple["Direction", "Direction"]:
        """(wi, wo) of the cells of these C-order numbers, shape (n,): components of shape (n,), float64."""
        from gonio.models.geometry.directions import Direction

        nodes = np.unravel_index(cells, self.shape)
        wi, wo = self.pair([(np.cos(a)[k], np.sin(a)[k]) for a, k in zip(self.axes.values(), nodes, strict=True)])
        shape = np.shape(cells)
        return Direction(*(np.broadcast_to(c, shape) for c in wi)), Direction(*(np.broadcast_to(c, shape) for c in wo))

    def angles(self, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, ...]:
        """(theta_i, phi_i, theta_o, phi_o) of the cells start..stop, radians; azimuths in [0, 2π)."""
        return tuple(angle for w in self.directions(start, stop) for angle in spherical_angles(*w))

    def cosines(self, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(cos theta_i, cos theta_o) of the cells start..stop, shape (stop − start,)."""
        start, stop = self._range(start, stop)
        if stop - start >= self.row_size:
            cos_i, cos_o = self._on_rows(start, stop, self._cosines_of)
            return cos_i, cos_o
        wi, wo = self.directions_at(np.arange(start, stop))
        return wi.z, wo.z

    def above_horizon(self, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Whether both directions of the cells start..stop are above the horizon."""
        from gonio.models.geometry.horizon import HORIZON

        cos_i, cos_o = self.cosines(start, stop)
        return (cos_i > HORIZON) & (cos_o > HORIZON)

    def solid_angles(self, wi: "Direction", wo: "Direction") -> np.ndarray | None:
        """dωi dωo of the cells at these directions (n,), up to a factor; None where cells have no extent.

        The rim of a grid counts half a step outwards.
        """
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

    def _axis_angles(self, start: int, stop: int | None) -> list[np.ndarray]:
        """The angles on each axis of the cells start..stop."""
        nodes = np.unravel_index(np.arange(*self._range(start, stop)), self.shape)
        return [a[k] for a, k in zip(self.axes.values(), nodes, strict=True)]

    def _range(self, start: int, stop: int | None) -> tuple[int, int]:
        first, last, _ = slice(start, stop).indices(self.size)
        return first, last

    def _on_rows(
        self, start: int, stop: int, function: Callable[[Trig], Sequence[np.ndarray]]
    ) -> tuple[np.ndarray, ...]:
        """Flat results of a function of the axes' trigonometry, evaluated on whole rows: no index is gathered."""
        row = self.row_size
        first, last = start // row, -(-stop // row)
        shape = (last - first, *self.shape[1:])
        cut = slice(start - first * row, stop - first * row)
        trig = []
        for k, a in enumerate(self.axes.values()):
            angle = (a[first:last] if k == 0 else a).reshape([-1 if j == k else 1 for j in range(len(self.axes))])
            trig.append((np.cos(angle), np.sin(angle)))
        return tuple(np.broadcast_to(c, shape).reshape(-1)[cut] for c in function(trig))

    def _cosines_of(self, trig: Trig) -> tuple[np.ndarray, np.ndarray]:
        wi, wo = self.pair(trig)
        return wi.z, wo.z


def spacing(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The step of an axis at each angle; 1 for an axis of one node."""
    return np.interp(angle, axis, np.gradient(axis)) if axis.size > 1 else np.ones_like(angle)

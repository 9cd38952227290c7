"""The table: what an instrument read, cell by cell, with its uncertainty, its flags and how it came about."""

import dataclasses
import functools
import importlib
import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from gonio.data.angles import as_numbers, radian_arrays
from gonio.data.cell_ranges import boxes
from gonio.data.channels import Channels as Channels
from gonio.data.flags import Flag
from gonio.data.layouts import Layout, scattered
from gonio.models.display import Displayed, listed
from gonio.models.errors import GonioError, nearest, printable
from gonio.models.geometry.sides import FRONT, Hemispheres, Sides, hemispheres_of, side, sides_in_words

if TYPE_CHECKING:
    import os

    import xarray

    from gonio.data.round_trip import RoundTrip
    from gonio.models.brdf import AbstractBRDF
    from gonio.models.geometry.directions import Direction


MEDIA = "media"
"""Key of the provenance that states the refractive indices in front of the sample and behind it, which may be lists."""
FOLDED = "folded"
"""Key of the provenance of readings mirrored into the front: the sides of light and detector, of each part."""
COPIED = "one_reading_for_all_azimuths"
"""Key of the provenance of a table that has one reading at a pole in the cells of all azimuths."""


class ArrayOptions(TypedDict, total=False):
    """Options of `Table.from_arrays`."""

    wavelengths_nm: Sequence[float] | None
    """One monochromatic channel for each, nm."""
    channels: Sequence[str] | None
    """Names of the channels; by default grey, R, G, B, or numbers."""
    degrees: bool
    """Whether the angles are degrees; else radians."""
    name: str
    """What the table is called."""


class Block(NamedTuple):
    """Some cells of a table: directions with components of shape (n,), values as `Table.read_values` gives them."""

    wi: "Direction"
    wo: "Direction"
    f: np.ndarray
    """1/sr."""
    u_f: np.ndarray
    """Standard uncertainty of the expected reading, 1/sr; NaN unknown, 0 exact."""
    flag: np.ndarray
    """uint8, see `Flag`."""


@dataclasses.dataclass(repr=False, eq=False)
class Table(Displayed):
    """BRDF readings on a layout; two tables are equal where they are the same object, as arrays have no one answer.

    Attributes:
        layout: where the cells are.
        f: readings, 1/sr, without the cosine; an array of shape `shape`, or an h5py dataset larger than memory.
        flag: uint8 `Flag` of the same shape.
        channels: names and wavelengths of the last dimension.
        u_f: standard uncertainty of the expected reading, 1/sr, of the same shape (NaN unknown, 0 exact), or None.
        provenance: how the table came about; anything that JSON can hold.
        source_solid_angle, receiver_solid_angle: of the apertures, sr; None if unknown.
        name: what a person calls it.

    Raises:
        GonioError: shapes disagree.
    """

    value_dims: ClassVar[tuple[str, ...]] = ("channel",)
    """Names of the dimensions of one cell's value; they follow those of the layout."""

    layout: Layout
    f: Any
    flag: Any
    channels: Channels
    u_f: Any = None
    provenance: dict[str, Any] = dataclasses.field(default_factory=dict)
    source_solid_angle: float | None = None
    receiver_solid_angle: float | None = None
    name: str = ""
    interpolant: "Callable[..., AbstractBRDF] | None" = None
    """Makes the BRDF by which the file's format itself reads between the cells; None: `multilinear`.

    Called with ``coarse=True`` it makes one of half the nodes, from which the error of the whole one is
    estimated. Either has a method `only` that makes the one of some of its channels, by their numbers.
    """

    def __post_init__(self) -> None:
        self.name = printable(self.name)
        for what in ("f", "flag", "u_f"):
            values = getattr(self, what)
            if values is not None and tuple(values.shape) != self.shape:
                raise GonioError(f"{what} has shape {tuple(values.shape)}, but layout and channels make {self.shape}")

    @property
    def value_shape(self) -> tuple[int, ...]:
        """Sizes of `value_dims`."""
        return (len(self.channels),)

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of all dimensions: the layout's, then `value_dims`."""
        return (*self.layout.dims, *self.value_dims)

    @property
    def shape(self) -> tuple[int, ...]:
        """Sizes of `dims`."""
        return (*self.layout.shape, *self.value_shape)

    @classmethod
    def from_arrays(
        cls,
        theta_i: ArrayLike,
        phi_i: ArrayLike,
        theta_o: ArrayLike,
        phi_o: ArrayLike,
        f: ArrayLike,
        u_f: ArrayLike | None = None,
        **options: Unpack[ArrayOptions],
    ) -> "Table":
        """A table of scattered readings.

        Args:
            theta_i, phi_i: polar angle in [0, π], beyond π/2 behind the sample, and azimuth of the direction to the
                light.
            theta_o, phi_o: those of the direction to the detector; all four broadcast to one shape S.
            f: BRDF, 1/sr, without the cosine, of shape S, or S + (channels,). NaN, infinite and masked values become
                INVALID, readings at the horizon BELOW_HORIZON.
            u_f: standard uncertainties, 1/sr, of the shape of `f` (NaN unknown, 0 exact).
            options: see `ArrayOptions`.

        Raises:
            GonioError: angles out of range, shapes or channels that do not fit, negative uncertainties.
        """
        if unknown := sorted(set(options) - set(ArrayOptions.__annotations__)):
            raise TypeError(
                f"from_arrays has no option '{unknown[0]}'; {nearest(unknown[0], ArrayOptions.__annotations__)}"
            )
        degrees = options.get("degrees", False)
        angles = radian_arrays(degrees, True, theta_i=theta_i, phi_i=phi_i, theta_o=theta_o, phi_o=phi_o)
        layout = scattered(*(a.ravel() % (2 * np.pi) for a in angles))
        values = _readings("f", f, angles[0].shape)
        uncertainty = None if u_f is None else np.broadcast_to(_readings("u_f", u_f, angles[0].shape), values.shape)
        if uncertainty is not None and (uncertainty < 0).any():
            raise GonioError("u_f is negative; give standard uncertainties, 0 (exact) or NaN (unknown)")
        names, wavelengths = options.get("channels"), options.get("wavelengths_nm")
        channels = Channels.of_count(values.shape[-1]) if wavelengths is None else Channels.of_wavelengths(wavelengths)
        if names is not None:
            channels = Channels(tuple(names), channels.wavelengths_nm)
        return whole_table_of_values(layout, values, channels, u_f=uncertainty, name=options.get("name", ""))

    @classmethod
    def from_xarray(cls, dataset: "xarray.Dataset") -> "Table":
        """The table of a dataset that `to_xarray` made, or that was opened from a table's file. Raises GonioError."""
        return importlib.import_module("gonio.data").from_dataset(dataset)

    def to_xarray(self) -> "xarray.Dataset":
        """f, u_f and flag with named dimensions, as xarray opens the table's file. Raises GonioError without xarray."""
        return importlib.import_module("gonio.data").to_dataset(self)

    def save(self, path: "str | os.PathLike[str]", force: bool = False) -> "RoundTrip":
        """Writes the table in the format of the path's ending (.h5, .csv, .bsdf, .binary), whole or not at all.

        Returns:
            What reading the file again shows to be lost.

        Raises:
            GonioError: another ending, a path that exists (unless `force`) or cannot be written.
        """
        return importlib.import_module("gonio.data").write(path, self, force)

    def covers(
        self, theta_i: ArrayLike, phi_i: ArrayLike, theta_o: ArrayLike, phi_o: ArrayLike, degrees: bool = False
    ) -> np.ndarray:
        """Whether readings lie about directions, so that interpolation between them answers for f.

        Elsewhere `gonio.material(table).f` continues the nearest readings, without any bound.

        Args:
            theta_i, phi_i, theta_o, phi_o: polar angles and azimuths of light and detector, as `Material.f` takes them.
            degrees: whether they are degrees; else radians.

        Returns:
            Booleans of the angles' broadcast shape.

        Raises:
            GonioError: angles out of range, or shapes that do not broadcast.
        """
        given = radian_arrays(degrees, True, theta_i=theta_i, phi_i=phi_i, theta_o=theta_o, phi_o=phi_o)
        return importlib.import_module("gonio.data").covers_angles(self, given)

    def facts(self) -> dict[str, str]:
        """Layout, axes, channels, hemispheres, readings by what became of them, and where they come from."""
        counts = self.counts() if isinstance(self.f, np.ndarray) else {}
        kinds = [f"{n:,} {kind.replace('_', ' ')}" for kind, n in counts.items() if n and kind != "cells"]
        axes = [f"{name} {len(axis)}" for name, axis in self.layout.axes.items()]
        seed = self.provenance.get("seed")
        simulated = f"simulated, seed {seed}" if "instrument" in self.provenance else ""
        return {
            "name": self.name,
            "layout": f"{self.layout.name}, {self.layout.size:,} cells: {', '.join(axes)}",
            "channels": f"{len(self.channels)}: {listed(self.channels.names)}",
            "sides": sides_in_words(self.layout.sides),
            "readings": ", ".join(kinds),
            "uncertainty": self.uncertainty() if isinstance(self.f, np.ndarray) else "stored in the file",
            "source": str(self.provenance.get("source", simulated)),
        }

    def uncertainty(self) -> str:
        """The standard uncertainties of the valid readings, in words: not stated, exact, unknown, or their median."""
        if self.u_f is None:
            return "not stated"
        blocks = (self.read_values(*block) for block in self.blocks())
        u = np.concatenate([values["u_f"][values["flag"] == Flag.VALID] for values in blocks])
        if not u.any():
            return "0: exact, no noise"
        known = u[np.isfinite(u) & (u > 0)]
        if not known.size:
            return "unknown"
        return f"stored for {known.size} of {u.size} valid readings, median {np.median(known):.4g} 1/sr"

    @property
    def sides(self) -> Sides:
        """The sides of the sample on which light and detector are, where not all cells are below the horizon."""
        sides = self.layout.sides
        if sides == FRONT:
            return sides
        read = frozenset[tuple[int, int]]()
        for start, stop in self.blocks():
            there = (self._flat("flag", start, stop) != Flag.BELOW_HORIZON).any(axis=1)
            light, detector = (side(c)[there] for c in self.layout.cosines(start, stop))
            read |= {(a, b) for a, b in sides if ((light == a) & (detector == b)).any()}
        return read or FRONT

    @property
    def hemispheres(self) -> Hemispheres:
        """The hemispheres, that of the light or the opposite one, that it holds cells of."""
        return hemispheres_of(self.sides)

    @property
    def media(self) -> tuple[np.ndarray, np.ndarray]:
        """Refractive indices (channels,) in front of the sample and behind it, by its provenance; else of air."""
        known = media_of(self.provenance.get(MEDIA), len(self.channels))
        return known or (np.ones(len(self.channels)), np.ones(len(self.channels)))

    def parts(self) -> "dict[tuple[int, int], Table]":
        """The readings by the sides of light and detector, both directions mirrored into the front hemisphere.

        Each part is a table as of reflection: what goes straight through stands in its mirror direction. In memory.
        """
        sides = self.sides
        if sides == FRONT:
            return {(1, 1): self}
        return {pair: self._folded(*pair) for pair in sorted(sides, reverse=True)}

    def _folded(self, light: int, detector: int) -> "Table":
        layout, index = self.layout.folded(light, detector)
        f, flag, u_f = (None if a is None else np.asarray(a[...])[index] for a in (self.f, self.flag, self.u_f))
        about = self.provenance | {FOLDED: [[light, detector]]}
        return dataclasses.replace(self, layout=layout, f=f, flag=flag, u_f=u_f, provenance=about)

    def only(self, names: Sequence[str]) -> "Table":
        """The same table with these channels alone, in this order. Raises GonioError for a channel it does not have."""
        for name in names:
            if name not in self.channels.names:
                raise GonioError(f"there is no channel {name!r}; {nearest(name, self.channels.names)}")
        numbers = [self.channels.names.index(name) for name in names]
        wavelengths = self.channels.wavelengths_nm
        channels = Channels(tuple(names), None if wavelengths is None else tuple(wavelengths[k] for k in numbers))
        f, flag, u_f = (None if a is None else np.asarray(a)[..., numbers] for a in (self.f, self.flag, self.u_f))
        rule = self.interpolant and functools.partial(_of_channels, self.interpolant, numbers)
        return dataclasses.replace(self, f=f, flag=flag, u_f=u_f, channels=channels, interpolant=rule)

    def as_list(self) -> "Table":
        """The same readings as scattered samples, without those on the horizon."""
        cells = np.flatnonzero(self.layout.readable())
        layout = scattered(*(a[cells] for a in self.layout.angles()))
        values: dict[str, Any] = self.values_at(cells)
        if self.u_f is None:
            values["u_f"] = None
        return dataclasses.replace(self, layout=layout, interpolant=None, **values)

    def blocks(self, readings: int = 1 << 20) -> Iterator[tuple[int, int]]:
        """Ranges (start, stop) of cells in C order that hold at most so many readings, one for each value of a cell.

        They are whole rows of the first axis where these fit.
        """
        row, max_cells = self.layout.row_size, max(readings // math.prod(self.value_shape), 1)
        step = max_cells // row * row if row <= max_cells else max_cells
        for start in range(0, self.layout.size, step):
            yield start, min(start + step, self.layout.size)

    def read(self, start: int = 0, stop: int | None = None) -> Block:
        """The cells start..stop in C order."""
        stop = self.layout.size if stop is None else stop
        wi, wo = self.layout.directions(start, stop)
        return Block(wi, wo, **self.read_values(start, stop))

    def read_values(self, start: int = 0, stop: int | None = None) -> dict[str, np.ndarray]:
        """`f`, `u_f` and `flag` of the cells start..stop, each (cells, values): the `value_dims` as one, in C order.

        This is how all readings are taken out of a table, whatever the dimensions of a value.
        """
        stop = self.layout.size if stop is None else stop
        flag = self._flat("flag", start, stop)
        u_f = np.broadcast_to(np.nan, flag.shape) if self.u_f is None else self._flat("u_f", start, stop)
        return {"f": self._flat("f", start, stop), "u_f": u_f, "flag": flag}

    def values_at(self, cells: np.ndarray) -> dict[str, np.ndarray]:
        """What `read_values` gives of the cells of these C-order numbers, in any order, (n,)."""
        rising = bool((cells[1:] >= cells[:-1]).all())
        order = None if rising else np.argsort(cells, kind="stable")
        sorted_cells = cells if order is None else cells[order]
        values = {k: np.empty((cells.size, *v.shape[1:]), v.dtype) for k, v in self.read_values(0, 0).items()}
        every = dict(values)
        if self.u_f is None:
            every["u_f"] = np.broadcast_to(np.nan, values.pop("u_f").shape)
        for start, stop in self.blocks():
            first, last = np.searchsorted(sorted_cells, (start, stop))
            if first < last:
                whole = last - first == stop - start and bool(sorted_cells[first] == start)
                read = self.read_values(start, stop)
                for name, into in values.items():
                    if order is not None:
                        into[order[first:last]] = read[name][sorted_cells[first:last] - start]
                    elif whole:
                        into[first:last] = read[name]
                    else:
                        read[name].take(sorted_cells[first:last] - start, axis=0, out=into[first:last], mode="clip")
        return every

    def counts(self) -> dict[str, int]:
        """Number of `cells`; of readings (cells × channels): those of each flag, and the `negative` valid."""
        by_flag, negative = np.zeros(256, np.int64), 0
        for start, stop in self.blocks():
            flag = self._flat("flag", start, stop)
            valid = flag == Flag.VALID
            number = np.count_nonzero(valid)
            by_flag[Flag.VALID] += number
            if number < flag.size:
                by_flag += np.bincount(flag[~valid], minlength=256)
            negative += int(np.count_nonzero((self._flat("f", start, stop) < 0) & valid))
        named = {flag.name.lower(): int(by_flag[flag]) for flag in Flag}
        return {"cells": self.layout.size, "negative": negative, **named}

    def valid_cells(self, theta_max: float | None = None) -> np.ndarray:
        """C-order numbers of the cells valid in any channel.

        `theta_max`, radians: both directions are nearer than that to the normal of their side.
        """
        return np.concatenate([start + np.flatnonzero(valid) for start, valid in self._valid(theta_max)])

    def some_valid_cells(self, limit: int, theta_max: float | None = None, seed: int = 0) -> np.ndarray:
        """At most `limit` of the `valid_cells`, in order, drawn by `seed` without bias; in memory for these alone."""
        packed = [(start, valid.size, np.packbits(valid)) for start, valid in self._valid(theta_max)]
        ends = np.cumsum([0, *(int(np.bitwise_count(bits).sum()) for *_, bits in packed)])
        rank = np.arange(min(limit, ends[-1]))
        if limit < ends[-1]:
            rank = np.sort(np.random.default_rng(seed).choice(ends[-1], limit, replace=False, shuffle=False))
        cells = []
        for (start, size, bits), first, last in zip(packed, ends[:-1], ends[1:], strict=True):
            of_block = rank[slice(*np.searchsorted(rank, (first, last)))] - first
            if of_block.size:
                cells.append(start + np.flatnonzero(np.unpackbits(bits, count=size))[of_block])
        return np.concatenate(cells) if cells else np.zeros(0, int)

    def _valid(self, theta_max: float | None) -> Iterator[tuple[int, np.ndarray]]:
        """Block by block the first cell, and which are among the `valid_cells`."""
        for start, stop in self.blocks():
            yield start, self.are_valid(self._flat("flag", start, stop), start, theta_max)

    def are_valid(self, flag: np.ndarray, start: int, theta_max: float | None = None) -> np.ndarray:
        """Which of the cells from `start` on, with these flags (n, values), are among the `valid_cells`, (n,)."""
        # Channel by channel: NumPy goes along a short last axis one number at a time.
        first, *others = flag.T
        valid = first == Flag.VALID
        for of_channel in others:
            valid |= of_channel == Flag.VALID
        if theta_max is not None:
            for cosine in self.layout.cosines(start, start + len(flag)):
                valid &= np.abs(cosine) > math.cos(theta_max)
        return valid

    def samples(self, limit: int | None = None, theta_max: float | None = None, seed: int = 0) -> Block:
        """The cells valid in any channel, in C order; at most `limit` of them, drawn by `seed` without bias.

        `theta_max` as of `valid_cells`. Flags still say which channels are valid.
        """
        cells = self.valid_cells(theta_max) if limit is None else self.some_valid_cells(limit, theta_max, seed)
        if cells.size == self.layout.size:
            return self.read()
        return Block(*self.layout.directions_at(cells), **self.values_at(cells))

    def _flat(self, what: str, start: int, stop: int) -> np.ndarray:
        values = getattr(self, what)
        count = math.prod(self.value_shape)
        if isinstance(values, np.ndarray):
            return values.reshape(-1, count)[start:stop]
        pieces = [values[box].reshape(-1, count) for box in boxes(self.layout.shape, start, stop)]
        return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)


def _of_channels(interpolant: Callable[..., Any], numbers: Sequence[int], coarse: bool = False) -> Any:
    """The BRDF by which a file's format reads between the cells, of some channels."""
    return (interpolant(coarse=True) if coarse else interpolant()).only(numbers)


def media_of(stated: Any, channels: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Refractive indices (channels,) in front and behind of what a file states of them; None for what is none."""
    try:
        front, behind = (np.broadcast_to(np.asarray(n, float), channels) for n in stated)
    except (TypeError, ValueError):
        return None
    known = all((n > 0).all() and np.isfinite(n).all() for n in (front, behind))
    return (front, behind) if known else None


def part_sides(table: Table) -> tuple[int, int]:
    """Sides of (light, detector) that a part of a table was mirrored from; (1, 1) of a table that was not."""
    try:
        light, detector = table.provenance[FOLDED][0]
    except (KeyError, IndexError, TypeError, ValueError):
        return 1, 1
    return (light, detector) if light in (1, -1) and detector in (1, -1) else (1, 1)


def index_of(table: Table) -> float:
    """Refractive index behind the sample over that in front, the mean of the channels."""
    front, behind = table.media
    return float(np.mean(behind / front))


def _readings(name: str, values: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
    """Values of the shape S of the directions, or S + (channels,), as (readings, channels)."""
    array = as_numbers(name, values)
    channels = array.shape[-1:] if array.ndim == len(shape) + 1 else ()
    try:
        return np.broadcast_to(array, (*shape, *channels)).reshape(math.prod(shape), -1)
    except ValueError:
        raise GonioError(
            f"{name} has shape {array.shape}, but the angles make {shape}; give one value for each pair of directions,"
            " or one for each channel on a last axis"
        ) from None


def whole_table_of_values(layout: Layout, f: np.ndarray, channels: Channels | None = None, **fields: Any) -> Table:
    """A table of bare values `f` (``layout.shape`` or ``layout.shape + (channels,)``): flags by the geometry.

    Cells that cannot be read (see `Layout.readable`) are flagged BELOW_HORIZON, values that are NaN or infinite
    INVALID; both are stored as NaN.
    """
    f = np.asarray(f).reshape(*layout.shape, -1)
    flag = np.where(np.isfinite(f), np.uint8(Flag.VALID), np.uint8(Flag.INVALID))
    flag[~layout.readable().reshape(layout.shape)] = Flag.BELOW_HORIZON
    f = np.where(flag == Flag.VALID, f, np.asarray(np.nan, f.dtype))
    return Table(layout, f, flag, channels or Channels.of_count(f.shape[-1]), **fields)

"""The table: what an instrument read, cell by cell, with its uncertainty, its flags and how it came about."""

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gonio.data.flags import Flag
from gonio.data.layouts import Layout
from gonio.models.display import Displayed, listed
from gonio.models.errors import GonioError, nearest

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction


@dataclasses.dataclass(frozen=True)
class Channels:
    """Names of the channels and, where they are monochromatic, their wavelengths in nm."""

    names: tuple[str, ...]
    wavelengths_nm: tuple[float, ...] | None = None

    def __post_init__(self):
        object.__setattr__(self, "names", tuple(str(n) for n in self.names))
        if not self.names:
            raise GonioError("a table has no channel; name at least one")
        if self.wavelengths_nm is not None:
            object.__setattr__(self, "wavelengths_nm", tuple(float(w) for w in self.wavelengths_nm))
            if len(self.wavelengths_nm) != len(self.names):
                raise GonioError(
                    f"{len(self.names)} channels have {len(self.wavelengths_nm)} wavelengths; give one each"
                )

    def __len__(self):
        return len(self.names)

    @classmethod
    def grey(cls) -> "Channels":
        """A single channel of no stated wavelength."""
        return cls(("grey",))

    @classmethod
    def rgb(cls) -> "Channels":
        """Red, green, blue."""
        return cls(("R", "G", "B"))

    @classmethod
    def of_wavelengths(cls, wavelengths_nm) -> "Channels":
        """One monochromatic channel for each wavelength, nm."""
        return cls(tuple(f"{w:g} nm" for w in wavelengths_nm), tuple(wavelengths_nm))

    @classmethod
    def of_count(cls, count: int) -> "Channels":
        """Channels of which only the number is known: grey, RGB if three, else numbered from 1."""
        return {1: cls.grey, 3: cls.rgb}.get(count, lambda: cls(tuple(f"channel {k + 1}" for k in range(count))))()


class Block(NamedTuple):
    """Some cells of a table: directions with components of shape (n,), values of shape (n, channels)."""

    wi: "Direction"
    wo: "Direction"
    f: np.ndarray
    """1/sr."""
    u_f: np.ndarray
    """Standard uncertainty of the expected reading, 1/sr; NaN unknown, 0 exact."""
    flag: np.ndarray
    """uint8, see `Flag`."""


@dataclasses.dataclass(repr=False)
class Table(Displayed):
    """BRDF readings on a layout.

    `f` (1/sr, without the cosine) and `flag` (uint8 `Flag`) have the shape ``layout.shape + (channels,)``; so
    has `u_f`, the standard uncertainty of the expected reading (NaN unknown, 0 exact), or it is None: unknown
    everywhere. They are NumPy arrays, or h5py datasets for a table larger than memory. Solid angles are those
    of the apertures, sr; None where nobody said. `provenance` is anything JSON can hold. Raises GonioError
    where shapes disagree.
    """

    layout: Layout
    f: Any
    flag: Any
    channels: Channels
    u_f: Any = None
    provenance: dict = dataclasses.field(default_factory=dict)
    source_solid_angle: float | None = None
    receiver_solid_angle: float | None = None
    name: str = ""
    interpolant: Callable | None = None
    """Makes the BRDF by which the file's format itself reads between the cells; None: `multilinear`.

    Called with ``coarse=True`` it makes one of half the nodes, from which the error of the whole one is
    estimated.
    """

    def __post_init__(self):
        shape = (*self.layout.shape, len(self.channels))
        for what in ("f", "flag", "u_f"):
            values = getattr(self, what)
            if values is not None and tuple(values.shape) != shape:
                raise GonioError(f"{what} has shape {tuple(values.shape)}, but layout and channels make {shape}")

    def facts(self) -> dict[str, str]:
        """Layout, axes, channels, readings by what became of them, and where they come from."""
        counts = self.counts() if isinstance(self.f, np.ndarray) else {}
        kinds = [f"{n:,} {kind.replace('_', ' ')}" for kind, n in counts.items() if n and kind != "cells"]
        axes = [f"{name} {len(axis)}" for name, axis in self.layout.axes.items()]
        seed = self.provenance.get("seed")
        simulated = f"simulated, seed {seed}" if "instrument" in self.provenance else ""
        return {
            "name": self.name,
            "layout": f"{self.layout.name}, {self.layout.size:,} cells: {', '.join(axes)}",
            "channels": f"{len(self.channels)}: {listed(self.channels.names)}",
            "readings": ", ".join(kinds),
            "uncertainty": "not stated" if self.u_f is None else "stored for each reading",
            "source": str(self.provenance.get("source", simulated)),
        }

    def only(self, names: Sequence[str]) -> "Table":
        """The same table with these channels alone, in this order. Raises GonioError for a channel it does not have."""
        for name in names:
            if name not in self.channels.names:
                raise GonioError(f"there is no channel {name!r}; {nearest(name, self.channels.names)}")
        at = [self.channels.names.index(name) for name in names]
        wavelengths = self.channels.wavelengths_nm
        kept = Channels(tuple(names), None if wavelengths is None else tuple(wavelengths[k] for k in at))
        parts = {what: getattr(self, what) for what in ("f", "flag", "u_f")}
        parts = {what: None if values is None else np.asarray(values)[..., at] for what, values in parts.items()}
        return dataclasses.replace(self, **parts, channels=kept, interpolant=None)

    def blocks(self, max_cells: int = 1 << 20) -> Iterator[tuple[int, int]]:
        """Ranges (start, stop) of cells in C order: whole rows of the first axis if they fit `max_cells`."""
        row = self.layout.row_size
        step = max_cells // row * row if row <= max_cells else max_cells
        for start in range(0, self.layout.size, step):
            yield start, min(start + step, self.layout.size)

    def read(self, start: int = 0, stop: int | None = None) -> Block:
        """The cells start..stop in C order."""
        stop = self.layout.size if stop is None else stop
        wi, wo = self.layout.directions(start, stop)
        return Block(wi, wo, **self.read_values(start, stop))

    def read_values(self, start: int = 0, stop: int | None = None) -> dict[str, np.ndarray]:
        """`f`, `u_f` and `flag` of the cells start..stop, each ``(cells, channels)``: `read` without directions."""
        stop = self.layout.size if stop is None else stop
        flag = self._flat("flag", start, stop)
        return {
            "f": self._flat("f", start, stop),
            "u_f": self._uncertainty(start, stop, flag.shape),
            "flag": flag,
        }

    def counts(self) -> dict[str, int]:
        """Number of `cells`; of readings (cells × channels): those of each flag, and the `negative` valid."""
        by_flag, negative = np.zeros(256, np.int64), 0
        for start, stop in self.blocks():
            flag = self._flat("flag", start, stop)
            by_flag += np.bincount(flag.ravel(), minlength=256)
            negative += int(np.count_nonzero((self._flat("f", start, stop) < 0) & (flag == Flag.VALID)))
        named = {flag.name.lower(): int(by_flag[flag]) for flag in Flag}
        return {"cells": self.layout.size, "negative": negative, **named}

    def samples(self, limit: int | None = None, theta_max: float | None = None, seed: int = 0) -> Block:
        """The cells valid in any channel, in C order; at most `limit` of them, drawn by `seed` without bias.

        `theta_max`, radians: only cells with both polar angles below it. Flags still say which channels are
        valid.
        """
        cells = np.concatenate([self._usable(start, stop, theta_max) for start, stop in self.blocks()])
        if limit is not None and limit < cells.size:
            cells = np.sort(np.random.default_rng(seed).choice(cells, limit, replace=False, shuffle=False))
        wi, wo = self.layout.directions_at(cells)
        parts = {what: [] for what in ("f", "flag", "u_f")}
        for start, stop in self.blocks():
            first, last = np.searchsorted(cells, (start, stop))
            if first < last:
                at = cells[first:last] - start
                flag = self._flat("flag", start, stop)
                parts["flag"].append(flag[at])
                parts["f"].append(self._flat("f", start, stop)[at])
                if self.u_f is not None:
                    parts["u_f"].append(self._flat("u_f", start, stop)[at])
        empty = {"flag": np.uint8, "f": self.f.dtype, "u_f": np.float64}
        whole = {
            what: np.concatenate(p) if p else np.empty((0, len(self.channels)), empty[what])
            for what, p in parts.items()
        }
        u_f = np.broadcast_to(np.nan, whole["f"].shape) if self.u_f is None else whole["u_f"]
        return Block(wi, wo, whole["f"], u_f, whole["flag"])

    def _usable(self, start, stop, theta_max):
        usable = (self._flat("flag", start, stop) == Flag.VALID).any(axis=1)
        if theta_max is not None:
            cos_i, cos_o = self.layout.cosines(start, stop)
            usable &= np.minimum(cos_i, cos_o) > math.cos(theta_max)
        return start + np.flatnonzero(usable)

    def _uncertainty(self, start, stop, shape):
        return np.broadcast_to(np.nan, shape) if self.u_f is None else self._flat("u_f", start, stop)

    def _flat(self, what: str, start: int, stop: int) -> np.ndarray:
        values, channels = getattr(self, what), len(self.channels)
        if isinstance(values, np.ndarray):
            return values.reshape(-1, channels)[start:stop]
        parts = [values[box].reshape(-1, channels) for box in boxes(self.layout.shape, start, stop)]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)


def boxes(shape: tuple[int, ...], start: int, stop: int) -> Iterator[tuple[slice, ...]]:
    """The rectangular pieces, in order, that make up the C-order range start..stop of such an array."""
    if len(shape) == 1:
        yield (slice(start, stop),)
        return
    inner = math.prod(shape[1:])
    (row, head), (last, tail) = divmod(start, inner), divmod(stop, inner)
    if row == last:
        yield from ((slice(row, row + 1), *box) for box in boxes(shape[1:], head, tail))
        return
    if head:
        yield from ((slice(row, row + 1), *box) for box in boxes(shape[1:], head, inner))
        row += 1
    if row < last:
        yield (slice(row, last), *(slice(0, n) for n in shape[1:]))
    if tail:
        yield from ((slice(last, last + 1), *box) for box in boxes(shape[1:], 0, tail))


def whole_table_of_values(layout: Layout, f: np.ndarray, channels: Channels | None = None, **fields) -> Table:
    """A table of bare values `f` (``layout.shape`` or ``layout.shape + (channels,)``): flags by the geometry.

    Cells below the horizon are flagged so, values that are NaN or infinite INVALID; both are stored as NaN.
    """
    f = np.asarray(f)
    f = f.reshape(*layout.shape, -1)
    flag = np.where(np.isfinite(f), np.uint8(Flag.VALID), np.uint8(Flag.INVALID))
    flag[~layout.above_horizon().reshape(layout.shape)] = Flag.BELOW_HORIZON
    f = np.where(flag == Flag.VALID, f, np.asarray(np.nan, f.dtype))
    return Table(layout, f, flag, channels or Channels.of_count(f.shape[-1]), **fields)

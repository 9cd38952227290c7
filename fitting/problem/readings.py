"""The readings that a fit uses, and how a model is compared with them: losses, and the weights of the residuals.

Each residual is w·(T(f c) − T(y c)), where c is cosθi or 1 and w the weight of the reading:

- `sigma`: T(v) = v, c = 1, w = 1/u: the likelihood of the noise, where the standard uncertainty u is known;
- `linear`: the same with w = 1;
- `cbrt`: T(v) = v/(v² + ε²)^⅓, c = cosθi: the cube root [Löw et al. 2012, as BRDF-space weighting by compression],
  signed, and linear within the floor ε, which removes its pole at 0;
- `log`: T(v) = sign(v) log(1 + |v|/ε), c = cosθi [Löw et al. 2012, eq. 17, where ε = 1];
- `log1p`: the same with c = 1 and ε = 1, as others publish it.

The floor ε is the noise where the table knows it (see `loss_floor`).
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Sequence
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from gonio.data.flags import Flag
from gonio.data.layouts import Layout
from gonio.data.table import Block, Table
from gonio.fitting.problem.deferred_arrays import DeferredValues, InverseWeights
from gonio.fitting.problem.median import median_of_parts
from gonio.fitting.problem.table_rows import Rows, TableRows, rows_of
from gonio.models.compiled.dispatch import usable
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.program import Program
from gonio.models.errors import GonioError, nearest
from gonio.models.geometry.directions import NORMAL, Direction
from gonio.models.geometry.horizon import turned_over

LOSSES = ("sigma", "linear", "cbrt", "log", "log1p")
IDENTITIES = ("sigma", "linear")  # that compare f as it is
_GUESS = 6142909891733356544.0  # of the bits: (4/3) · 1023 · 2⁵², less what halves the worst error of the first guess
WEIGHTS = ("solid-angle", "cosine", "projected-solid-angle")
NO_UNCERTAINTY = "The loss 'sigma' needs standard uncertainties above 0, and this table has none; choose another loss."

POINTS = (0.0, 0.0)  # half-angles of apertures that are points
PAGE = 16  # blocks of a page
LANES = 16  # vectors of free numbers that a program takes side by side
AnyArray = jax.Array | np.ndarray
ALIGNED = 64  # bytes: what XLA asks of memory that it may use without a copy
CHUNK = 1 << 15  # samples whose intermediate values stay in a cache
MASKED = ("below_horizon", "shadowed", "saturated", "invalid")
BRIGHTER = 5.0  # standard uncertainties from 0 of a sum of readings from which they are no noise about 0
BANDS = (-20, 12)  # exponents of tan²θh from 1e-6 to 4e3
MANY = 1 << 12  # values from which on a loop of their own is faster than NumPy's function
STORED = 1 << 21  # readings, channels counted apart, from which on they stay in their table
FEWEST_STORED = 1 << 14  # cells below which they do not: so few are searched as a whole
RARE = 2  # bands of fewer cells than this many times those wanted are taken whole


@dataclasses.dataclass(frozen=True)
class Readings:
    """The usable readings of a table: directions (n,), values, standard uncertainties and validity (n, C).

    Those that stay in their table, `rows` of it, are `DeferredValues`.
    """

    wi: Direction
    wo: Direction
    f: np.ndarray
    u_f: np.ndarray
    valid: np.ndarray
    cell_weight: np.ndarray | None = None  # (n,) weight of each cell's squared residuals, up to a factor
    half_angles: tuple[float, float] = POINTS  # of the discs of light and detector, radians
    rows: TableRows | None = None

    def __post_init__(self) -> None:
        # Other values than the table's would be forgotten where parts are read.
        assert self.rows is None or isinstance(self.f, DeferredValues)

    @classmethod
    def stored(cls, rows: TableRows) -> "Readings":
        """The readings of a table that stay in it."""

        def deferred(read: Callable[[Rows], np.ndarray], shape: tuple[int, ...], kind: Any = float) -> Any:
            return DeferredValues(read, shape, kind)

        wi, wo = (
            Direction(
                *(
                    deferred(lambda some, w=w, c=c: np.asarray(rows.directions(some)[w][c]), rows.shape[:1])
                    for c in range(3)
                )
            )
            for w in range(2)
        )
        kinds = (float, float, bool)
        f, u_f, valid = (deferred(lambda some, k=k: rows.values(some)[k], rows.shape, t) for k, t in enumerate(kinds))
        return cls(wi, wo, f, u_f, valid, rows=rows)

    @property
    def in_memory(self) -> "Readings":
        """The same readings as arrays, laid out where a fit on all of them wants them."""
        if self.rows is None:
            return self
        part, (n, channels) = self.part(slice(None)), self.rows.shape
        wi, wo = (laid_directions(w, channels) for w in (part.wi, part.wo))
        f = in_blocks(part.f, (*block_shape(n, channels), channels)).reshape(-1, channels)[:n]
        return dataclasses.replace(part, wi=wi, wo=wo, f=f)

    @property
    def cos_i(self) -> np.ndarray:
        """|cosθi| of each cell (n,), of light from either side."""
        if self.rows is not None:
            deferred: Any = DeferredValues(lambda some: np.abs(self.wi.z[some]), self.rows.shape[:1])
            return deferred
        return np.abs(np.asarray(self.wi.z))

    @property
    def sides(self) -> list[tuple[int, int]]:
        """The sides of the sample, 1 in front and −1 behind, of (light, detector) in its cells."""
        if self.rows is not None:
            number = self.rows.tally.sides
        else:
            light, detector = (np.asarray(w.z) < 0 for w in (self.wi, self.wo))
            number = np.bincount(2 * light + detector, minlength=4)  # of cells with each of the four pairs
        return [(1 - 2 * (k // 2), 1 - 2 * (k % 2)) for k in np.flatnonzero(number).tolist()]

    def on_sides(self, light: int, detector: int) -> "Iterator[Readings]":
        """The readings with light and detector on these sides, in parts."""
        for part in self.parts():
            here = (light * np.asarray(part.wi.z) > 0) & (detector * np.asarray(part.wo.z) > 0)
            yield part.part(np.flatnonzero(here))

    def brightness(self, light: int, detector: int) -> float:
        """Sum of the valid readings there in units of its standard uncertainty; infinite where that is 0."""
        total = variance = 0.0
        for part in self.on_sides(light, detector):
            f, u = (a[part.valid] for a in (part.f, np.nan_to_num(part.u_f)))
            total, variance = total + float(f.sum()), variance + float(np.sum(u**2))
        noise = math.sqrt(variance)
        return total / noise if noise else math.copysign(math.inf, total) if total else 0.0

    @property
    def count(self) -> int:
        """Number of valid readings, channels counted apart."""
        return int(np.count_nonzero(self.valid)) if self.rows is None else int(self.rows.tally.valid.sum())

    @property
    def counts(self) -> np.ndarray:
        """Number of valid readings of each channel (C,)."""
        return np.count_nonzero(self.valid, axis=0) if self.rows is None else self.rows.tally.valid

    @property
    def complete(self) -> bool:
        """Whether all are valid."""
        return bool(self.valid.all()) if self.rows is None else self.count == math.prod(self.rows.shape)

    @property
    def negative(self) -> int:
        """Number of valid readings below 0."""
        if self.rows is not None:
            return self.rows.tally.negative
        return int(np.count_nonzero(self.valid & (self.f < 0)))

    @property
    def noisy(self) -> bool:
        """Whether any has a standard uncertainty above 0."""
        if self.rows is not None:
            return self.rows.tally.known > 0
        return isinstance(self.u_f, InverseWeights) or bool((self.u_f > 0).any())

    def directions(self, rows: Rows) -> tuple[Direction, Direction]:
        """(wi, wo) of some of the cells."""
        if self.rows is not None:
            return self.rows.directions(rows)
        wi, wo = (Direction(*(np.asarray(c)[rows] for c in w)) for w in (self.wi, self.wo))
        return wi, wo

    def by_cell(self, of_pairs: Callable[[Direction, Direction], np.ndarray]) -> np.ndarray:
        """A function of the directions, for each of the cells (n,)."""
        if self.rows is None:
            return of_pairs(self.wi, self.wo)
        of_pairs(*self.directions(slice(0, 1)))  # what it refuses it refuses now
        deferred: Any = DeferredValues(lambda some: of_pairs(*self.directions(some)), self.rows.shape[:1])
        return deferred

    def part(self, cells: Rows) -> "Readings":
        """The readings of some of the cells."""
        wi, wo = self.directions(cells)
        cell_weight = None if self.cell_weight is None else self.cell_weight[cells]
        if self.rows is not None:
            return Readings(wi, wo, *self.rows.values(cells), cell_weight, self.half_angles)
        f, u_f, valid = (rows_of(a, cells) for a in (self.f, self.u_f, self.valid))
        return Readings(wi, wo, f, u_f, valid, cell_weight, self.half_angles)

    def parts(self) -> "Iterator[Readings]":
        """All readings in turn: together, or as many at a time as are read from their table."""
        return iter([self]) if self.rows is None else map(self.part, self.rows.spans)

    def chunks(self, channels: int) -> Iterator[slice]:
        """Slices of the cells whose values in so many channels stay in a cache; what is read together is not parted."""
        spans = [slice(0, self.f.shape[0])] if self.rows is None else self.rows.spans
        for span in spans:
            for some in chunks(span.stop - span.start, channels):
                yield slice(span.start + some.start, span.start + some.stop)

    def channel(self, c: int) -> "Readings":
        """The readings of one channel."""
        return self.of_channels(slice(c, c + 1))

    def of_channels(self, these: slice | np.ndarray) -> "Readings":
        """The readings of some channels."""
        if not isinstance(these, slice) and np.array_equal(these, np.arange(self.f.shape[1])):
            return self
        if self.rows is not None:
            other = Readings.stored(self.rows.of_channels(these))
            return dataclasses.replace(other, cell_weight=self.cell_weight, half_angles=self.half_angles)
        return dataclasses.replace(self, f=self.f[:, these], u_f=self.u_f[:, these], valid=self.valid[:, these])

    def __reduce__(self) -> Any:
        # A table may be an open file: what goes to another process are the readings.
        values = dataclasses.replace(self.in_memory, rows=None)
        return Readings, tuple(getattr(values, field.name) for field in dataclasses.fields(self))


def evenly_spaced(channels: int, most: int) -> np.ndarray:
    """Indices of at most so many channels, the first and the last among them."""
    if most >= channels:
        return np.arange(channels)
    numbers = np.linspace(0, channels - 1, most).astype(int)
    return numbers[np.diff(numbers, prepend=-1) > 0]


def stored_readings(table: Table, theta_max: float | None = None) -> Readings | None:
    """The same of all cells of a large table, which stay in it; None for others."""
    if table.layout.size * len(table.channels) < STORED:
        return None
    rows = TableRows(table, theta_max)
    n, channels = rows.shape
    return Readings.stored(rows) if n >= FEWEST_STORED and n * channels >= STORED else None


def readings_of(table: Table, limit: int | None = None, theta_max: float | None = None, seed: int = 0) -> Readings:
    """The valid readings of a table (both directions nearer to a normal than `theta_max`, radians)."""
    if limit is None and not isinstance(table.f, np.ndarray):
        cells = table.valid_cells(theta_max)
        if cells.size == table.layout.size:
            return _all_readings(table)
    block: Block = table.samples(limit=limit, theta_max=theta_max, seed=seed)
    n, channels = block.f.shape
    shape = block_shape(n, channels)
    # Laid out at once where a fit on all readings wants them: the largest arrays then exist once.
    wi, wo = (laid_directions(w, channels) for w in (block.wi, block.wo))
    valid = (np.asarray(block.flag) == Flag.VALID) & np.isfinite(block.f)
    # Reading f where it is masked would carry a NaN into sums: the value there is never looked at again.
    f = block.f if valid.all() else np.where(valid, block.f, 0.0)
    f = in_blocks(np.asarray(f), (*shape, channels)).reshape(-1, channels)[:n]
    return Readings(wi, wo, f, np.asarray(block.u_f, float), valid)


def _all_readings(table: Table) -> Readings:
    """The readings of all cells of a table that is read block by block: no array of it exists twice."""
    n, channels = table.layout.size, len(table.channels)
    shape = block_shape(n, channels)

    def empty(fill: float, *more: int) -> np.ndarray:
        return in_blocks(np.full((1, *more), fill), (*shape, *more), fill).reshape(-1, *more)[:n]

    wi, wo = (Direction(*(empty(e) for e in NORMAL)) for _ in range(2))
    f, valid, known = empty(0.0, channels), np.empty((n, channels), bool), table.u_f is not None
    u_f = empty(0.0, channels) if known else np.broadcast_to(np.nan, f.shape)
    for start, stop in table.blocks():
        rows, values = slice(start, stop), table.read_values(start, stop)
        for w, part in zip((wi, wo), table.layout.directions(start, stop), strict=True):
            for c, of_block in zip(w, part, strict=True):
                np.asarray(c)[rows] = of_block
        valid[rows] = (values["flag"] == Flag.VALID) & np.isfinite(values["f"])
        f[rows] = np.where(valid[rows], values["f"], 0.0)
        if table.u_f is not None:
            u_f[rows] = values["u_f"]
            known = known and bool((valid[rows] & np.isfinite(u_f[rows]) & (u_f[rows] > 0)).all())
    if known:
        np.divide(1.0, u_f, out=u_f)
    uncertainty: Any = InverseWeights(u_f) if known else u_f
    return Readings(wi, wo, f, uncertainty, valid)


def count_readings(table: Table, readings: Readings) -> dict[str, int]:
    """Readings of a table (cells × channels) by what became of them in a fit.

    `used`; `negative` of those used, which count as they are; `missing`: never measured; `below_horizon`, `shadowed`,
    `saturated`, `invalid`: masked for that reason; `left_out`: valid, but beyond the angle or the number asked for.
    """
    of_table = table.counts() if readings.rows is None else readings.rows.flags
    used = readings.count
    return {
        "used": used,
        "negative": readings.negative,
        "missing": of_table["not_measured"],
        **{flag: of_table[flag] for flag in MASKED},
        "left_out": max(0, of_table["valid"] - used),
    }


def coarse_cells(readings: Readings, limit: int, seed: int) -> np.ndarray:
    """At most `limit` cells for the first descents, sorted: half of them even over cells, half over the half angle.

    A narrow lobe fills few cells of a uniform grid: by cell alone, a start would miss it. The half angle is
    cut where its tangent doubles.
    """
    n = readings.f.shape[0]
    if n <= limit:
        return np.arange(n)
    rng = np.random.default_rng(seed)
    band = np.concatenate([_bands(readings, some) for some in readings.chunks(1)])
    rare = np.bincount(band, minlength=BANDS[1] - BANDS[0] + 1) < RARE * limit
    # All cells of rare bands and some of the others are enough to choose from.
    sample = rng.choice(n, min(n, 8 * limit), replace=False)
    considered = rare[band]
    considered[sample] = True
    among, even = rng.permutation(np.flatnonzero(considered)), sample[: limit // 2]
    among = among[np.argsort(band[among], kind="stable")]
    counts = np.bincount(band[among])
    rank = np.arange(among.size) - np.repeat(np.cumsum(counts) - counts, counts)
    # First of each band, second of each, ...: bands with few cells give all they have.
    by_band = among[np.argsort(rank, kind="stable")[:limit]]
    by_band = by_band[~np.isin(by_band, even)]
    return np.sort(np.concatenate([even, by_band[: limit - even.size]]))


def _bands(readings: Readings, some: slice) -> np.ndarray:
    """Of some cells, how often tan²θh doubles from the first of `BANDS` on."""
    tiny = np.finfo(float).tiny
    wi, wo = readings.directions(some)
    # What goes straight through is as narrow as what is mirrored: both directions in front.
    i, o = (turned_over(w, np.sign(w.z)) for w in (wi, wo))
    h = [np.asarray(a) + np.asarray(b) for a, b in zip(i, o, strict=True)]
    tan2 = (h[0] * h[0] + h[1] * h[1]) / np.maximum(h[2] * h[2], tiny)
    return np.clip(np.frexp(np.maximum(tan2, tiny))[1], *BANDS).astype(np.int8) - np.int8(BANDS[0])


def chunks(n: int, channels: int) -> Iterator[slice]:
    """Slices of n cells whose values stay in a cache."""
    rows = max(1, CHUNK // channels)
    return (slice(first, min(first + rows, n)) for first in range(0, n, rows))


def block_of(channels: int) -> int:
    """Samples of a block: what a core's cache holds of their residuals and derivatives."""
    return max(64, 512 >> max(0, (channels - 1).bit_length() - 2))


def block_shape(n: int, channels: int) -> tuple[int, int]:
    """(blocks, a multiple of those of a page, samples of a block) that hold n samples."""
    block = block_of(channels)
    return max(1, -(-n // (block * PAGE))) * PAGE, block


def in_blocks(
    a: np.ndarray, shape: tuple[int, ...], fill: float = 0.0, fresh: bool = False, into: np.ndarray | None = None
) -> np.ndarray:
    """Values (n, ...) laid out in blocks (B, block, ...), padded with `fill`, where XLA reads them without a copy.

    What is laid out already, as by `readings_of`, is taken as it stands, unless a `fresh` array is asked for or numbers
    that they are written `into`, as many as the shape has.
    """
    number = math.prod(shape)
    base = None if fresh or into is not None else a.base
    if isinstance(base, np.ndarray) and base.size == number * 8 + ALIGNED and base.dtype == np.uint8:
        start = -base.ctypes.data % ALIGNED
        laid = a.shape[1:] == shape[2:] and a.flags.c_contiguous and a.dtype == np.float64
        if laid and a.ctypes.data == base.ctypes.data + start:
            return base[start : start + 8 * number].view(np.float64).reshape(shape)
    if into is None:
        raw = np.empty(8 * number + ALIGNED, np.uint8)
        start = -raw.ctypes.data % ALIGNED
        into = raw[start : start + 8 * number].view(np.float64)
    whole = into.reshape(shape)
    flat = whole.reshape(-1, *shape[2:])
    flat[: a.shape[0]] = a
    flat[a.shape[0] :] = fill
    return whole


def laid_directions(w: Direction, channels: int) -> Direction:
    """Directions (n,) where the programs of so many channels read them without a copy."""
    n = np.size(w.z)
    shape = block_shape(n, channels)
    return Direction(
        *(in_blocks(np.asarray(c, float), shape, e).reshape(-1)[:n] for c, e in zip(w, NORMAL, strict=True))
    )


def uses_cosine(loss: str) -> bool:
    """Whether the loss compares f cosθi rather than f."""
    return loss in ("cbrt", "log")


def transform(loss: str, v: Any, floor: Any, xp: ModuleType = jnp) -> tuple[Any, Any]:
    """(T(v), T'(v)) of a loss; shapes of v."""
    return transformed(loss, v, floor, xp), transform_slope(loss, v, floor, xp)


def transform_slope(loss: str, v: Any, floor: Any, xp: ModuleType = np) -> Any:
    """T'(v) of a loss; shape of v."""
    if loss == "cbrt":
        return (1.0 - (2.0 / 3.0) * (v * v / (v * v + floor * floor))) * _inverse_root(v, floor, xp)
    if loss in ("log", "log1p"):
        return 1.0 / ((floor if loss == "log" else 1.0) + xp.abs(v))
    return xp.ones_like(v)


def transformed(loss: str, v: Any, floor: Any, xp: ModuleType = np) -> Any:
    """T(v) of a loss; shape of v."""
    if xp is np and np.size(v) >= MANY and np.ndim(floor) == 0 and loss not in IDENTITIES and usable():
        program = _loop(loss)
        values = program and program.bound([np.asarray(floor, float)])([np.ravel(v)], (np.size(v),))
        if values is not None:
            return values.reshape(np.shape(v))
    if loss == "cbrt":
        return v * _inverse_root(v, floor, xp)
    if loss in ("log", "log1p"):
        return xp.sign(v) * xp.log1p(xp.abs(v) / (floor if loss == "log" else 1.0))
    return v


@functools.cache
def _loop(loss: str) -> Program | None:
    """T of a loss as a loop over numbers, where the processor has one."""

    def formula(leaves: Sequence[Any], v: Any) -> Any:
        return transformed(loss, v, leaves[0], jnp)

    try:
        return Program(formula, [np.zeros(())], ((0,),), np.float64)
    except Unsupported:
        return None


def _inverse_root(v: Any, floor: Any, xp: ModuleType) -> Any:
    s = v * v + floor * floor
    return 1.0 / np.cbrt(s) if xp is np else inverse_cube_root(s)


def floor_of(loss: str, compared: np.ndarray) -> float:
    """The floor of a loss: a hundredth of the median size of what is compared (1 where the loss has none)."""
    if loss != "cbrt" or not compared.size:
        return 1.0
    typical = float(np.median(np.abs(compared), overwrite_input=True))
    if typical == 0.0:
        typical = float(np.max(np.abs(compared)))
    return 0.01 * typical if typical > 0 else 1.0


def inverse_cube_root(s: Any) -> Array:
    """s^(−1/3) for normal s > 0, any shape; to 2e-16 in double precision.

    A first guess within 4 % from the exponent [Kahan 1991], then two steps of fifth order for 1 − s y³ = 0: vectorised,
    and fourteen times as fast as `jnp.cbrt` (libm, one number at a time), which serves other precisions.
    """
    s = jnp.asarray(s)
    if s.dtype != jnp.float64:
        return 1.0 / jnp.cbrt(s)
    bits = jax.lax.bitcast_convert_type(jax.lax.stop_gradient(s), jnp.int64).astype(s.dtype)
    y = jax.lax.bitcast_convert_type((_GUESS - bits / 3.0).astype(jnp.int64), s.dtype)
    for _ in range(2):
        e = 1.0 - s * y * y * y
        y = y + y * (e * (1 / 3 + e * (2 / 9 + e * (14 / 81 + e * (35 / 243)))))
    return y


def sigma_of(readings: Readings) -> np.ndarray | None:
    """The standard uncertainties to weight with (n, C), or None where none is known.

    Unknown (NaN) and exact (0) cells among known ones get the median: they then weigh as an ordinary cell.
    """
    if isinstance(readings.u_f, InverseWeights):
        return readings.u_f  # all are known
    if readings.rows is not None:
        return _stored_sigma(readings)
    known = readings.valid & np.isfinite(readings.u_f) & (readings.u_f > 0)
    if not known.any():
        return None
    if known.all():
        return readings.u_f
    return np.where(known, readings.u_f, np.median(readings.u_f[known]))


def _stored_sigma(readings: Readings) -> np.ndarray | None:
    """The same of readings that stay in their table."""
    number = 0 if readings.rows is None else readings.rows.tally.known
    if number in (0, readings.f.size):
        return readings.u_f if number else None

    def known(part: Readings) -> np.ndarray:
        return part.valid & np.isfinite(part.u_f) & (part.u_f > 0)

    typical = median_of_parts(lambda: (part.u_f[known(part)] for part in readings.parts()))

    def sigma(some: Rows) -> np.ndarray:
        part = readings.part(some)
        return np.where(known(part), part.u_f, typical)

    deferred: Any = DeferredValues(sigma, readings.f.shape)
    return deferred


def relative_sigma(readings: Readings, f: np.ndarray, share: float) -> np.ndarray:
    """Standard uncertainties (n, C) that are a share of |f| (n, C), with a floor of 1e-6 of its median."""
    typical = np.median(np.abs(f[readings.valid]))
    return share * np.maximum(np.abs(f), 1e-6 * typical if typical > 0 else 1.0)


def residual_weights(readings: Readings, loss: str, sigma: np.ndarray | None) -> np.ndarray:
    """Weight of each residual (n, C): 0 where there is no reading, 1/σ with the loss `sigma`, times √cell_weight."""
    if loss == "sigma" and sigma is None:
        raise GonioError(NO_UNCERTAINTY)
    if isinstance(sigma, InverseWeights) and loss == "sigma" and readings.cell_weight is None:
        return sigma.weight  # the same array
    if readings.rows is not None:
        return _stored_weights(readings, loss, sigma)
    n, channels = readings.valid.shape
    # Laid out at once where the problem wants them.
    weight = in_blocks(np.ones((1, channels)), (*block_shape(n, channels), channels)).reshape(-1, channels)[:n]
    if loss != "sigma" or sigma is None:
        weight[:] = 1.0
    else:
        np.divide(1.0, sigma, out=weight)
    if not readings.valid.all():
        weight[~readings.valid] = 0.0
    if readings.cell_weight is not None:
        share = readings.cell_weight / np.mean(readings.cell_weight)
        weight *= np.sqrt(share)[:, None]
    return weight


def _stored_weights(readings: Readings, loss: str, sigma: np.ndarray | None) -> np.ndarray:
    """The same of readings that stay in their table."""
    of_cells, mean = readings.cell_weight, 1.0
    if of_cells is not None:
        total = sum(float(np.sum(of_cells[some])) for some in readings.chunks(1))
        mean = total / readings.f.shape[0]

    def weights(some: Rows) -> np.ndarray:
        valid = readings.valid[some]
        weight = 1.0 / sigma[some] if loss == "sigma" and sigma is not None else np.ones(valid.shape)
        if not valid.all():
            weight[~valid] = 0.0
        return weight if of_cells is None else weight * np.sqrt(of_cells[some] / mean)[:, None]

    deferred: Any = DeferredValues(weights, readings.f.shape)
    return deferred


def loss_floor(readings: Readings, loss: str) -> float:
    """The floor ε of a loss, in the units of what it compares.

    The median standard uncertainty of the readings (times cosθi where the loss has it) for `cbrt` and `log`; without
    one, a hundredth of the median reading for `cbrt`, and 1 for the others.
    """
    sigma = sigma_of(readings) if uses_cosine(loss) else None
    if readings.rows is not None and (sigma is not None or loss == "cbrt"):
        return _stored_floor(readings, loss, sigma)
    cosine = readings.cos_i[:, None] if uses_cosine(loss) else 1.0
    if sigma is not None:
        return float(np.median((sigma * cosine)[readings.valid]))
    if loss != "cbrt":
        return 1.0
    compared = readings.f * cosine
    return floor_of(loss, compared if readings.valid.all() else compared[readings.valid])


def _stored_floor(readings: Readings, loss: str, sigma: np.ndarray | None) -> float:
    """The same of readings that stay in their table."""
    values = readings.f if sigma is None else sigma

    def compared() -> Iterator[np.ndarray]:
        channels = readings.f.shape[1]
        return (np.abs(values[s] * readings.cos_i[s, None])[readings.valid[s]] for s in readings.chunks(channels))

    typical = median_of_parts(compared)
    if sigma is not None:
        return typical
    typical = typical or max(float(part.max(initial=0.0)) for part in compared())
    return 0.01 * typical if typical > 0 else 1.0


def cell_weights(weight: str, layout: Layout, wi: Direction, wo: Direction) -> np.ndarray:
    """Weights (n,) of the squared residuals at these directions, up to a factor.

    `solid-angle`: dωi dωo of the cells; `cosine`: cosθi cosθo; `projected-solid-angle`: their product, so that what
    counts is reflected power. GonioError for another name, and where scattered samples have no cells.
    """
    if weight not in WEIGHTS:
        raise GonioError(f"Unknown weight '{weight}'; {nearest(weight, WEIGHTS)}")
    cosines = np.abs(np.asarray(wi.z) * np.asarray(wo.z))
    if weight == "cosine":
        return cosines
    cells = layout.solid_angles(wi, wo)
    if cells is None:
        raise GonioError("Scattered samples have no cells to weigh by solid angle; leave --weight out for this table.")
    return cells * cosines if weight == "projected-solid-angle" else cells

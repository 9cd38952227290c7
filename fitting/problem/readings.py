"""From a table to the samples of a fit: which cells, weighted how, in blocks of one size."""

import dataclasses
import math

import numpy as np

from gonio.data.flags import Flag
from gonio.data.table import Block, Table
from gonio.fitting.problem.blocks import PAGE, Samples, block_of
from gonio.fitting.problem.losses import floor_of, transform, uses_cosine
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import NORMAL, Direction

ALIGNED = 64  # bytes: what XLA asks of memory that it may use without a copy
BANDS = (-20, 12)  # exponents of tan²θh from 1e-6 to 4e3
CHUNK = 1 << 15  # samples whose intermediate values stay in a cache
RARE = 2  # bands of fewer cells than this many times those wanted are taken whole


@dataclasses.dataclass(frozen=True)
class Readings:
    """The usable readings of a table: directions (n,), values, standard uncertainties and validity (n, channels)."""

    wi: Direction
    wo: Direction
    f: np.ndarray
    u_f: np.ndarray
    valid: np.ndarray
    measure: np.ndarray | None = None  # (n,) solid-angle weight of each cell

    @property
    def count(self) -> int:
        """Number of valid readings, channels counted apart."""
        return int(np.count_nonzero(self.valid))

    def part(self, cells: np.ndarray) -> "Readings":
        """The readings of some of the cells."""
        wi, wo = (Direction(*(np.asarray(c)[cells] for c in w)) for w in (self.wi, self.wo))
        measure = None if self.measure is None else self.measure[cells]
        return Readings(wi, wo, self.f[cells], self.u_f[cells], self.valid[cells], measure)

    def channel(self, c: int) -> "Readings":
        """The readings of one channel."""
        one = slice(c, c + 1)
        return Readings(self.wi, self.wo, self.f[:, one], self.u_f[:, one], self.valid[:, one], self.measure)


def readings_of(table: Table, limit: int | None = None, theta_max: float | None = None, seed: int = 0) -> Readings:
    """The valid readings of a table with both directions above the horizon (and below `theta_max`, radians)."""
    block: Block = table.samples(limit=limit, theta_max=theta_max, seed=seed)
    n, channels = block.f.shape
    shape = _held(n, channels)
    # Laid out at once where a fit on all readings wants them: the largest arrays then exist once.
    wi, wo = (
        Direction(*(in_blocks(np.asarray(c, float), shape, e).reshape(-1)[:n] for c, e in zip(w, NORMAL, strict=True)))
        for w in (block.wi, block.wo)
    )
    valid = (np.asarray(block.flag) == Flag.VALID) & np.isfinite(block.f)
    # Reading f where it is masked would carry a NaN into sums: the value there is never looked at again.
    f = np.asarray(block.f if valid.all() else np.where(valid, block.f, 0.0), float)
    return Readings(wi, wo, f, np.asarray(block.u_f, float), valid)


def sigma_of(readings: Readings) -> np.ndarray | None:
    """The standard uncertainties to weight with (n, channels), or None where none is known.

    Unknown (NaN) and exact (0) cells among known ones get the median: they then weigh as an ordinary cell.
    """
    known = readings.valid & np.isfinite(readings.u_f) & (readings.u_f > 0)
    if not known.any():
        return None
    return np.where(known, readings.u_f, np.median(readings.u_f[known]))


def weights_of(readings: Readings, loss: str, sigma: np.ndarray | None) -> np.ndarray:
    """Weight of each residual (n, channels): 0 where there is no reading, 1/σ with the loss `sigma`."""
    weight = np.where(readings.valid, 1.0, 0.0)
    if loss == "sigma":
        if sigma is None:
            raise GonioError(
                "The loss 'sigma' needs standard uncertainties above 0, and this table has none; choose another loss."
            )
        weight = weight / np.where(readings.valid, sigma, 1.0)
    if readings.measure is not None:
        share = readings.measure / np.mean(readings.measure)
        weight = weight * np.sqrt(share)[:, None]
    return weight


def _held(n: int, channels: int) -> tuple[int, int]:
    """(blocks, a multiple of those of a page, samples of a block) that hold n samples."""
    block = block_of(channels)
    return max(1, -(-n // (block * PAGE))) * PAGE, block


def blocked(readings: Readings, loss: str, weight: np.ndarray, floor: float | None = None) -> tuple[Samples, float]:
    """(samples in blocks, ‖weighted targets‖²) of the readings for a loss."""
    n, channels = readings.f.shape
    shape = _held(n, channels)
    cosine = np.asarray(readings.wi.z)[:, None] if uses_cosine(loss) else None
    if floor is None:
        floor = floor_of(loss, (readings.f if cosine is None else readings.f * cosine)[readings.valid])
    wi, wo = (
        Direction(*(in_blocks(np.asarray(c), shape, e) for c, e in zip(w, NORMAL, strict=True)))
        for w in (readings.wi, readings.wo)
    )
    target, weight = in_blocks(readings.f, (*shape, channels)), in_blocks(weight, (*shape, channels))
    flat, target_norm_squared = target.reshape(-1, channels), 0.0
    for first in range(0, n, CHUNK):
        some = slice(first, min(first + CHUNK, n))
        compared = flat[some] if cosine is None else flat[some] * cosine[some]
        flat[some] = transform(loss, compared, floor, np)[0]
        target_norm_squared += float(np.sum((weight.reshape(-1, channels)[some] * flat[some]) ** 2))
    used = np.asarray(-(-n // shape[1]))
    return Samples(wi, wo, target, weight, used, np.asarray(float(floor))), target_norm_squared


def in_blocks(a: np.ndarray, shape: tuple[int, ...], fill: float = 0.0) -> np.ndarray:
    """Values (n, ...) laid out in blocks (B, block, ...), padded with `fill`, where XLA reads them without a copy.

    Directions that are laid out already (by `readings_of`) are taken as they stand.
    """
    number = math.prod(shape)
    base = a.base
    if a.ndim == 1 and isinstance(base, np.ndarray) and base.size == number * 8 + ALIGNED and base.dtype == np.uint8:
        start = -base.ctypes.data % ALIGNED
        if a.ctypes.data == base.ctypes.data + start and a.dtype == np.float64:
            return base[start : start + 8 * number].view(np.float64).reshape(shape)
    raw = np.empty(8 * number + ALIGNED, np.uint8)
    start = -raw.ctypes.data % ALIGNED
    whole = raw[start : start + 8 * number].view(np.float64).reshape(shape)
    flat = whole.reshape(-1, *shape[2:])
    flat[: a.shape[0]] = a
    flat[a.shape[0] :] = fill
    return whole


def coarse_cells(readings: Readings, limit: int, seed: int) -> np.ndarray:
    """At most `limit` cells for the first descents, sorted: half of them even over cells, half over the half angle.

    A narrow lobe fills few cells of a uniform grid: drawn by cell alone, a start would not see it. The half angle is
    cut where its tangent doubles.
    """
    n = readings.f.shape[0]
    if n <= limit:
        return np.arange(n)
    rng = np.random.default_rng(seed)
    h = [np.asarray(a) + np.asarray(b) for a, b in zip(readings.wi, readings.wo, strict=True)]
    tan2 = (h[0] * h[0] + h[1] * h[1]) / np.maximum(h[2] * h[2], np.finfo(float).tiny)
    band = np.clip(np.frexp(np.maximum(tan2, np.finfo(float).tiny))[1], *BANDS).astype(np.int8)
    counts = np.bincount(band - np.int8(BANDS[0]))
    # All cells of rare bands and a draw of the others are enough to choose from.
    rare = np.zeros(BANDS[1] - BANDS[0] + 1, bool)
    rare[: counts.size] = counts < RARE * limit
    drawn = rng.choice(n, min(n, 8 * limit), replace=False)
    considered = rare[band - np.int8(BANDS[0])] if rare.any() else np.zeros(n, bool)
    considered[drawn] = True
    among, even = rng.permutation(np.flatnonzero(considered)), drawn[: limit // 2]
    among = among[np.argsort(band[among], kind="stable")]
    counts = np.bincount(band[among] - np.int8(BANDS[0]))
    rank = np.arange(among.size) - np.repeat(np.cumsum(counts) - counts, counts)
    # First of each band, second of each, ...: bands with few cells give all they have.
    by_band = among[np.argsort(rank, kind="stable")[:limit]]
    considered[:] = False
    considered[even] = True
    by_band = by_band[~considered[by_band]]
    return np.sort(np.concatenate([even, by_band[: limit - even.size]]))

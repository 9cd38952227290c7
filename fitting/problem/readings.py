"""The readings of a table that a fit uses, a subsample of them, and their layout in blocks for compiled programs."""

import dataclasses
import math
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from gonio.data.flags import Flag
from gonio.data.table import Block, Table
from gonio.models.geometry.directions import NORMAL, Direction

PAGE = 16  # blocks of a page
LANES = 16  # vectors of free numbers that a program takes side by side
AnyArray = jax.Array | np.ndarray
ALIGNED = 64  # bytes: what XLA asks of memory that it may use without a copy
CHUNK = 1 << 15  # samples whose intermediate values stay in a cache
MASKED = ("below_horizon", "shadowed", "saturated", "invalid")
BANDS = (-20, 12)  # exponents of tan²θh from 1e-6 to 4e3
RARE = 2  # bands of fewer cells than this many times those wanted are taken whole


@dataclasses.dataclass(frozen=True)
class Readings:
    """The usable readings of a table: directions (n,), values, standard uncertainties and validity (n, C)."""

    wi: Direction
    wo: Direction
    f: np.ndarray
    u_f: np.ndarray
    valid: np.ndarray
    cell_weight: np.ndarray | None = None  # (n,) weight of each cell's squared residuals, up to a factor

    @property
    def count(self) -> int:
        """Number of valid readings, channels counted apart."""
        return int(np.count_nonzero(self.valid))

    def part(self, cells: np.ndarray) -> "Readings":
        """The readings of some of the cells."""
        wi, wo = (Direction(*(np.asarray(c)[cells] for c in w)) for w in (self.wi, self.wo))
        cell_weight = None if self.cell_weight is None else self.cell_weight[cells]
        return Readings(wi, wo, self.f[cells], self.u_f[cells], self.valid[cells], cell_weight)

    def channel(self, c: int) -> "Readings":
        """The readings of one channel."""
        one = slice(c, c + 1)
        return dataclasses.replace(self, f=self.f[:, one], u_f=self.u_f[:, one], valid=self.valid[:, one])


def readings_of(table: Table, limit: int | None = None, theta_max: float | None = None, seed: int = 0) -> Readings:
    """The valid readings of a table with both directions above the horizon (and below `theta_max`, radians)."""
    block: Block = table.samples(limit=limit, theta_max=theta_max, seed=seed)
    n, channels = block.f.shape
    shape = block_shape(n, channels)
    # Laid out at once where a fit on all readings wants them: the largest arrays then exist once.
    wi, wo = (
        Direction(*(in_blocks(np.asarray(c, float), shape, e).reshape(-1)[:n] for c, e in zip(w, NORMAL, strict=True)))
        for w in (block.wi, block.wo)
    )
    valid = (np.asarray(block.flag) == Flag.VALID) & np.isfinite(block.f)
    # Reading f where it is masked would carry a NaN into sums: the value there is never looked at again.
    f = np.asarray(block.f if valid.all() else np.where(valid, block.f, 0.0), float)
    return Readings(wi, wo, f, np.asarray(block.u_f, float), valid)


def count_readings(table: Table, readings: Readings) -> dict[str, int]:
    """Readings of a table (cells × channels) by what became of them in a fit.

    `used`; `negative` of those used, which count as they are; `missing`: never measured; `below_horizon`, `shadowed`,
    `saturated`, `invalid`: masked for that reason; `left_out`: valid, but beyond the angle or the number asked for.
    """
    of_table, used = table.counts(), readings.count
    return {
        "used": used,
        "negative": int(np.count_nonzero(readings.valid & (readings.f < 0))),
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
    h = [np.asarray(a) + np.asarray(b) for a, b in zip(readings.wi, readings.wo, strict=True)]
    tan2 = (h[0] * h[0] + h[1] * h[1]) / np.maximum(h[2] * h[2], np.finfo(float).tiny)
    band = np.clip(np.frexp(np.maximum(tan2, np.finfo(float).tiny))[1], *BANDS).astype(np.int8) - np.int8(BANDS[0])
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


def block_of(channels: int) -> int:
    """Samples of a block: what a core's cache holds of their residuals and derivatives."""
    return max(64, 512 >> max(0, (channels - 1).bit_length() - 2))


class Samples(NamedTuple):
    """Samples of a fit in blocks, padded with weight 0. B blocks, a multiple of `PAGE`, of n samples, C channels."""

    wi: Direction  # components (B, n)
    wo: Direction
    target: Float[AnyArray, "B n C"]  # T(y c)
    weight: Float[AnyArray, "B n C"]
    blocks: AnyArray  # how many of the B are in use
    floor: AnyArray  # of the loss


def pages(whole: Samples) -> list[Samples]:
    """The pages in use, each as `Samples` of `PAGE` blocks, without copies."""
    used, parts = int(whole.blocks), []
    for first in range(0, used, PAGE):
        cut = slice(first, first + PAGE)
        wi, wo = (Direction(*(c[cut] for c in w)) for w in (whole.wi, whole.wo))
        blocks = np.asarray(min(PAGE, used - first))
        parts.append(Samples(wi, wo, whole.target[cut], whole.weight[cut], blocks, whole.floor))
    return parts


def block_shape(n: int, channels: int) -> tuple[int, int]:
    """(blocks, a multiple of those of a page, samples of a block) that hold n samples."""
    block = block_of(channels)
    return max(1, -(-n // (block * PAGE))) * PAGE, block


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

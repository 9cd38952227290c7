"""From a table to the samples of a fit: which cells, weighted how, in blocks of one size."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from gonio.data.flags import Flag
from gonio.data.table import Block, Table
from gonio.fitting.equations import BLOCK, Samples
from gonio.fitting.losses import floor_of, transform, uses_cosine
from gonio.models.errors import GonioError
from gonio.models.geometry import Direction

BLOCK_COUNTS = (1, 2, 8, 32, 128, 512, 2048, 8192)  # padded to one of these: one compiled program each
SHARED_BLOCKS = 128  # up to here padding few samples to the size of all costs less than compiling once more


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
    f = np.asarray(block.f, float)
    # Reading f where it is masked would carry a NaN into sums: the value there is never looked at again.
    valid = (np.asarray(block.flag) == Flag.VALID) & np.isfinite(f)
    return Readings(block.wi, block.wo, np.where(valid, f, 0.0), np.asarray(block.u_f, float), valid)


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


def blocked(
    readings: Readings, loss: str, weight: np.ndarray, floor: float | None = None, beside: int = 0
) -> tuple[Samples, float]:
    """(samples in blocks, ‖weighted targets‖²) of the readings for a loss.

    `beside`: a number of cells whose padded size these may share, so that both compile as one program.
    """
    n = readings.f.shape[0]
    used = -(-n // BLOCK)
    held, other = (next((b for b in BLOCK_COUNTS if b * BLOCK >= size), -(-size // BLOCK)) for size in (n, beside))
    if other <= SHARED_BLOCKS:
        held = max(held, other)
    compared = readings.f * np.asarray(readings.wi.z)[:, None] if uses_cosine(loss) else readings.f
    floor = floor_of(loss, compared[readings.valid]) if floor is None else floor
    target = transform(loss, compared, floor, np)[0]
    size2 = float(np.sum((weight * target) ** 2))

    def laid(a: np.ndarray, fill: float) -> jnp.ndarray:
        padded = np.full((held * BLOCK, *a.shape[1:]), fill)
        padded[:n] = a
        return jnp.asarray(padded.reshape(held, BLOCK, *a.shape[1:]))

    up = (0.0, 0.0, 1.0)
    wi, wo = (
        Direction(*(laid(np.asarray(c), e) for c, e in zip(w, up, strict=True))) for w in (readings.wi, readings.wo)
    )
    samples = Samples(wi, wo, laid(target, 0.0), laid(weight, 0.0), jnp.asarray(used), jnp.asarray(float(floor)))
    return samples, size2


def coarse_cells(readings: Readings, limit: int, seed: int) -> np.ndarray:
    """At most `limit` cells for the first descents: half of them even over cells, half even over the half angle.

    A narrow lobe fills few cells of a uniform grid: drawn by cell alone, a start would not see it.
    """
    n = readings.f.shape[0]
    if n <= limit:
        return np.arange(n)
    rng = np.random.default_rng(seed)
    even = rng.choice(n, limit // 2, replace=False)
    h = [np.asarray(a) + np.asarray(b) for a, b in zip(readings.wi, readings.wo, strict=True)]
    theta_h = np.arctan2(np.hypot(h[0], h[1]), h[2])
    edges = np.geomspace(1e-3, np.pi / 2, 33)
    band = np.searchsorted(edges, theta_h)
    order = rng.permutation(n)
    by_band = order[np.argsort(band[order], kind="stable")]
    counts = np.bincount(band, minlength=edges.size + 1)
    share = -(-(limit - limit // 2) // max(1, np.count_nonzero(counts)))
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    picked = [by_band[s : s + min(c, share)] for s, c in zip(starts, counts, strict=True)]
    return np.unique(np.concatenate([even, *picked]))[: 2 * limit]

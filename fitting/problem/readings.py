"""The readings of a table that a fit uses, and how many it does not use, by reason."""

import dataclasses

import numpy as np

from gonio.data.flags import Flag
from gonio.data.table import Block, Table
from gonio.fitting.problem.blocks import block_shape, in_blocks
from gonio.models.geometry.directions import NORMAL, Direction

CHUNK = 1 << 15  # samples whose intermediate values stay in a cache
MASKED = ("below_horizon", "shadowed", "saturated", "invalid")


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

"""Readings of an instrument in some cells of a layout: values, uncertainties and flags."""

import dataclasses
import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from gonio.data.flags import Flag
from gonio.data.layouts import Layout
from gonio.data.material import Material
from gonio.data.tabulate import BLOCK_CELLS, block_rows, grid_values
from gonio.instrument import aperture, noise
from gonio.instrument.edge_loss import seen_by
from gonio.instrument.instrument import EVERYWHERE, Instrument
from gonio.models.brdf import AbstractBRDF
from gonio.models.display import percent
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.folded import seen_from
from gonio.models.geometry.directions import Direction

FLOOR = 1e-8
"""1/sr; no instrument resolves less, and tails below it need no relative accuracy."""
LEAST_CELLS = 1 << 15
"""Cells of a block at least, of however many channels: fewer would not hide the cost of a call."""
FLAT_BLOCK = 1 << 14
"""Cells of a block whose readings are averages over rays: some seconds of work at most, even for narrow lobes."""
SHARE_OF_NOISE = 0.02
"""An error of the aperture average this small beside the standard uncertainty does not matter."""


@dataclasses.dataclass(frozen=True)
class WorstAverage:
    """Where the average over the apertures was worst, over all cells so far."""

    excess: float
    """Error over what was allowed."""
    relative: float
    """Error over the reading."""
    cell: int
    theta_i_deg: float
    theta_o_deg: float

    @staticmethod
    def of(a: "WorstAverage | None", b: "WorstAverage | None") -> "WorstAverage | None":
        """The worse; of equals that of the lower cell, in whatever order they come."""
        if a is None or b is None:
            return a or b
        return min(a, b, key=lambda w: (-w.excess, w.cell))

    def sentence(self) -> str:
        """A remark for the user."""
        return (
            f"the average over the apertures is not resolved everywhere: at theta_i = {self.theta_i_deg:.4g}°, "
            f"theta_o = {self.theta_o_deg:.4g}° its error is {percent(self.relative)} of the reading, "
            f"{self.excess:.2g} times what is allowed; use smaller apertures, or a larger tolerance"
        )


class BlockReadings(NamedTuple):
    """Readings of some cells, each (n, channels), and their worst aperture average.

    `u_f` is None for an instrument without noise: 0 everywhere.
    """

    f: np.ndarray
    u_f: np.ndarray | None
    flag: np.ndarray
    worst: WorstAverage | None


class Expected(NamedTuple):
    """Expected readings but for the gain (n, channels), irradiance by the table's angle (n,), the worst average."""

    values: np.ndarray
    irradiance: np.ndarray
    worst: WorstAverage | None


class Reader:
    """One measurement's readings, cell by cell; any cut into blocks gives the same bits."""

    def __init__(
        self, material: Material, instrument: Instrument, layout: Layout, seed: int, seconds: np.ndarray | None = None
    ) -> None:
        # Without an array of its own: a layout may have more cells than fit into memory.
        self.seconds = np.broadcast_to(instrument.seconds, layout.size) if seconds is None else seconds
        """Counting time of each cell."""
        self.counts_evenly = seconds is None
        self.material, self.instrument, self.layout, self.seed = material, instrument, layout, seed
        self.errors = instrument.systematic_errors(seed)
        self.brdf, self.edge_loss = seen_by(material.brdf, instrument)
        self.channels = len(material.channels)
        self.noisy = instrument.has_noise
        self.dtype = np.dtype(jnp.result_type(float))
        # Where nothing but the model is to be evaluated, whole rows of the layout go to the quick kernel.
        self.by_rows = not instrument.has_apertures and self.errors.aligned
        self.most_cells = max(BLOCK_CELLS // self.channels, LEAST_CELLS)

    @property
    def block_cells(self) -> int:
        """Cells that are best read at once: a number of values that needs little memory, of however many channels."""
        return self.layout.row_size * block_rows(self.layout, self.most_cells) if self.by_rows else FLAT_BLOCK

    def read(self, start: int, stop: int) -> BlockReadings:
        """The readings of the cells start..stop; with `by_rows` these are whole rows."""
        flag = self._flags(start, stop)
        usable = flag == Flag.VALID
        values, irradiance, worst = self._expected(start, stop, usable)
        expected = self.errors.gain * np.broadcast_to(values, (stop - start, self.channels))
        if self.errors.offset:
            expected = expected + self.errors.offset / (np.pi * irradiance[:, None])
        flag = np.repeat(flag[:, None], self.channels, axis=1)
        finite = np.isfinite(expected)
        if not finite.all():
            # An interpolated table answers NaN where nobody looked.
            missing = Flag.NOT_MEASURED if self.material.expression is None else Flag.INVALID
            flag[~finite & usable[:, None]] = missing
            expected = np.where(finite, expected, 0.0)
        if not self.noisy:
            return BlockReadings(_masked(expected, flag), None, flag, worst)
        exposure = self.seconds[start:stop] / self.instrument.seconds
        readings, full = noise.read(self.instrument, self.seed, start, expected, irradiance, self.errors.gain, exposure)
        u_f = noise.standard_uncertainty(self.instrument, expected, irradiance, self.errors.gain, exposure)
        flag[full & (flag == Flag.VALID)] = Flag.SATURATED
        return BlockReadings(_masked(readings, flag), _masked(u_f, flag), flag, worst)

    def _flags(self, start: int, stop: int) -> np.ndarray:
        readable = self.layout.readable(start, stop)
        flag = np.where(readable, np.uint8(Flag.VALID), np.uint8(Flag.BELOW_HORIZON))
        if self.instrument.shadow:
            wi, wo = self.layout.directions(start, stop)
            chord = np.sqrt(sum((a - b) ** 2 for a, b in zip(wi, wo, strict=True)))
            # Behind the sample too: a detector just below the horizon may stand in light that grazes.
            flag[readable & (2 * np.arcsin(np.minimum(0.5 * chord, 1.0)) < self.instrument.shadow)] = Flag.SHADOWED
        if self.instrument.ranges != EVERYWHERE:
            reached = self.instrument.reaches(self.layout.angles(start, stop))
            flag[~reached & (flag == Flag.VALID)] = Flag.NOT_MEASURED
        return flag

    def _expected(self, start: int, stop: int, usable: np.ndarray) -> Expected:
        brdf, layout = self.brdf, self.layout
        if self.by_rows:
            rows = slice(start // layout.row_size, -(-stop // layout.row_size))
            values = grid_values(brdf, layout, rows.start, rows.stop, self.most_cells).reshape(stop - start, -1)
            lit = self.noisy or self.errors.offset
            cosine = np.abs(layout.cosines(start, stop)[0]) if lit else np.ones(1)
            return Expected(values, np.where(usable, cosine, 1.0).astype(self.dtype), None)
        source = self.instrument.source_half_angle
        wi, wo = layout.directions(start, stop)
        sides = np.where(np.stack([wi.z, wo.z]) < 0, -1, 1)
        nominal = np.where(usable, aperture.irradiance(sides[0] * wi.z, source), 1.0)
        share = np.ones(stop - start)
        if not self.errors.aligned:
            wi, wo = self.errors.true_directions(layout.angles(start, stop))
            share = aperture.irradiance(sides[0] * wi.z, source) / nominal
        cells = np.flatnonzero(usable)
        wi, wo = (Direction(*(np.asarray(c)[cells] for c in w)) for w in (wi, wo))
        values, worst = self._values(wi, wo, sides[:, cells], nominal[cells], start + cells)
        every = np.zeros((stop - start, values.shape[1]), self.dtype)
        every[cells] = values * share[cells, None]
        return Expected(every, nominal.astype(self.dtype), worst)

    def _values(
        self, wi: Direction, wo: Direction, sides: np.ndarray, irradiance: np.ndarray, cells: np.ndarray
    ) -> tuple[np.ndarray, WorstAverage | None]:
        """(values (n, C), the worst average) of cells with light and detector on these sides (2, n)."""
        if not cells.size:
            return np.zeros((0, self.channels)), None
        if not self.instrument.has_apertures:
            return evaluate_in_blocks(self.brdf, wi, wo), None
        values, worst = np.zeros((cells.size, self.channels)), None
        for light, detector in {(int(a), int(b)) for a, b in np.unique(sides, axis=1).T}:
            here = np.flatnonzero((sides[0] == light) & (sides[1] == detector))
            pair = [Direction(w.x[here], w.y[here], s * w.z[here]) for w, s in ((wi, light), (wo, detector))]
            brdf = seen_from(self.brdf, light, detector)
            values[here], of_side = self._averages(brdf, (pair[0], pair[1]), irradiance[here], cells[here])
            worst = WorstAverage.of(worst, of_side)
        return values, worst

    def _averages(
        self, brdf: AbstractBRDF, pair: tuple[Direction, Direction], irradiance: np.ndarray, cells: np.ndarray
    ) -> tuple[np.ndarray, WorstAverage]:
        """Averages over the apertures, in front of the sample, and the worst of them."""
        instrument = self.instrument
        half_angles = instrument.source_half_angle, instrument.detector_half_angle
        values, error = aperture.average(brdf, *pair, *half_angles, lambda f, k: self._tolerance(f, irradiance[k]))
        excess = np.nan_to_num(error / self._tolerance(values, irradiance), posinf=0.0)
        k, channel = np.unravel_index(np.argmax(excess), excess.shape)
        cell, most = int(cells[k]), float(excess[k, channel])
        theta_i, _, theta_o, _ = (math.degrees(a[0]) for a in self.layout.angles(cell, cell + 1))
        relative = float(error[k, channel] / max(abs(values[k, channel]), FLOOR)) if most else 0.0
        return values, WorstAverage(most, relative, cell, theta_i, theta_o)

    def _tolerance(self, values: np.ndarray, irradiance: np.ndarray) -> np.ndarray:
        """Error allowed to averages, 1/sr."""
        allowed = self.instrument.tolerance * np.maximum(np.abs(values), FLOOR)
        if not self.noisy:
            return allowed
        return np.maximum(allowed, SHARE_OF_NOISE * noise.standard_uncertainty(self.instrument, values, irradiance))


def _masked(values: np.ndarray, flag: np.ndarray) -> np.ndarray:
    return np.where(flag == Flag.VALID, values, np.asarray(np.nan, values.dtype))

"""What an instrument reads in some cells of a layout: values, uncertainties and flags."""

import dataclasses
import math

import jax.numpy as jnp
import numpy as np

from gonio.data.flags import Flag
from gonio.data.layouts import HORIZON, Layout
from gonio.data.material import Material
from gonio.data.tabulate import grid_values
from gonio.instrument import aperture, noise
from gonio.instrument.instrument import Instrument, true_directions
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction

FLOOR = 1e-8
"""1/sr; no instrument resolves less, and tails below it need no relative accuracy."""
SHARE_OF_NOISE = 0.02
"""An error of the aperture average this small beside the standard uncertainty does not matter."""
FLAT_BATCH = 1 << 14


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

    def to_dict(self) -> dict:
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, told: dict | None) -> "WorstAverage | None":
        return None if told is None else cls(**told)

    @staticmethod
    def of(a: "WorstAverage | None", b: "WorstAverage | None") -> "WorstAverage | None":
        """The worse; of equals that of the lower cell, in whatever order they come."""
        if a is None or b is None:
            return a or b
        return min(a, b, key=lambda w: (-w.excess, w.cell))

    def sentence(self) -> str:
        """What a user should know of it."""
        return (
            f"the average over the apertures is not resolved everywhere: at theta_i = {self.theta_i_deg:.4g}°, "
            f"theta_o = {self.theta_o_deg:.4g}° its error is {100 * self.relative:.2g} % of the reading, "
            f"{self.excess:.2g} times what is allowed; use smaller apertures, or a larger tolerance"
        )


class Reader:
    """One measurement's readings, cell by cell; any cut into blocks gives the same bits."""

    def __init__(self, material: Material, instrument: Instrument, layout: Layout, seed: int):
        self.material, self.instrument, self.layout, self.seed = material, instrument, layout, seed
        self.errors = instrument.systematic_errors(seed)
        self.channels = len(material.channels)
        self.noisy = instrument.has_noise
        self.dtype = np.dtype(jnp.result_type(float))
        # Where nothing but the model is to be evaluated, whole rows of the layout go to the quick kernel.
        self.by_rows = not instrument.has_apertures and self.errors.aligned

    def read(self, start: int, stop: int) -> tuple[np.ndarray, np.ndarray | None, np.ndarray, WorstAverage | None]:
        """(f, u_f, flag) of the cells start..stop, each (n, channels), and the worst aperture average.

        `u_f` is None for an instrument without noise: 0 everywhere. With `by_rows` start and stop are whole rows.
        """
        flag = self._flags(start, stop)
        usable = flag == Flag.VALID
        expected, irradiance, worst = self._expected(start, stop, usable)
        expected = self.errors.gain * np.broadcast_to(expected, (stop - start, self.channels))
        flag = np.repeat(flag[:, None], self.channels, axis=1)
        found = np.isfinite(expected)
        if not found.all():
            # An interpolated table answers NaN where nobody looked.
            missing = Flag.NOT_MEASURED if self.material.expression is None else Flag.INVALID
            flag[~found & usable[:, None]] = missing
            expected = np.where(found, expected, 0.0)
        if not self.noisy:
            return _masked(expected, flag), None, flag, worst
        made, full = noise.read(self.instrument, self.seed, start, expected, irradiance, self.errors.gain)
        u_f = noise.standard_uncertainty(self.instrument, expected, irradiance, self.errors.gain)
        flag[full & (flag == Flag.VALID)] = Flag.SATURATED
        return _masked(made, flag), _masked(u_f, flag), flag, worst

    def _flags(self, start, stop):
        if not self.instrument.shadow:
            above = self.layout.above_horizon(start, stop)
            return np.where(above, np.uint8(Flag.VALID), np.uint8(Flag.BELOW_HORIZON))
        wi, wo = self.layout.directions(start, stop)
        apart = 2 * np.arcsin(np.minimum(0.5 * np.sqrt(sum((a - b) ** 2 for a, b in zip(wi, wo, strict=True))), 1.0))
        flag = np.where(apart < self.instrument.shadow, np.uint8(Flag.SHADOWED), np.uint8(Flag.VALID))
        flag[~((wi.z > HORIZON) & (wo.z > HORIZON))] = Flag.BELOW_HORIZON
        return flag

    def _expected(self, start, stop, usable):
        """(expected reading but for the gain, irradiance by the table's angle, worst average or None)."""
        brdf, layout = self.material.brdf, self.layout
        if self.by_rows:
            rows = slice(start // layout.row_size, -(-stop // layout.row_size))
            values = grid_values(brdf, layout, rows.start, rows.stop).reshape(stop - start, -1)
            if not self.noisy:
                return values, None, None
            return values, np.where(usable, layout.cosines(start, stop)[0], 1.0).astype(self.dtype), None
        source = self.instrument.source_half_angle
        wi, wo = layout.directions(start, stop)
        reckoned = np.where(usable, aperture.irradiance(wi.z, source), 1.0)
        share = np.ones(stop - start)
        if not self.errors.aligned:
            wi, wo = (Direction(*w) for w in true_directions(self.errors, layout.angles(start, stop)))
            share = aperture.irradiance(wi.z, source) / reckoned
        at = np.flatnonzero(usable)
        wi, wo = (Direction(*(np.asarray(c)[at] for c in w)) for w in (wi, wo))
        values, worst = self._values(wi, wo, reckoned[at], start + at)
        whole = np.zeros((stop - start, values.shape[1]), self.dtype)
        whole[at] = values * share[at, None]
        return whole, reckoned.astype(self.dtype), worst

    def _values(self, wi, wo, irradiance, cells):
        instrument = self.instrument
        if not instrument.has_apertures:
            return self._point_values(wi, wo), None
        half = instrument.source_half_angle, instrument.detector_half_angle

        def allowed(values, at):
            return self._allowed(values, irradiance[at])

        values, error = aperture.average(self.material.brdf, wi, wo, *half, allowed)
        return values, self._worst(cells, values, error, self._allowed(values, irradiance))

    def _point_values(self, wi, wo):
        count = wi.x.size
        parts = [np.zeros((0, self.channels), self.dtype)]
        for at in range(0, count, FLAT_BATCH):
            batch = [Direction(*(_padded(c[at : at + FLAT_BATCH]) for c in w)) for w in (wi, wo)]
            values = np.asarray(evaluate(self.material.brdf, *batch)).reshape(FLAT_BATCH, -1)
            parts.append(np.broadcast_to(values, (FLAT_BATCH, self.channels)))
        return np.concatenate(parts)[:count]

    def _allowed(self, values, irradiance):
        allowed = self.instrument.tolerance * np.maximum(np.abs(values), FLOOR)
        if not self.noisy:
            return allowed
        return np.maximum(allowed, SHARE_OF_NOISE * noise.standard_uncertainty(self.instrument, values, irradiance))

    def _worst(self, cells, values, error, allowed):
        if not cells.size:
            return None
        excess = error / allowed
        excess = np.where(np.isfinite(excess), excess, 0.0)
        k, channel = np.unravel_index(np.argmax(excess), excess.shape)
        cell = int(cells[k])
        theta_i, _, theta_o, _ = (math.degrees(a[0]) for a in self.layout.angles(cell, cell + 1))
        relative = float(error[k, channel] / max(abs(values[k, channel]), FLOOR)) if excess[k, channel] else 0.0
        return WorstAverage(float(excess[k, channel]), relative, cell, theta_i, theta_o)


def _padded(values):
    return np.pad(values, (0, FLAT_BATCH - values.size), mode="edge")


def _masked(values, flag):
    return np.where(flag == Flag.VALID, values, np.asarray(np.nan, values.dtype))

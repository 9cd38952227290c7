"""The rim of a table: the last ring of readings against those before it."""

import math
from typing import Any

import numpy as np

from gonio.checks.certificate import NOT_APPLICABLE, Property, verdict_of, without_residual
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.pairs.pairs import FEWEST
from gonio.checks.table.statistics.quantiles import median
from gonio.data.angles import SLACK
from gonio.data.flags import Flag
from gonio.data.table import Table
from gonio.models.geometry.sides import side_in_words

LIGHT_MAX = np.radians(70)
RIM = np.radians(75)
RINGS = 4
"""The last ones: a line through two shows a jump of the next, and the bend of the one before."""
BENDS = 2.0
"""How much more log f may bend at the last ring than at the one before."""
BLOCK = 1 << 19
"""Readings that are looked at together."""
MEDIAN_OF_NORMAL = 0.6745
"""Median of |x| of a standard normal deviate x."""


def table_horizon(evidence: TableEvidence, tolerance: float) -> Property:
    """How far the last ring of readings is from the extrapolation of the two before, in e-folds: the median below 70°.

    In the flank of a narrow lobe log f bends everywhere, and more so towards the horizon: the bound is twice what the
    ring before it is off those before itself. A jump there is the sign of a sample too small for the beam, of a blocked
    arm, or of a shifted axis. Of both sides of a sample the one with the larger jump decides; what goes through may end
    at an angle of its own.
    """
    judged = []
    for (light, detector), part in evidence.table.parts().items():
        if light != detector:
            continue
        rim = _rim(part, tolerance, evidence)
        for name, side in (("theta_i", light), ("theta_o", detector)):
            if side < 0 and name in rim.where:
                rim.where[name] = 180.0 - rim.where[name]
        if (light, detector) != (1, 1):
            rim.detail = f"In {side_in_words(light, detector)}: {rim.detail}"
        judged.append(rim)
    if not judged:
        detail = "Not testable: what goes through a sample may end before the horizon."
        return without_residual("horizon", NOT_APPLICABLE, tolerance, detail)
    return max(judged, key=lambda rim: -1.0 if rim.residual is None else rim.residual)


def _rim(table: Table, tolerance: float, evidence: TableEvidence) -> Property:
    grid = table.layout.outgoing_grid()
    if grid is None or grid.theta_o.size < 4:
        return without_residual(
            "horizon", NOT_APPLICABLE, tolerance, "Not testable: the readings lie in no rings of polar angles."
        )
    theta_o, theta_i = grid.theta_o, grid.theta_i
    rings = np.flatnonzero(theta_o < np.pi / 2 - 1e-9)[-RINGS:]
    lit = int(np.count_nonzero(theta_i < LIGHT_MAX - SLACK))
    if rings.size < RINGS:
        detail = f"Not testable: the grid has fewer than {RINGS} rings above the horizon."
        return without_residual("horizon", NOT_APPLICABLE, tolerance, detail)
    apart = np.diff(theta_o[rings])
    steps = apart[1:] / apart[:-1]
    together = max(1, BLOCK * theta_o.size // (rings.size * math.prod(table.shape[1:])))
    parts = [slice(k, min(k + together, lit)) for k in range(0, lit, together)]
    blocks = [_jumps(table, part, rings, steps) for part in parts]
    jump, bend, noise = (np.concatenate(v) for v in zip(*blocks, strict=True)) if blocks else np.zeros((3, 0))
    number = np.count_nonzero(np.isfinite(jump))
    if number < FEWEST or theta_o[rings[-1]] < RIM - SLACK:
        detail = "Not testable: too few positive readings beyond 75°."
        return without_residual("horizon", NOT_APPLICABLE, tolerance, detail)
    residual, bound = median(jump), BENDS * median(bend)
    if np.isfinite(noise).any():
        bound += MEDIAN_OF_NORMAL * median(noise)
    worst = np.unravel_index(np.nanargmax(jump), jump.shape)
    rim = float(np.degrees(theta_o[rings[-1]]))
    where: dict[str, Any] = {"theta_i": float(np.degrees(theta_i[worst[0]])), "theta_o": rim}
    if (channel := evidence.channel(int(worst[-1]))) is not None:
        where["channel"] = channel
    detail = (
        f"The ring of {rim:.4g}° is off the two before by {residual:.2g} e-folds at the median, by {jump[worst]:.2g} at"
        f" the most; the ring before it is off by {median(bend):.2g}."
    )
    return Property("horizon", verdict_of(residual, bound, tolerance), residual, bound, tolerance, where, detail)


def _jumps(table: Table, lit: slice, rings: np.ndarray, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How far the last ring is off the two before, in e-folds, NaN where a reading is not positive; how far the ring
    before it is off those before itself; and the noise of the first.

    All in single precision, of the shape of the table's readings at these incidences but for its polar angles.
    """
    axis = table.layout.dims.index("theta_o")
    place = (lit, *[slice(None)] * (axis - 1), slice(rings[0], rings[-1] + 1))

    def by_ring(values: Any) -> np.ndarray:
        return np.moveaxis(np.asarray(values[place]), axis, 0)

    f = by_ring(table.f).astype(float)
    ok = ((by_ring(table.flag) == Flag.VALID) & (f > 0)).all(axis=0)
    slopes = np.diff(np.log(np.where(ok, f, 1.0)), axis=0)
    bend, jump = (np.where(ok, np.abs(slopes[k + 1] - steps[k] * slopes[k]), np.nan) for k in (0, 1))
    noise, step = np.full(ok.shape, np.nan), float(steps[1])
    if table.u_f is not None:
        with np.errstate(all="ignore"):
            r = (by_ring(table.u_f) / f)[1:]
            noise = np.where(ok, np.sqrt(r[2] ** 2 + ((1 + step) * r[1]) ** 2 + (step * r[0]) ** 2), np.nan)
    noise[np.isinf(noise)] = np.nan
    return jump.astype(np.float32), bend.astype(np.float32), noise.astype(np.float32)

"""Summary of the residuals of a fit: noise or structure, where, and which readings stand out."""

import dataclasses
from typing import Any

import numpy as np

from gonio.data.layouts import Layout
from gonio.fitting.problem.problem import weighted_residuals
from gonio.fitting.problem.readings import Readings, evenly_spaced
from gonio.fitting.residuals.maps import AXES, ResidualMap, map_cells, residual_map
from gonio.fitting.residuals.noise_tests import SIGNIFICANT, NoiseTests, channel_effect, least_noise_like, noise_tests
from gonio.fitting.residuals.pair_angles import PairAngles, neighbour_order, pair_angles
from gonio.fitting.residuals.rare_counts import of_rare_counts
from gonio.fitting.solver.robust_weights import NORMAL_MAD, DownweightedReadings, scales
from gonio.models.display import percent

MAX_CELLS = 1 << 15  # cells that are examined; of more, a random choice
MAX_READINGS = 1 << 18  # of these cells; of more, evenly spaced channels
OUTLYING = 5.0  # scales from which on a reading stands out
CLUSTERED = 0.3  # share of readings in one region from which on the region is named
DOWN_WEIGHTED = 0.5  # share of its weight that a down-weighted reading keeps at most
TENS = tuple(range(0, 181, 10))


@dataclasses.dataclass(frozen=True)
class Evidence:
    """Readings and model values of a fit, and what made residuals of their difference."""

    readings: Readings
    model_f: np.ndarray  # (n, C)
    weight: np.ndarray
    loss: str
    floor: np.ndarray  # one for all channels, or one each
    likelihood: bool
    exact: bool
    free: int
    chi2: float | None
    robust: DownweightedReadings | None = None
    layout: Layout | None = None
    seed: int = 0


@dataclasses.dataclass(frozen=True)
class ResidualSummary:
    """Residuals of a fit: tests, maps, and the readings that stand out.

    `scale`: 1.4826 times the median of |model − reading|/|reading|; `standing_out`: share of readings more than five
    scales (of readings as bright) off; `share_of_cost`: their part of the cost; `down_weighted`: readings that a
    robust fit counts less than half.
    """

    noisiness: NoiseTests
    maps: dict[str, ResidualMap]
    scale: float
    standing_out: float
    share_of_cost: float
    where_standing_out: str
    down_weighted: int
    where_down_weighted: str
    worst_region: str
    sentences: list[str]

    def to_dict(self) -> dict[str, Any]:
        """Everything, as lists, numbers and strings."""
        content = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        content["noisiness"] = dataclasses.asdict(self.noisiness)
        content["maps"] = {name: m.to_dict() for name, m in self.maps.items()}
        return content


def summarise(e: Evidence) -> ResidualSummary:
    """The summary of a fit's residuals, from at most `MAX_CELLS` of its cells and `MAX_READINGS` of their readings."""
    n = e.readings.f.shape[0]
    cells = np.arange(n)
    if n > MAX_CELLS:
        cells = np.sort(np.random.default_rng(e.seed).choice(n, MAX_CELLS, replace=False))
    count = e.readings.f.shape[1]
    channels = evenly_spaced(count, max(1, MAX_READINGS // cells.size))
    subset = e.readings.of_channels(channels).part(cells)
    order = neighbour_order(subset.wi, subset.wo)
    cells, subset = cells[order], subset.part(order)
    examined = np.ix_(cells, channels)
    f, weight, share = e.model_f[examined], e.weight[examined], None if e.robust is None else e.robust.kept[examined]
    floor = e.floor if e.floor.size == 1 else e.floor[channels]
    if share is None:
        used, light = weight > 0, np.zeros(f.shape, bool)
    else:
        # With the weights of least squares, so that what a robust fit counts less shows.
        weight, used = weight / np.sqrt(np.maximum(share, 1e-12)), subset.valid
        light = used & (share < DOWN_WEIGHTED)
    residual = weighted_residuals(subset, e.loss, floor, np.where(used, np.maximum(weight, 0.0), 0.0), f)
    scaled = residual / scales(residual, f, used)
    angles = pair_angles(subset.wi, subset.wo)
    lit = used & (subset.f != 0)
    relative = np.divide(f - subset.f, np.abs(subset.f), out=np.zeros_like(subset.f), where=lit)
    maps = {name: residual_map(angles, relative, lit, axes) for name, axes in AXES.items()}
    orders = (np.arange(cells.size), neighbour_order(subset.wi, subset.wo, by_incidence=True))
    freedom = e.readings.count - e.free
    rare = of_rare_counts(subset.f, f, weight, used) if e.likelihood else np.zeros(f.shape, bool)
    tested = used & ~light & ~rare
    effect = channel_effect(scaled, tested)
    tests = [noise_tests(scaled[o], tested[o], e.chi2, freedom, e.exact, effect) for o in orders]
    far = used & ~rare & (np.abs(scaled) > OUTLYING) & (not e.exact)
    cost = float(np.sum(residual[used] ** 2))
    summary = ResidualSummary(
        least_noise_like(tests), maps,
        scale=NORMAL_MAD * float(np.median(np.abs(relative[lit]))) if lit.any() else float("nan"),
        standing_out=float(np.count_nonzero(far) / max(np.count_nonzero(used), 1)),
        share_of_cost=float(np.sum(residual[far] ** 2) / cost) if cost > 0 else 0.0,
        where_standing_out=_main_region(angles, far),
        down_weighted=0 if e.robust is None else int(np.sum(e.readings.valid & (e.robust.kept < DOWN_WEIGHTED))),
        where_down_weighted=_main_region(angles, light),
        worst_region="" if e.exact else _worst_region(maps["half_difference"], angles, scaled, lit),
        sentences=[],
    )  # fmt: skip
    return dataclasses.replace(summary, sentences=_sentences(summary, e))


def _main_region(angles: PairAngles, chosen: np.ndarray) -> str:
    """The region of 10° by 10° that holds a third of the chosen readings (n, C), or that they are spread."""
    if not chosen.any():
        return ""
    cell = map_cells(angles, ("theta_i", "theta_o"), (TENS, TENS))
    counts = np.bincount(np.broadcast_to(cell[:, None], chosen.shape)[chosen], minlength=18 * 18)
    most = int(np.argmax(counts))
    if counts[most] < CLUSTERED * counts.sum():
        return "spread over the directions"
    share = f"{percent(counts[most] / counts.sum())} of them" if counts[most] < counts.sum() else "all"
    theta_i, theta_o = (10 * k for k in divmod(most, 18))
    return f"{share} at θi {theta_i}–{theta_i + 10}°, θo {theta_o}–{theta_o + 10}°"


def _worst_region(m: ResidualMap, angles: PairAngles, scaled: np.ndarray, used: np.ndarray) -> str:
    """The region whose mean residual is farthest from 0 in standard errors."""
    cell = np.broadcast_to(map_cells(angles, m.axes, m.edges)[:, None], used.shape)[used]
    total = np.bincount(cell, np.clip(scaled[used], -OUTLYING, OUTLYING), minlength=m.count.size)
    if not m.count.any():
        return ""
    most = int(np.argmax(np.abs(total) / np.sqrt(np.maximum(m.count.ravel(), 1))))
    row, column = divmod(most, m.count.shape[1])
    off = m.median_relative[row, column]
    return f"{m.region(row, column)}: the model is {percent(abs(off))} {'brighter' if off > 0 else 'darker'}"


def _sentences(s: ResidualSummary, e: Evidence) -> list[str]:
    t, sentences = s.noisiness, []
    if t.verdict == "noise":
        agree = f"neighbouring directions do not agree (runs test p = {t.runs_p:.2g})"
        exceeds = (
            f"the residuals exceed the stored uncertainties (χ² p = {t.chi2_p:.1g}), which are too small, as {agree}"
        )
        sentences.append(exceeds if t.chi2_p < SIGNIFICANT else f"the residuals are noise: {agree}")
    elif t.verdict == "structure":
        sentences.append(
            f"the residuals are structure, not noise: {percent(t.shared)} of their variance is shared by "
            f"neighbouring directions (runs test z = {t.runs_z:.3g}), most of all at {s.worst_region}"
        )
    elif t.verdict == "unknown":
        sentences.append("too few readings to tell noise from structure")
    if e.robust is not None:
        sentences.append(
            f"robust ({e.robust.kind}): {s.down_weighted} of {e.readings.count} readings count less than half"
            + (f", {s.where_down_weighted}" if s.where_down_weighted else "")
        )
    elif s.share_of_cost > 0.1 and s.standing_out < 0.2:
        sentences.append(
            f"{percent(s.standing_out)} of the readings lie more than {OUTLYING:g} scales off and make "
            f"{percent(s.share_of_cost)} of the cost ({s.where_standing_out}): a robust fit counts them less"
        )
    return sentences

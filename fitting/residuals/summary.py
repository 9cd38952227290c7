"""What a fit leaves over, in one place: noise or structure, where, and which readings stand out."""

import dataclasses

import numpy as np

from gonio.fitting.problem.readings import Readings
from gonio.fitting.problem.residuals import weighted_residuals
from gonio.fitting.residuals.maps import ResidualMap, bins, residual_maps
from gonio.fitting.residuals.noise_tests import SIGNIFICANT, Noisiness, judge, least_like_noise
from gonio.fitting.residuals.pair_angles import PairAngles, neighbour_order, pair_angles
from gonio.fitting.solver.robust_weights import NORMAL_MAD, SetAside, scales

MOST = 1 << 15  # cells that are looked at; of more, a random choice
FAR_OFF = 5.0  # scales from which on a reading stands out
GATHERED = 0.3  # share of some readings in one region, from which on they are said to be there
LIGHT = 0.5  # share of its weight that a down-weighted reading keeps at most


@dataclasses.dataclass(frozen=True)
class Evidence:
    """What a fit ended with: readings, the model there (n, C), and what made residuals of their difference."""

    readings: Readings
    model_f: np.ndarray
    weight: np.ndarray
    loss: str
    floor: np.ndarray  # one for all channels, or one each
    likelihood: bool
    exact: bool
    free: int
    chi2: float | None
    aside: SetAside | None = None
    layout: object | None = None
    seed: int = 0


@dataclasses.dataclass(frozen=True)
class ResidualSummary:
    """Residuals of a fit: tests, maps, and the readings that stand out.

    `scale`: 1.4826 times the median of |model − reading|/|reading|; `standing_out`: share of readings more than five
    scales (of readings as bright) off; `share_of_cost`: what part of the cost they make; `down_weighted`: readings of
    which a robust fit counts less than half.
    """

    noisiness: Noisiness
    maps: dict[str, ResidualMap]
    scale: float
    standing_out: float
    share_of_cost: float
    where_standing_out: str
    down_weighted: int
    where_down_weighted: str
    worst_region: str
    sentences: list[str]

    def to_dict(self) -> dict:
        """Everything, as lists, numbers and strings."""
        kept = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        kept["noisiness"] = dataclasses.asdict(self.noisiness)
        kept["maps"] = {name: m.to_dict() for name, m in self.maps.items()}
        return kept


def summarise(e: Evidence) -> ResidualSummary:
    """The summary of a fit's residuals, from at most `MOST` of its cells."""
    n = e.readings.f.shape[0]
    cells = np.arange(n) if n <= MOST else np.sort(np.random.default_rng(e.seed).choice(n, MOST, replace=False))
    drawn = e.readings.part(cells)
    cells = cells[neighbour_order(drawn.wi, drawn.wo)]
    part, f, weight = e.readings.part(cells), e.model_f[cells], e.weight[cells]
    kept = None if e.aside is None else e.aside.kept[cells]
    if kept is not None:
        # As least squares would weigh them: what was set aside is to be seen.
        weight = weight / np.sqrt(np.maximum(kept, 1e-12))
    used = weight > 0 if kept is None else part.valid
    residual = weighted_residuals(part, e.loss, e.floor, np.where(used, np.maximum(weight, 0.0), 0.0), f)
    scaled = residual / scales(residual, f, used)
    angles = pair_angles(part.wi, part.wo)
    seen = used & (part.f != 0)
    relative = np.divide(f - part.f, np.abs(part.f), out=np.zeros_like(part.f), where=seen)
    maps = residual_maps(angles, relative, seen)
    ordinary = used if kept is None else used & (kept >= LIGHT)
    tests = least_like_noise(
        [
            judge(scaled[o], ordinary[o], e.chi2, e.readings.count - e.free, e.exact)
            for o in (np.arange(cells.size), neighbour_order(part.wi, part.wo, by_incidence=True))
        ]
    )
    far = used & (np.abs(scaled) > FAR_OFF) & (not e.exact)
    cost = float(np.sum(residual[used] ** 2))
    light = np.zeros_like(used) if kept is None else used & (kept < LIGHT)
    lowered = 0 if e.aside is None else int(np.count_nonzero(e.readings.valid & (e.aside.kept < LIGHT)))
    summary = ResidualSummary(
        tests, maps,
        scale=NORMAL_MAD * float(np.median(np.abs(relative[seen]))) if seen.any() else float("nan"),
        standing_out=float(np.count_nonzero(far) / max(np.count_nonzero(used), 1)),
        share_of_cost=float(np.sum(residual[far] ** 2) / cost) if cost > 0 else 0.0,
        where_standing_out=gathered(angles, far),
        down_weighted=lowered, where_down_weighted=gathered(angles, light),
        worst_region="" if e.exact else _worst(maps["half_difference"], angles, scaled, seen),
        sentences=[],
    )  # fmt: skip
    return dataclasses.replace(summary, sentences=_said(summary, e))


def gathered(angles: PairAngles, chosen: np.ndarray) -> str:
    """Where some readings (n, C) are: the region of 10° by 10° that holds a third of them, or that they are spread."""
    if not chosen.any():
        return ""
    i, o = (np.broadcast_to(bins(a, tuple(range(0, 91, 10)))[:, None], chosen.shape)[chosen] for a in angles[:2])
    counts = np.bincount(i * 9 + o, minlength=81)
    most = int(np.argmax(counts))
    if counts[most] < GATHERED * counts.sum():
        return "spread over the directions"
    share = f"{100 * counts[most] / counts.sum():.0f} % of them" if counts[most] < counts.sum() else "all"
    return f"{share} at θi {most // 9 * 10}–{most // 9 * 10 + 10}°, θo {most % 9 * 10}–{most % 9 * 10 + 10}°"


def _worst(m: ResidualMap, angles: PairAngles, scaled: np.ndarray, seen: np.ndarray) -> str:
    """The region whose mean residual is farthest from 0 beside what chance makes of it."""
    shape = m.median_relative.shape
    index = [bins(getattr(angles, a), e) for a, e in zip(m.axes, m.edges, strict=True)]
    cell = np.broadcast_to((index[0] * shape[1] + index[1])[:, None], seen.shape)[seen]
    total = np.bincount(cell, np.clip(scaled[seen], -FAR_OFF, FAR_OFF), minlength=shape[0] * shape[1])
    count = np.bincount(cell, minlength=shape[0] * shape[1])
    if not count.any():
        return ""
    most = int(np.argmax(np.abs(total) / np.sqrt(np.maximum(count, 1))))
    row, column = divmod(most, shape[1])
    off = m.median_relative[row, column]
    return f"{m.region(row, column)}: the model is {100 * abs(off):.2g} % {'brighter' if off > 0 else 'darker'}"


def _said(s: ResidualSummary, e: Evidence) -> list[str]:
    t, said = s.noisiness, []
    if t.verdict == "noise":
        said.append(f"the residuals are noise: neighbouring directions do not agree (runs test p = {t.runs_p:.2g})")
        if t.chi2_p < SIGNIFICANT:
            said.append(f"the residuals exceed the stored uncertainties all the same (χ² p = {t.chi2_p:.1g})")
    elif t.verdict == "structure":
        said.append(
            f"the residuals are structure, not noise: {100 * t.shared:.2g} % of their variance is shared by "
            f"neighbouring directions (runs test z = {t.runs_z:.3g}), most of all at {s.worst_region}; the standard "
            "uncertainties hold for independent noise only, those of a bootstrap for blocks of directions"
        )
    elif t.verdict == "unknown":
        said.append("too few readings to tell noise from structure")
    if e.aside is not None:
        said.append(
            f"robust ({e.aside.kind}): {s.down_weighted} of {e.readings.count} readings count less than half"
            + (f", {s.where_down_weighted}" if s.where_down_weighted else "")
        )
    elif s.share_of_cost > 0.1 and s.standing_out < 0.2:
        said.append(
            f"{100 * s.standing_out:.2g} % of the readings lie more than {FAR_OFF:g} scales off and make "
            f"{100 * s.share_of_cost:.0f} % of the cost ({s.where_standing_out}): a robust fit counts them less"
        )
    return said

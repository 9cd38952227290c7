"""Planning a measurement: the one public function, `plan`, and what it returns."""

import dataclasses
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypedDict, Unpack

import numpy as np

from gonio.data import layouts
from gonio.data.layouts import Layout
from gonio.data.serialise import finite
from gonio.data.subject import SubjectLike, resolve_subject
from gonio.data.table import Table
from gonio.fitting.problem.readings import readings_of
from gonio.instrument.instrument import Instrument
from gonio.instrument.pace import AXES
from gonio.models.display import Displayed
from gonio.models.errors import GonioError
from gonio.planning.limit import least_variance
from gonio.planning.planner import FILLING, Planner, Read, Schedule
from gonio.planning.prior import Prior, prior_of
from gonio.planning.shots import Shots, Sites, counting, write_shots
from gonio.planning.wanted import Quantities, albedos, numbers, quantities

LONGEST = 1e7
"""Seconds of a plan: four months."""
FIRST_GUESS = 600.0
TRIES, MOST_GROWTH = 12, 16.0
STUCK = 0.9
"""Of the uncertainty, still there after twice the time or more: it is not that of counting."""
LEAST_SEPARATION = 1.0
NEAR = 0.02
"""A target is met where the uncertainty is at most so much, as a share, below it."""


class PlanOptions(TypedDict, total=False):
    """Keywords of `gonio.plan`; `help(gonio.plan)` describes each."""

    budget: float | None
    target: float | None
    model: str | None
    wanted: Sequence[str]
    ranges: Mapping[str, tuple[float, float]]
    against: str | None
    space_filling: float
    continued: SubjectLike | None
    lit: str


class PlannedNumber(NamedTuple):
    """A quantity, its standard uncertainty after the plan, and after the best regular scan of equal time (or NaN)."""

    name: str
    value: float
    standard_uncertainty: float
    regular: float


@dataclasses.dataclass(frozen=True, repr=False)
class Plan(Displayed):
    """A planned measurement.

    Attributes:
        name: of what is measured.
        shots: directions (4, n), radians, in their order, and counting seconds (n,).
        hours: of the whole; `way`: of these on the way and settling.
        numbers: what will be known, and how well.
        separation: standard uncertainties by which the rival model will be told apart; None without one.
        regular: the best regular scan of equal hours, which `numbers` compares with.
        advantage: its variance over the plan's, by the plan's criterion: of all numbers the P-th root of the
            determinants' ratio, which shares of correlated numbers count in; NaN where no regular scan fits in.
        limit: share of the plan's variance, by its criterion, that no choice of its candidates of equal hours goes
            below, even if these numbers were known beforehand and no time passed on the way; NaN where systematic
            errors or another model are in it.
        residual, scale: Kiefer-Wolfowitz residual max d − Σ w d of the design, and Σ w d: the number of parameters.
        space_filling: share of the time for directions that fill the range evenly.
        over: least and largest value of the numbers over which the plan is good, as far as it was made for several.
    """

    name: str
    shots: Shots
    hours: float
    way: float
    numbers: list[PlannedNumber]
    separation: float | None
    regular: str
    advantage: float
    limit: float
    residual: float
    scale: float
    space_filling: float
    over: dict[str, tuple[float, float]]

    @property
    def layout(self) -> Layout:
        """The directions as `gonio.measure` takes them; `shots.seconds` are its `seconds`."""
        return layouts.scattered(*self.shots.angles)

    def facts(self) -> dict[str, str]:
        """Shots, hours, numbers and certificate."""
        known = {n.name: f"{n.value:.5g} ± {n.standard_uncertainty:.2g}" for n in self.numbers}
        hours = f"{self.hours:.3g} h, {100 * self.way / self.hours:.0f} % of it on the way"
        certificate = f"no design gains more than {self.residual:.1e} of {self.scale:.3g} (Kiefer-Wolfowitz)"
        return {"of": self.name, "shots": f"{self.shots.seconds.size} in {hours}", **known, "certificate": certificate}

    def to_dict(self) -> dict[str, Any]:
        """Everything, for JSON: angles in degrees; what is not finite is None, and "null" says why."""
        columns = {n: np.degrees(a).round(3).tolist() for n, a in zip(AXES, self.shots.angles, strict=True)}
        known = [n._asdict() for n in self.numbers]
        others = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name not in ("shots", "numbers")}
        return finite({**others, "numbers": known, "shots": columns | {"seconds": self.shots.seconds.tolist()}})

    def save(self, path: str | os.PathLike[str], force: bool = False) -> Path:
        """Writes the path as CSV, which `gonio measure --scan` takes. GonioError where it exists or cannot be."""
        return write_shots(path, self.shots, f"gonio plan of {self.name}", self.hours, force)


def plan(
    subject: SubjectLike | None = None, instrument: Instrument | None = None, **options: Unpack[PlanOptions]
) -> Plan:
    """The directions, counting times and order of readings that determine what is wanted best in the time there is.

    Args:
        subject: a fit, a table, a material or an expression; see `gonio.planning.prior.prior_of`.
        instrument: its noise, speed, ranges and shadow; by default one that counts 1e6 photons/s off white.
        budget: seconds of the whole, travel and settling included.
        target: relative standard uncertainty that the largest of what is wanted may have, in place of a budget.
        model: what will be fitted, as in `gonio.fit`.
        wanted: names of free numbers, "albedo", or "scene:NAME"; by default all free numbers together (D-optimal).
        ranges: in which numbers are thought to be, by name: the plan is good all over them.
        against: another model that the readings are to be told apart from (T-optimal).
        space_filling: share of the time for directions even over the range, against what the model leaves out.
        continued: a table of what was read already, in place of the subject; the plan adds to it.
        lit: the sides of the sample that the light comes from, "front", "back" or "both"; the detector goes wherever
            the model sends light.

    Returns:
        The plan, with what it will leave uncertain and the certificate that no other design does better.

    Raises:
        GonioError: directions that determine no answer, a budget too short, a target out of reach, unknown names.

    References:
        Kiefer & Wolfowitz 1960; Fedorov 1972; Atkinson, Donev & Tobias 2007.
    """
    if unknown := options.keys() - PlanOptions.__annotations__.keys():
        raise TypeError(f"plan has no option '{min(unknown)}'")
    budget, target = options.get("budget"), options.get("target")
    share, rival = options.get("space_filling", FILLING), options.get("against")
    _require(budget, target, share, options.get("wanted"), rival)
    read = options.get("continued")
    if (subject is None) == (read is None):
        raise GonioError("give what to measure, or the table to continue, one of both")
    table = None if read is None else resolve_subject(read).require_table()
    prior = prior_of(subject if table is None else table, options.get("model"), options.get("ranges"))  # pyright: ignore[reportArgumentType]
    wanted, chosen = None, list(options.get("wanted") or [])
    if chosen:
        each = [quantities(prior, p, chosen) for p in prior.draws]
        wanted = np.stack([q.slopes / np.abs(q.values)[:, None] for q in each])
    instrument = counting(instrument or Instrument())
    planner = Planner(
        prior,
        instrument,
        None if rival is None else prior_of(prior.brdf(prior.p), rival),
        wanted,
        None if table is None else _read(prior, table, instrument),
        share,
        options.get("lit", "front"),
    )
    q = quantities(prior, prior.p, chosen) if chosen else numbers(prior, prior.p)
    schedule = planner.schedule(budget) if budget else _for_target(planner, q, target or 0.0)
    return _result(planner, schedule, q)


def _require(
    budget: float | None, target: float | None, share: float, wanted: Sequence[str] | None, rival: str | None
) -> None:
    if (budget is None) == (target is None):
        raise GonioError("give a budget of time or a target of uncertainty, one of both")
    if budget is not None and not 0 < budget <= LONGEST:
        raise GonioError(f"the budget is {budget:g} s; give more than 0 and at most {LONGEST:g} s")
    if target is not None and not 0 < target < 1:
        raise GonioError(f"the target is {target:g}; give a relative uncertainty between 0 and 1, such as 0.01")
    if not 0 <= share < 1:
        raise GonioError(f"the space-filling share is {share:g}; give from 0 to less than 1")
    if rival is not None and (wanted or target is not None):
        raise GonioError("separation from another model has a budget, and nothing else that is wanted; leave these out")


def _read(prior: Prior, table: Table, instrument: Instrument) -> Read:
    """A table's readings, their rows at the likeliest numbers."""
    readings = readings_of(table)
    if not (np.isfinite(readings.u_f) & (readings.u_f > 0))[readings.valid].all():
        raise GonioError("the table to continue has no standard uncertainties; measure with photons or noise")
    angles = np.stack([a for w in (readings.wi, readings.wo) for a in layouts.spherical_angles(*w)])
    sites = Sites.of(prior, instrument, angles, prior.p[None])
    both = np.concatenate([sites.slopes, sites.shifts], axis=-1)[0][readings.valid]
    return Read((both / readings.u_f[readings.valid][:, None])[None, :, None], angles[:, readings.valid.any(axis=1)])


def _uncertainties(q: Quantities, covariance: np.ndarray) -> dict[str, tuple[float, float]]:
    """Value and standard uncertainty by name; rows of one name are one quantity."""
    size = q.slopes.shape[1]
    variances = np.einsum("qi,ij,qj->q", q.slopes, covariance[:size, :size], q.slopes)
    names = list(dict.fromkeys(q.names))
    rows = [np.flatnonzero([n == name for n in q.names]) for name in names]
    return {n: (float(q.values[k[0]]), float(np.sqrt(variances[k].sum()))) for n, k in zip(names, rows, strict=True)}


def _for_target(planner: Planner, q: Quantities, target: float) -> Schedule:
    """The shortest schedule whose largest relative uncertainty is the target."""
    budget, low, high, before = FIRST_GUESS, 0.0, LONGEST, (0.0, math.inf)
    schedule = None
    for _ in range(TRIES):
        try:
            trial = planner.schedule(budget)
        except GonioError:  # too short for the way
            low, budget = budget, 2 * budget
            continue
        reached = max(u / abs(v) for v, u in _uncertainties(q, planner.covariance(trial.shots)).values())
        if reached <= target:
            schedule, high = trial, min(high, budget)
            if reached >= (1 - NEAR) * target:
                return trial
        else:
            if budget >= 2 * before[0] and reached > STUCK * before[1]:
                break
            low, before = max(low, budget), (budget, reached)
        # Variances go with one over the time, but for the way: a little beyond, so that it is reached.
        guess = budget * min(1.015 * (reached / target) ** 2, MOST_GROWTH)
        budget = min(max(guess, 1.001 * low), 0.999 * high)
    if schedule is None:
        raise GonioError(
            f"a target of {target:g} is out of reach: this instrument's noise and systematic errors leave more; give a "
            "larger one"
        )
    return schedule


def _result(planner: Planner, schedule: Schedule, q: Quantities) -> Plan:
    prior, (shots, design, way) = planner.prior, schedule
    seconds = planner.instrument.pace.path_seconds(shots.angles, shots.seconds)
    regular = planner.regular(seconds)
    rival = planner.rival is not None
    separation = planner.separation(shots) if rival else None
    known: list[PlannedNumber] = []
    if separation is not None:
        if separation < LEAST_SEPARATION:
            raise GonioError(
                f"the other model can do what {prior.name} does, to {separation:.2g} standard uncertainties: no "
                "readings of this time tell them apart; plan with the two exchanged, or give more time"
            )
        other = float("nan") if regular is None else planner.separation(regular[1])
        known = [PlannedNumber("separation, in standard uncertainties", separation, 0.0, other)]
    else:
        spread = planner.covariance(shots)
        every = [numbers(prior, prior.p), q, albedos(prior, prior.p)]
        for each in every:
            ours = _uncertainties(each, spread)
            theirs = {} if regular is None else _uncertainties(each, planner.covariance(regular[1]))
            listed = {n.name for n in known}
            known += [
                PlannedNumber(n, *vu, theirs.get(n, (0, float("nan")))[1]) for n, vu in ours.items() if n not in listed
            ]
    advantage = float("nan") if regular is None else planner.advantage(shots, regular[1])
    limit = float("nan")
    if not rival:
        limit = least_variance(planner, seconds) / planner.mean_variance(planner.covariance(shots))
    name = "none fits in" if regular is None else regular[0]
    return Plan(
        prior.name, shots, seconds / 3600, way / 3600, known, separation, name, advantage, limit,
        design.residual, design.scale, planner.space_filling, {} if rival else prior.spread,
    )  # fmt: skip

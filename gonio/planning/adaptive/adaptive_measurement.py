"""Adaptive measurement: the one public function, `adapt`."""

import dataclasses
import math
import os
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypedDict, Unpack

import numpy as np

from gonio.data.files import refuse_outputs
from gonio.data.interpolation.kriging import NAMES
from gonio.data.interpolation.scattered import ASSUMED, MOST
from gonio.data.interpolation.scattered import KEY as LAW
from gonio.data.subject import SubjectLike, load_material
from gonio.data.table import Table
from gonio.instrument.instrument import Instrument
from gonio.instrument.scans import is_isotropic
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.models.expression.parser import parse
from gonio.planning.adaptive.accuracy import (
    FLOOR,
    LEVEL,
    MEASURE,
    Error,
    difference,
    random_directions,
    readings_needed,
    shown,
)
from gonio.planning.adaptive.model_strategy import ModelPrediction
from gonio.planning.adaptive.prediction import Prediction
from gonio.planning.adaptive.session import KEY, Session
from gonio.planning.adaptive.table_strategy import TablePrediction
from gonio.planning.planned import LONGEST
from gonio.planning.ways import Way, ways_of

FIRST = 24
"""Readings to begin with; twice as many of an anisotropic surface."""
FEWEST_CHECKS, USUAL_CHECKS, CHECKS = 20, 40, 100
"""Shots of a check: with little time, at least, and at most; between these as many as there are readings."""
DOUBLED = 3
"""Times that a check has twice as many shots, after others whose error was small but not their bound."""
CHECK_SHARE = 0.2
"""Of the budget that the last check may take."""
EAGER = 0.75
"""Of the target that is expected before it is checked: a bound is larger than the error."""
STALLED, STUCK = 0.9, 0.7
"""Of the error expected before, and shown before, that a model hardly betters."""
HOPELESS = 0.25
"""Of the readings that a table may hold, from which on a target without a budget may be out of reach of more."""
RATIOS = (0.5, 4.0)
"""Of an error to what was expected."""
STRATEGIES: dict[str, Callable[[Session, float], Prediction]] = {
    "table": TablePrediction.of,
    "model": ModelPrediction.of,
}
STREAM = 0xADA7


class AdaptOptions(TypedDict, total=False):
    """Keywords of `gonio.adapt`; `help(gonio.adapt)` describes each."""

    target: float | None
    budget: float | None
    strategy: str
    model: str | None
    hemisphere: str
    lit: str
    output: str | os.PathLike[str] | None
    seed: int
    force: bool
    log: Callable[[str], None] | None
    command: str | None


def adapt(material: SubjectLike, instrument: Instrument | None = None, **options: Unpack[AdaptOptions]) -> Table:
    """Reads a material where the readings so far predict it worst, until an error is shown or the time is spent.

    By the strategy "table" readings are kriged, and each round reads where the mean square of the expected error falls
    most. By "model" a model is fitted, selected anew where its residuals are structure, and the planner chooses what
    its predictions need. What is shown is shown by random directions that the prediction did not use: the error is the
    rms of `MEASURE` (see `gonio.planning.adaptive.accuracy`), and its bound counts their number and noise. What is
    reflected and what is transmitted are predicted by themselves, and the worse of their errors is the one shown.

    Args:
        material: any subject; whether it is isotropic decides whether the light stays at one azimuth.
        instrument: its noise, pace, ranges and shadow; ideal by default.
        target: relative error to be shown, such as 0.01.
        budget: seconds of moving, settling and counting; one of both at least.
        strategy: "table" (the default) or "model".
        hemisphere: "both" (the default, where the material sends light), "reflection" or "transmission".
        lit: "front" (the default), "back" or "both".
        model: of the second, as `gonio.fit` takes it; by default it is selected, and grows.
        output: a file; rounds are kept beside it, and the same call goes on where one was killed.
        seed: of noise, systematic errors and the choice of directions.
        force: replaces an existing output.
        log: takes a line for each round.
        command: the way to ask for this on the command line; the provenance keeps it.

    Returns:
        A table of scattered readings; its provenance holds each round under "adaptive": why, what was expected, what
        was shown; and what predicts, the law of the readings or the model.

    Raises:
        GonioError: neither target nor budget, a budget too short, a file that exists or is of another recipe.
    """
    if unknown := options.keys() - AdaptOptions.__annotations__.keys():
        raise TypeError(f"adapt has no option '{min(unknown)}'")
    target, budget, seed = options.get("target"), options.get("budget"), options.get("seed", 0)
    _require(target, budget, seed)
    output, force = options.get("output"), options.get("force", False)
    if output is not None and isinstance(material, str | os.PathLike):
        refuse_outputs([output], [material], force)
    kept = {"output": output, "force": force, "command": options.get("command")}
    about = {"target": target, "budget_s": budget, "measure": MEASURE, "level": LEVEL}
    about |= _strategy(options.get("strategy", "table"), options.get("model"))
    about |= {"hemisphere": options.get("hemisphere", "both"), "lit": options.get("lit", "front")}
    subject = load_material(material)
    isotropic = is_isotropic(subject.brdf)
    ways = ways_of(subject.brdf, about["lit"], about["hemisphere"])
    assumed = "; ".join(ASSUMED[reciprocal, isotropic].rstrip("; ") for reciprocal in {w.reciprocal for w in ways})
    about["assumed"] = assumed if about["strategy"] == "table" else "the model"
    session = Session.begin(subject, instrument or Instrument(), int(seed), about, **kept)
    loop = _Loop(session, target, budget, options.get("log") or (lambda text: None))
    if session.count:
        loop.log(f"going on with {session.part}: {session.count} readings were there")
    while loop.outcome is None:
        try:
            loop.step()
        except GonioError:  # the same call would end here again
            session.forget()
            raise
        session.save()
    session.about |= loop.outcome
    return session.finish(output, force, **_stated(session.rounds[-1], session.ways))


class Outcome(NamedTuple):
    """What an adaptive measurement ended with: whether the target is shown, the error, and the bound on it."""

    shown: bool
    sentence: str

    @classmethod
    def of(cls, table: Table) -> "Outcome":
        """That of a table's provenance."""
        kept = table.provenance[KEY]
        return cls(bool(kept["shown"]), str(kept["verdict"]))


def _require(target: float | None, budget: float | None, seed: int) -> None:
    if target is None and budget is None:
        raise GonioError("give a target, such as 1%, or a budget of time, such as 2h, or both")
    if target is not None and not 0 < target < 1:
        raise GonioError(f"the target is {target:g}; give a relative error between 0 and 1, such as 0.01")
    if budget is not None and not 0 < budget <= LONGEST:
        raise GonioError(f"the budget is {budget:g} s; give more than 0 and at most {LONGEST:g} s")
    if not (isinstance(seed, int | np.integer) and 0 <= seed < 1 << 64):
        raise GonioError(f"the seed is {seed!r}; give a whole number from 0 to 2^64 − 1")


def _strategy(strategy: str, model: str | None) -> dict[str, Any]:
    if strategy not in STRATEGIES:
        raise GonioError(f"the strategy is {strategy!r}; give {' or '.join(STRATEGIES)}")
    if strategy == "table" and model is not None:
        raise GonioError("a model belongs to the strategy 'model'; leave it out, or give that strategy")
    if model is not None:
        parse(model)
    return {"strategy": strategy, "model": model}


def _stated(last: dict[str, Any], ways: Sequence[Way]) -> dict[str, Any]:
    """The laws by which a table predicts, as its interpolation takes them."""
    if "law" not in last:
        return {}
    laws = [
        {"sides": [way.light, way.detector], "law": dict(zip(NAMES, np.exp(law).tolist(), strict=True))}
        for way, law in zip(ways, last["law"], strict=True)
    ]
    return {LAW: {"laws": laws, "floor": FLOOR}}


@dataclasses.dataclass
class _Loop:
    """One round after another; each depends on the session and its number alone."""

    session: Session
    target: float | None
    budget: float | None
    log: Callable[[str], None]

    @property
    def outcome(self) -> dict[str, Any] | None:
        """Error, bound and verdict, once there is one."""
        rounds = self.session.rounds
        return rounds[-1].get("outcome") if rounds else None

    def step(self) -> None:
        """Begins, reads where it is worst, or checks."""
        session, rng = self.session, np.random.default_rng([self.session.seed, STREAM, len(self.session.rounds)])
        if not session.count:
            self._begin(rng)
            return
        prediction = STRATEGIES[session.about["strategy"]](session, self._ratio())
        # What a model leaves out no more readings of it tell: what is expected of it stays what its numbers leave.
        predicted = prediction.expected(rng)
        expected = predicted if isinstance(prediction, ModelPrediction) else predicted * self._ratio()
        possible, checks = self._affordable()
        facts = {**prediction.facts(), "predicted": predicted, "expected_error": expected}
        hopeless = self._needed(predicted) > MOST
        due = self.target is not None and (expected <= EAGER * self.target or self._stalled(prediction, predicted))
        if possible <= checks or due or hopeless:
            facts |= {"out_of_reach": True} if hopeless else {}
            self._check(prediction, min(checks, possible), possible <= checks or hopeless, facts, rng)
            return
        spare = (
            math.inf if self.budget is None else self.budget - session.seconds() * (1 + FEWEST_CHECKS / session.count)
        )
        shots = prediction.next_shots(session, possible - checks, spare, rng)
        session.read(shots, purpose="refine", why="where a reading lets the expected error fall most", **facts)
        self._report(f"{percent(expected)} expected before")

    def _begin(self, rng: np.random.Generator) -> None:
        session = self.session
        count = FIRST if session.isotropic else 2 * FIRST
        count *= len(session.ways)
        angles = random_directions(count, session.instrument, session.isotropic, rng, session.ways)
        if angles.shape[1] < count:
            raise GonioError("the instrument reaches no direction; give larger ranges, or a smaller shadow")
        shots = session.shots(angles)
        need = session.seconds(shots) * (1 + FEWEST_CHECKS / count)
        if self.budget is not None and need > self.budget:
            raise GonioError(
                f"a budget of {self.budget:g} s is too short: {count} readings to begin with and {FEWEST_CHECKS} to "
                f"check need about {need:.0f} s; give more time"
            )
        session.read(shots, purpose="start", why="random, as the error weighs directions")
        self._report("to begin with")

    def _ratio(self) -> float:
        """The error that the last check showed, over what was expected then."""
        checks = [r for r in self.session.rounds if r["purpose"] == "check"]
        return float(np.clip(checks[-1]["error"] / max(checks[-1]["predicted"], 1e-12), *RATIOS)) if checks else 1.0

    def _needed(self, predicted: float) -> float:
        """Readings that a target without a budget would take, as far as many readings tell; 0 where nothing does."""
        session = self.session
        if self.target is None or self.budget is not None or session.count < HOPELESS * MOST:
            return 0.0
        if session.about["strategy"] != "table":  # a model ends where it is stuck
            return 0.0
        before = [(r["readings"][0], r["predicted"]) for r in session.rounds if "predicted" in r]
        counts, errors = np.array([*before, (session.count, predicted)]).T
        return readings_needed(counts, errors, EAGER * self.target)

    def _affordable(self) -> tuple[int, int]:
        """(readings that time and size allow, those of a check)."""
        room = MOST - self.session.count
        missed = [r for r in self.session.rounds if r["purpose"] == "check" and self._bound_is_wide(r)]
        ways = len(self.session.ways)
        checks = int(np.clip(self.session.count, USUAL_CHECKS * ways, CHECKS * ways)) * 2 ** min(len(missed), DOUBLED)
        if self.budget is None:
            return room, checks
        each = 1.05 * self.session.seconds() / self.session.count
        checks = int(np.clip(CHECK_SHARE * self.budget / each, FEWEST_CHECKS, checks))
        return min(room, int((self.budget - self.session.seconds()) / each)), checks

    def _check(
        self, prediction: Prediction, count: int, last: bool, facts: dict[str, Any], rng: np.random.Generator
    ) -> None:
        session, first = self.session, self.session.count
        random = prediction.check_shots(max(count, FEWEST_CHECKS // 2), rng)
        order = session.short_way(random.angles)
        before, often = prediction.values(random.angles)[order], random.often[order]
        why = "at random, to be compared with the prediction"
        session.read(session.shots(random.angles), purpose="check", why=why, **facts)
        valid = session.valid[first:]
        f, u_f = (session.values[name][first:][valid] for name in ("f", "u_f"))
        d, u = difference(before[valid], f, u_f)
        number = sum(r["purpose"] == "check" for r in session.rounds)
        # All checks together err as often as LEVEL says, and so do those of all sides of the sample.
        level = 1 - (1 - LEVEL) / (number * (number + 1)) / len(session.ways)
        squares, angles = np.mean(d**2 - u**2, axis=1) / often[valid], session.angles[:, first:][:, valid]
        errors = {way.words(): shown(squares[way.reads(angles)], level) for way in session.ways}
        error = _worst(errors)
        reached = self.target is not None and error.bound <= self.target
        session.rounds[-1] |= {"error": error.value, "bound": error.bound, "level": level}
        if len(errors) > 1:
            session.rounds[-1]["by_side"] = {name: e._asdict() for name, e in errors.items()}
        shares = (f"{percent(e.value)} shown, at most {percent(e.bound)}" for e in errors.values())
        names = (f"{name} " if len(errors) > 1 else "" for name in errors)
        self._report("; ".join(name + share for name, share in zip(names, shares, strict=True)))
        if reached or last or self._stuck():
            session.rounds[-1]["outcome"] = self._outcome(errors, reached, first)

    def _bound_is_wide(self, check: dict[str, Any]) -> bool:
        """Whether a check missed the target by its bound alone."""
        return self.target is not None and check["error"] <= self.target < check["bound"]

    def _stalled(self, prediction: Prediction, predicted: float) -> bool:
        """Whether the last readings told a model hardly anything, as where it leaves something out."""
        last = self.session.rounds[-1]
        known = isinstance(prediction, ModelPrediction) and last["purpose"] == "refine"
        return known and predicted > STALLED * last["predicted"]

    def _stuck(self) -> bool:
        """Whether the last two checks were of one model, and missed the target by about as much."""
        checks = [r for r in self.session.rounds if r["purpose"] == "check"][-2:]
        if (
            self.target is None
            or len(checks) < 2
            or len({r.get("model") for r in checks}) > 1
            or "model" not in checks[0]
        ):
            return False
        before, now = (r["error"] for r in checks)
        return min(before, now) > self.target and now > STUCK * before

    def _outcome(self, errors: dict[str, Error], reached: bool, first: int) -> dict[str, Any]:
        session = self.session
        if reached:
            what = "target shown"
        elif session.rounds[-1].get("out_of_reach"):
            what = (
                f"out of reach: as the error fell so far, {percent(float(self.target or 0))} would take more than the "
                f"{MOST} readings that such a table holds (a budget reads on; the strategy 'model' may take few)"
            )
        elif self._stuck():
            what = "no larger model found that does better"
        else:
            what = f"{session.count} readings taken" if session.count >= MOST else "budget spent"
        error = _worst(errors)
        number, sides = sum(e.readings for e in errors.values()), ""
        if len(errors) > 1:
            sides = "; " + ", ".join(f"{name} at most {percent(e.bound)}" for name, e in errors.items())
        verdict = (
            f"{what}: error {percent(error.value)}, at most {percent(error.bound)} ({percent(LEVEL)} sure{sides}), by "
            f"{number} directions that {first} readings were to predict; {session.seconds() / 3600:.3g} h"
        )
        if "model" in session.rounds[-1]:
            verdict += f"; by {session.rounds[-1]['fitted']}"
        hours = session.seconds() / 3600
        return {"shown": reached, "error": error.value, "bound": error.bound, "hours": hours, "verdict": verdict}

    def _report(self, text: str) -> None:
        session = self.session
        self.log(f"round {len(session.rounds)}: {session.count} readings, {session.seconds() / 3600:.3g} h, {text}")


def _worst(errors: dict[str, Error]) -> Error:
    """The error of the pair of sides whose bound is largest."""
    return max(errors.values(), key=lambda e: (e.bound, e.value))

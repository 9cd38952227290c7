"""Readings that should be equal, tested pair by pair and region by region against their stored uncertainties.

Half of the level goes to the single pairs, half to the regions: in a region a violation has a sign (the
larger value is on the same side), so that its mean shows where no single pair does. Beside each p-value stands the size
of the effect: the least violation that would explain it at that level, and the largest that is not excluded, both as
2|a−b|/(|a|+|b|). That separates what is significant but tiny from what is not significant but noisy.
"""

from typing import Any

from gonio.checks.certificate import PASS, UNDECIDED, Property, verdict_of
from gonio.checks.table.level_tests import LevelTests, Violation
from gonio.checks.table.pairs.places import BAND
from gonio.checks.table.regions import region_in_words
from gonio.checks.table.statistics.counts import family_p
from gonio.models.display import percent


def judged_by_level(name: str, tests: LevelTests, tolerance: float, compared: str) -> Property:
    """The property that a family of tests of all pairs and regions decides at the level of the evidence.

    fail: more than the tolerance is needed to explain the readings; pass: no region may differ by more, or those that
    may are so dark that all of it is within the tolerance of the light (`dark_regions`); else undecided.
    `compared`: what was compared with what, and how.
    """
    family, strongest_p, strongest_at = tests.strongest()
    (least, least_where), widest = tests.least(), tests.widest()
    if least > tolerance:
        # Of the violation only its lower limit is claimed.
        residual, bound, where = least, 0.0, least_where
    else:
        residual, where = widest.estimate, widest.where
        bound = max(widest.largest - residual, residual - least)  # no more is claimed than the tests together need
    p_value = float(family_p(family, 2))
    facts = {
        "level": tests.level,
        "p_value": p_value,
        "significant": p_value < tests.level,
        "tests": tests.tests,
        "regions": tests.regions.p.size,
        "least_violation": least,
        "largest_violation": max(widest.largest, least),
        "detectable_in_one_pair": tests.detectable,
        "p_value_by_channel": [tests.p_of_channel(c) for c in range(tests.single.tests.size)],
        "strongest_at": strongest_at,
        "strongest_p": strongest_p,
    }
    verdict = verdict_of(residual, bound, tolerance)
    reason = _reason(verdict, facts, widest, tolerance)
    if verdict == UNDECIDED and not facts["significant"] and (dark := _light_of_dark_regions(tests, tolerance)):
        decided, facts["open_in_the_dark"] = tests.widest(tolerance), dark
        residual, bound, where, verdict = decided.estimate, decided.largest - decided.estimate, decided.where, PASS
        reason = _in_the_dark(widest, decided, dark)
    detail = f"{compared} {_statement(facts, least_where)}{reason}"
    squares, p = tests.single.p_map()
    shown = {"theta_deg": [(i + 0.5) * BAND for i in squares], "p": p.tolist()}
    return Property(name, verdict, residual, bound, tolerance, where, detail, facts, {"p_map": shown})


def _statement(facts: dict[str, Any], least_where: dict[str, Any]) -> str:
    p = f"p = {facts['p_value']:.2g}" if facts["p_value"] > 1e-99 else "p < 1e-99"
    family = f"{p} of a family of {facts['tests'] + facts['regions']:,} tests (level {facts['level']:g})"
    if facts["significant"]:
        return (
            f"differ by more than their uncertainties allow: {family}, strongest: {_words(facts['strongest_at'])}; a"
            f" violation of at least {percent(facts['least_violation'], 3)} is needed to explain it"
            f" ({_words(least_where)})."
        )
    return (
        f"differ by no more than their uncertainties explain: {family}; a single pair would show"
        f" {percent(facts['detectable_in_one_pair'])} at the median."
    )


def _reason(verdict: str, facts: dict[str, Any], widest: Violation, tolerance: float) -> str:
    if verdict == PASS:
        remark = " That is significant, and within the tolerance." if facts["significant"] else ""
        return f" No region of it differs by more than {percent(widest.largest, 3)}.{remark}"
    if verdict != UNDECIDED:
        return ""
    if facts["least_violation"] <= tolerance and not facts["significant"]:
        return (
            f" At {_words(widest.where)} up to {percent(widest.largest, 3)} is not excluded: too noisy to say that it"
            f" is within {percent(tolerance)}."
        )
    most = percent(widest.largest, 3)
    return f" Whether it exceeds the tolerance of {percent(tolerance)} the noise leaves open (up to {most})."


def _light_of_dark_regions(tests: LevelTests, tolerance: float) -> float:
    """The share of the light that open regions may change, if that is all that is open, and within the tolerance."""
    of_allowed, of_light = tests.dark(tolerance)
    return of_light if of_allowed <= 1 and tests.widest(tolerance).largest <= tolerance else 0.0


def _in_the_dark(widest: Violation, decided: Violation, dark: float) -> str:
    """What is said where all but dark regions are decided."""
    return (
        f" Where there is light no region differs by more than {percent(decided.largest, 3)}. Darker ones are too noisy"
        f" to tell, such as {_words(widest.where)} (up to {percent(widest.largest, 3)} of themselves): all that is not"
        f" excluded there is within {percent(dark)} of what the sample scatters at that incidence."
    )


def _words(where: dict[str, Any]) -> str:
    return region_in_words(where)

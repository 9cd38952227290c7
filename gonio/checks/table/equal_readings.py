"""Reciprocity and symmetries of a table: readings that should be equal, pair by pair.

Where uncertainties are stored a family of tests decides at a stated level (`significance`), else the region that
differs most (`regions`). The median difference of all pairs is reported, and decides nothing.
"""

from typing import Any

import numpy as np

from gonio.checks.certificate import (
    FAIL,
    NOT_APPLICABLE,
    NOT_TESTABLE,
    PASS,
    UNDECIDED,
    Property,
    without_residual,
)
from gonio.checks.table.comparison import BETWEEN_READINGS, MAY_BE_INTERPOLATION, Compared, compare, only_surely
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.one_azimuth import (
    is_taken_as_isotropic,
    isotropy_at_normal_incidence,
    one_azimuth,
    unturned,
)
from gonio.checks.table.pairs.displacement import displaced, displacement
from gonio.checks.table.pairs.equal_pairs import some_of
from gonio.checks.table.pairs.pairs import FEWEST, Pairs
from gonio.checks.table.pairs.places import pair_angles
from gonio.checks.table.polarisations import (
    mirrored_states,
    same_states,
    signs_in_words,
    unmatched,
    with_exchanged_states,
)
from gonio.checks.table.regions import MOST_UNCOVERED, uncovered
from gonio.data.interpolation.sheets import sheet_of
from gonio.data.plausibility.copies import EQUAL, MOSTLY
from gonio.data.polarisation import is_polarised
from gonio.models.display import listed, percent
from gonio.models.errors import GonioError
from gonio.models.geometry.sides import Sides

SCATTER = (0.8, 1.25)
"""Scatter of the pairs, in their stated uncertainties, outside of which these are doubted."""

MOST_READINGS = 200_000
MOST_DISPLACED = 200_000
"""Pairs by which it is seen whether the instrument's apertures and alignment explain a difference."""
DISPLACED = (
    " The instrument's unequal apertures or its alignment, as stated, may explain it: where f is steep it changes as"
    " much over {angle:.2g}°."
)
BEYOND = 1.0
"""Degrees that views are steeper than the last incidence, from which on it is said which light is missing."""
LEAST_FACTOR = 0.05
"""|log| of a factor between transmission from the front and from behind that is worth a word."""


MADE_EQUAL = (
    " Exchanged readings are equal to the last digit, although their uncertainties are larger: the table was made"
    " reciprocal, which tells nothing about the surface."
)

MADE_RECIPROCAL = "the surface is as reciprocal as its readings were made"


def table_reciprocity(evidence: TableEvidence, tolerance: float) -> Property:
    """f(wi, wo) = f(wo, wi); not applicable where the layout stores one value for both.

    Where the readings leave it open and the evidence has a model, the exchanged directions are read between the
    readings as the model goes on there.
    """
    judged = _reciprocity(evidence, evidence.pairs("exchanged"), tolerance)
    if judged.verdict in (UNDECIDED, NOT_TESTABLE) and evidence.model is not None:
        judged = _assisted(judged, evidence, tolerance)
    if judged.verdict == UNDECIDED and judged.facts.get("share_not_compared"):
        judged.detail += _of_incidences(evidence)
    return judged


def _assisted(alone: Property, evidence: TableEvidence, tolerance: float) -> Property:
    """The property with the help of the model; a violation is left to the readings."""
    from gonio.checks.table.pairs.assisted_pairs import assisted_pairs

    try:
        fitted = evidence.fitted
    except GonioError as error:  # too few readings for the model
        alone.detail += f" A model does not help: {error}."
        return alone
    assert fitted is not None
    pairs = assisted_pairs(evidence.table, fitted.brdf) if fitted.converged else "its fit did not converge"
    if isinstance(pairs, str):
        alone.detail += f" A model does not help: {pairs}."
        return alone
    helped = _reciprocity(evidence, pairs, tolerance)
    if helped.verdict == FAIL:
        helped.verdict = UNDECIDED
        helped.detail += " Between the readings the model may be wrong: it shows no violation."
    elif helped.verdict == PASS:
        helped.assumes = f"between the readings the surface follows {fitted.requested} as it does at them"
    helped.facts |= {"assisted_by": fitted.expression}
    helped.detail += f" Without the model it is {alone.verdict}: {alone.detail}"
    return helped


def _reciprocity(evidence: TableEvidence, pairs: Pairs | str, tolerance: float) -> Property:
    what = "f(wi, wo) and f(wo, wi)"
    if isinstance(pairs, str):
        return _equal("reciprocity", evidence, pairs, None, tolerance, what)
    names = evidence.table.channels.names
    signs, alone = signs_in_words(pairs, names), unmatched(names)
    pairs = with_exchanged_states(pairs, names)
    if len(alone) == len(names):
        return without_residual(
            "reciprocity", NOT_TESTABLE, tolerance, f"Not testable: the {_of_states(alone)}", pairs=0
        )
    if is_polarised(names):
        what += " of exchanged polarisations"
    untestable = _lit_from_one_side(evidence.table.sides)
    sign = np.sign(np.round(pairs.angles[:, 0] - pairs.angles[:, 2], 9))
    compared = compare(evidence, pairs, sign)
    if not compared.differences.comparable.any():
        reason = (
            f"Not testable: of {pairs.eligible:,} readings none has the exchanged directions beside it.{untestable}"
        )
        return without_residual("reciprocity", NOT_TESTABLE, tolerance, reason, pairs=0, method=pairs.how)
    judged = _judged("reciprocity", evidence, compared, tolerance, what)
    if judged.verdict == FAIL:
        judged = _surely(judged, evidence, pairs, sign, what)
    elif judged.verdict == UNDECIDED and len(pairs.around):
        judged.detail += MAY_BE_INTERPOLATION
    if judged.verdict == FAIL and one_azimuth(evidence.table):
        judged = _as_isotropic(judged, evidence, pairs, sign, tolerance)
    if evidence.table.interpolant is not None and sheet_of(evidence.table) is None:
        judged.verdict = UNDECIDED if judged.verdict == PASS else judged.verdict
        edge = np.degrees(np.max(pairs.angles[:, [0, 2]]))
        judged.detail += f" Nothing was compared beyond θ {edge:.0f}°: undecided there."
        return judged
    judged.detail += _of_media(pairs) if judged.verdict == FAIL else ""
    readings = _all_angles(evidence) if pairs.merged is None else pairs.merged
    if untestable:
        readings = readings[np.prod(np.cos(readings[:, [0, 2]]), axis=1) > 0]
        judged.detail += untestable
        judged.verdict = NOT_TESTABLE if judged.verdict == PASS else judged.verdict
    share, where = uncovered(readings, pairs.angles[compared.differences.comparable])
    _say_what_was_not_compared(judged, share, where, alone)
    judged.detail += signs
    _say_what_was_made(judged, pairs)
    return judged


def _say_what_was_not_compared(judged: Property, share: float, where: str, alone: list[str]) -> None:
    """What leaves a pass undecided: readings, and channels, that no exchanged ones stand beside."""
    judged.facts["share_not_compared"] = share
    if (share > MOST_UNCOVERED or alone) and judged.verdict == PASS:
        judged.verdict = UNDECIDED
    judged.detail += f" The {_of_states(alone)}" if alone else ""
    if share > 0:
        judged.detail += f" Nothing exchanged was read for {percent(share)} of the readings, {where}: undecided there."


def _say_what_was_made(judged: Property, pairs: Pairs) -> None:
    """Say of a table that was made reciprocal that it tells nothing about the surface."""
    if judged.verdict != FAIL and _made_equal(pairs):
        judged.detail += MADE_EQUAL
        judged.assumes = MADE_RECIPROCAL if judged.verdict == PASS else judged.assumes


def _made_equal(pairs: Pairs) -> bool:
    """Whether exchanged readings are equal to rounding although their uncertainties are larger: they were made so."""
    measured = np.arange(len(pairs) - len(pairs.around))
    for column in (c.rows(measured) for c in pairs.columns()):
        a, b = np.asarray(column.a), np.asarray(column.b)
        noisy = (np.hypot(column.u_a, column.u_b) > 2 * EQUAL * np.abs(a)) & (a != 0)
        equal = np.abs(a - b)[noisy] <= EQUAL * np.abs(a)[noisy]
        if equal.size < FEWEST or np.mean(equal) < MOSTLY:
            return False
    return measured.size > 0


def _of_states(alone: list[str]) -> str:
    """Which channels were compared with nothing."""
    return f"exchanged polarisations of {listed(alone)} were not read."


def _of_incidences(evidence: TableEvidence) -> str:
    """Which light is missing where views are steeper than every incidence; no model stands in for it."""
    angles = _all_angles(evidence)
    last_i, last_o = (np.degrees(np.max(np.arcsin(np.sin(angles[:, k])))) for k in (0, 2))
    if last_o <= last_i + BEYOND:
        return ""
    return (
        f" The light went to θi {last_i:.3g}°, the detector to θo {last_o:.3g}°: read light from up to there to decide;"
        " a model cannot, for one that is reciprocal assumes what is to be shown."
    )


def _surely(failed: Property, evidence: TableEvidence, pairs: Pairs, sign: np.ndarray, what: str) -> Property:
    """What fails, judged by what the readings around interpolated values, and the instrument, allow."""
    listed = not evidence.table.layout.gridded and evidence.table.interpolant is None
    angle = displacement(evidence.table) if pairs.cells.size or listed else 0.0
    if not len(pairs.around) and not angle:
        return failed
    allowed = pairs.within_readings()
    if angle:
        some = np.zeros(len(pairs), bool)
        some[some_of(len(pairs), MOST_DISPLACED) if len(pairs) > MOST_DISPLACED else slice(None)] = True
        allowed, sign = displaced(evidence.table, allowed.where(some), angle), sign[some]
    assert failed.tolerance is not None
    surely = _judged(failed.name, evidence, compare(evidence, allowed, sign), failed.tolerance, what)
    reason = (DISPLACED.format(angle=np.degrees(angle)) if angle else "") + BETWEEN_READINGS * bool(len(pairs.around))
    return only_surely(failed, surely, reason)


def _as_isotropic(
    failed: Property, evidence: TableEvidence, pairs: Pairs, sign: np.ndarray, tolerance: float
) -> Property:
    """What pairs that are turned about the normal fail: it stands for isotropic surfaces alone."""
    if is_taken_as_isotropic(failed, evidence, tolerance):
        return failed
    alike = unturned(pairs, evidence.table.layout.gridded)
    some = pairs.where(alike).within_readings()
    if len(some) >= FEWEST:
        what = "f(wi, wo) and f(wo, wi), without turning the surface,"
        surely = _judged("reciprocity", evidence, compare(evidence, some, sign[alike]), tolerance, what)
        if surely.verdict == FAIL:
            return surely
    failed.verdict = UNDECIDED
    return failed


def _of_media(pairs: Pairs) -> str:
    """What one factor between all readings through the sample and those of the exchanged directions would come from."""
    behind = np.cos(pairs.angles[:, [0, 2]]) < 0
    through = np.flatnonzero(behind[:, 0] != behind[:, 1])
    if not through.size:
        return ""
    columns = [column.rows(through) for column in pairs.columns()]
    a, b = (np.stack(of_channels, axis=1) for of_channels in zip(*((c.a, c.b) for c in columns), strict=True))
    bright = ((a > 0) & (b > 0)).all(axis=1)
    ratio = np.log(a[bright] / b[bright]) * np.where(behind[through[bright]][:, 1:], 1, -1)
    if len(ratio) < FEWEST:
        return ""
    middle = float(np.median(ratio))
    scatter = float(np.median(np.abs(ratio - middle)))
    if abs(middle) < LEAST_FACTOR or scatter > abs(middle) / 4:
        return ""
    return (
        f" All of transmission is {np.exp(middle):.3g} times as bright behind as in front, as between media whose"
        f" indices are as 1 to {np.exp(middle / 2):.3g}: where that is so the table has to state it (media)."
    )


def _lit_from_one_side(sides: Sides) -> str:
    """Why transmission cannot be tested; nothing where it can, or where there is none."""
    through = [light for light, detector in sides if light != detector]
    if len(through) != 1:
        return ""
    lit, other = ("the front", "behind") if through[0] > 0 else ("behind", "the front")
    return (
        f" Transmission is not testable: it was lit from {lit} alone, and the exchanged directions are of light from "
        f"{other} (gonio measure --lit both)."
    )


def _all_angles(evidence: TableEvidence) -> np.ndarray:
    layout = evidence.table.layout
    wi, wo = layout.directions_at(evidence.table.some_valid_cells(MOST_READINGS))
    return pair_angles(wi, wo)[layout.are_readable(wi.z, wo.z)]


def table_symmetry(evidence: TableEvidence, tolerance: float) -> Property:
    """f(Δφ) = f(−Δφ), where the grid has both."""
    pairs = evidence.pairs("mirrored")
    if not isinstance(pairs, str):
        pairs = mirrored_states(pairs, evidence.table.channels.names)
    sign = None if isinstance(pairs, str) else np.sin(pairs.angles[:, 3] - pairs.angles[:, 1])
    return _equal("symmetry", evidence, pairs, sign, tolerance, "f(Δφ) and f(−Δφ)")


def table_isotropy(evidence: TableEvidence, tolerance: float) -> Property:
    """Readings beside those with both directions turned by 67.5° or about as much, where a grid has both.

    Where the light has one azimuth only, those at normal incidence may show that a surface is not isotropic.
    """
    if one_azimuth(evidence.table):
        judged = isotropy_at_normal_incidence(evidence, tolerance)
        if judged.verdict != PASS:
            return judged
        most = percent((judged.residual or 0.0) + (judged.bound or 0.0), 2)
        reason = f"Not testable: the light has one azimuth only. At normal incidence f is isotropic to {most}."
        return without_residual("isotropy", NOT_APPLICABLE, tolerance, reason, **judged.facts)
    pairs = evidence.pairs("turned")
    if not isinstance(pairs, str):
        pairs = same_states(pairs, evidence.table.channels.names)
    return _equal("isotropy", evidence, pairs, None, tolerance, "f, and f turned about the normal")


def table_pole(evidence: TableEvidence, tolerance: float) -> Property:
    """At the normal a direction has no azimuth: readings there must not depend on it, where a grid has the normal."""
    what = "f at the normal, by one azimuth and by another"
    pairs = evidence.pairs("pole")
    if not isinstance(pairs, str):
        pairs = same_states(pairs, evidence.table.channels.names, of_light=False, of_detector=False)
    return _equal("pole", evidence, pairs, None, tolerance, what)


def _equal(
    name: str, evidence: TableEvidence, pairs: Pairs | str, sign: np.ndarray | None, tolerance: float, what: str
) -> Property:
    """The property that readings a and b are the same: by their uncertainties at the level, else by regions.

    `sign` (n,) is that of a violation in each pair; None where a violation has no sign that a mean would keep.
    """
    if isinstance(pairs, str):
        return without_residual(name, NOT_APPLICABLE, tolerance, f"Not testable: {pairs}.")
    if is_polarised(evidence.table.channels.names) and not any(np.isfinite(c.a).any() for c in pairs.columns()):
        reason = "Not testable: no two of these readings are of one state of polarisation."
        return without_residual(name, NOT_APPLICABLE, tolerance, reason)
    signs = np.zeros(len(pairs)) if sign is None else np.sign(np.round(sign, 9))
    judged = _judged(name, evidence, compare(evidence, pairs, signs), tolerance, what)
    return _surely(judged, evidence, pairs, signs, what) if judged.verdict == FAIL else judged


def _judged(name: str, evidence: TableEvidence, compared: Compared, tolerance: float, what: str) -> Property:
    differences, pairs = compared.differences, compared.pairs
    number = int(np.count_nonzero(differences.comparable))
    facts = {"pairs": number, "cells_asked": pairs.eligible, "method": pairs.how}
    if differences.by_channel.max(initial=0) < FEWEST:
        detail = f"Only {number} pairs of readings can be compared ({pairs.how}); at least {FEWEST} are needed."
        return without_residual(name, UNDECIDED, tolerance, detail, **facts)
    facts |= differences.facts()
    median = differences.median
    judged = compared.judged(name, evidence, tolerance, what)
    if differences.decided_by_uncertainty:
        judged.detail += _remark_on_scatter(facts)
    else:
        judged.detail += f" Their median difference is {percent(median)}."
    judged.facts = facts | {"median": median} | judged.facts
    judged.series |= differences.by_band()
    return judged


def _remark_on_scatter(facts: dict[str, Any]) -> str:
    scatter = facts["scatter_in_uncertainties"]
    if SCATTER[0] <= scatter <= SCATTER[1]:
        return ""
    stated = "small" if scatter > 1 else "large"
    return (
        f" The pairs scatter {scatter:.2g} times as much as their uncertainties say: these may be stated too {stated},"
        " and p-values are only as good as they are."
    )

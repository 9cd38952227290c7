"""Whether a fit is good, in one sentence: its faults with the worst first, or what makes it a good one."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from gonio.models.display import percent

ALBEDO_TOLERANCE = 1e-3
UNEXPLAINED = 0.5
"""Σr² over that of the best Lambertian, from which on a fit explains too little to be of use."""
FAR_OFF = 0.1
"""Relative rms below which a fit is of use even where it is no better than a Lambertian."""
NOISE = 1.2
"""Reduced χ² above which the residuals are more than the stored noise."""
FAR_FROM_NOISE = 4.0
"""Reduced χ² above which a fit is poor: the residuals are twice the noise."""
FAR_BELOW_NOISE = 0.25
"""Reduced χ² below which the residuals are less than half of what is stored, as with what all readings share."""
NO_FIT = 100.0
"""Reduced χ² above which a fit has failed: the residuals are ten times the noise."""
DECIDING = 2.0
"""Standard uncertainties that readings which stand out may move a mean by, from which on that is said."""
UNTESTED = "untested"
"""Of residuals: there are no more readings than free numbers."""
GOOD, FAIR, POOR, FAILED = "good", "fair", "poor", "failed"
COMMON = "part of the stored uncertainties that all readings share, as they scatter less"
NEEDED = {"name", "meaning", "number", "equal"}
"""Of each row of common errors."""
OPENINGS = {
    GOOD: "A good fit", FAIR: "A fair fit", POOR: "A POOR FIT", FAILED: "A FAILED FIT, do not use it",
}  # fmt: skip


class FitJudgement(NamedTuple):
    """A word for a fit (good, fair, poor, failed) and the sentence that says why."""

    verdict: str
    sentence: str


def judge_fit(fit: Mapping[str, Any]) -> FitJudgement:
    """Judges what a fit reports of itself, as `FitResult.to_dict` and a fitted material hold it.

    Failed: not stationary, residuals ten times the known noise, or far off and hardly better than a perfect diffuser.
    Poor: residuals twice the known noise, or a model that reflects more than it receives. Fair: more than noise,
    structure in the residuals, as many numbers as readings, numbers that the readings leave open, or stated errors
    that their uncertainties leave out. What nothing states of errors that all readings share is said beside it.
    """
    failed, poor, fair = [], [], []
    metrics = fit.get("metrics") or {}
    rms, chi2, albedo, unexplained = (
        _finite(metrics.get(k)) for k in ("relative_rms", "reduced_chi2", "largest_albedo", "unexplained")
    )
    residuals = fit.get("residuals") or {}
    structure = (residuals.get("noisiness") or {}).get("verdict")
    if structure == UNTESTED:
        chi2 = None
        fair.append("it has as many free numbers as readings, so that nothing tests the model or the uncertainties")
    if not fit.get("converged", False):
        failed.append(f"it did not converge ({fit.get('reason') or 'no reason given'})")
    if unexplained is not None and unexplained > UNEXPLAINED and structure == "structure" and (rms or 0.0) > FAR_OFF:
        failed.append(f"it leaves {percent(unexplained)} of what a perfect diffuser leaves, and not as noise")
    if chi2 is not None and chi2 > NOISE:
        words = f"its residuals are {np.sqrt(chi2):.2g} times the stored uncertainties (reduced χ² {chi2:.3g})"
        (failed if chi2 > NO_FIT else poor if chi2 > FAR_FROM_NOISE else fair).append(words)
    if albedo is not None and albedo > 1 + ALBEDO_TOLERANCE:
        poor.append(f"its model reflects more light than it receives (albedo {albedo:.3g})")
    if structure == "structure":
        region = residuals.get("worst_region")
        fair.append("its residuals are structure, not noise" + (f", most of all at {region}" if region else ""))
    elif outliers := _outliers(residuals, _finite(fit.get("samples")) or 0.0):
        fair.append(outliers)
    if open_numbers := len(fit.get("undetermined") or []):
        plural = "combination" if open_numbers == 1 else "combinations"
        fair.append(f"the readings leave {open_numbers} {plural} of its numbers open")
    shared = common_error_words(rows := fit.get("common_errors") or [])
    if shared and rows[0].get("stated") is not None:
        fair.append(shared)
        shared = ""
    verdict = FAILED if failed else POOR if poor else FAIR if fair else GOOD
    good = []
    if chi2 is not None and chi2 <= NOISE:
        less = ", far less than the stored uncertainties: these, and what comes of them, may be stated too large"
        good.append(f"reduced χ² {chi2:.3g}" + less * (chi2 < FAR_BELOW_NOISE))
    if rms is not None:
        good.append(f"relative rms {rms:.3g}")
    if chi2 is None or chi2 <= NOISE:  # larger ones are no noise of the readings, even or not
        good += {"noise": ["its residuals are noise"], "exact": ["its residuals are rounding"]}.get(str(structure), [])
    if albedo is not None and albedo <= 1 + ALBEDO_TOLERANCE:
        good.append(f"largest albedo about {albedo:.2g}")
    reasons = "; ".join([*([*failed, *poor, *fair] or ["it converged"]), *filter(None, [shared])])
    return FitJudgement(verdict, f"{OPENINGS[verdict]}: {reasons}" + (f" ({', '.join(good)})" if good else "") + ".")


def _outliers(residuals: Mapping[str, Any], count: float) -> str:
    """That readings which stand out may have moved the fit; nothing where a robust fit was made.

    Where m readings with a share c of the cost are all off to one side, a mean is off by √(c m) of its uncertainties.
    """
    share, cost = (_finite(residuals.get(k)) or 0.0 for k in ("standing_out", "share_of_cost"))
    if cost * share * count < DECIDING**2 or residuals.get("down_weighted"):
        return ""
    return f"{percent(share)} of the readings stand out, with {percent(cost)} of the cost (--robust counts them less)"


def _finite(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and np.isfinite(value) else None


def common_error_words(rows: Sequence[Mapping[str, Any]]) -> str:
    """What the uncertainties of a fit leave out (see `common_errors`), in words.

    Nothing for none, and where a row of a file lacks what it should hold. Files leave out a `stated` of None.
    """
    if not rows or not all(row.keys() >= NEEDED and (row["equal"] or 0.0) > 0 for row in rows):
        return ""
    worst = rows[0]
    if worst.get("stated") is not None:
        names = ",".join(row["name"] for row in rows if row.get("stated") is not None and row.get("fitted"))
        size, moved = 100 * worst["stated"], worst["stated"] / worst["equal"]
        remedy = f"; --nuisance {names} takes it in" if worst.get("fitted") else ""
        shown = worst["meaning"] == COMMON or worst["name"] == "drift"  # by the readings themselves
        return (
            f"its standard uncertainties leave out the {'' if shown else 'stated '}"
            f"{worst['meaning']}: ± {size:.3g} % moves "
            f"{worst['number']} by {moved:.2g} of them{remedy}"
        )
    sizes = " or ".join(f"{100 * row['equal']:.2g} % ({row['name']}, {row['number']})" for row in rows)
    return (
        "its standard uncertainties hold the noise alone; an error that all readings share, which nothing states, "
        f"moves a number by one of them where it is {sizes}"
    )

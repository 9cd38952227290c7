"""Whether a fit is good, in one sentence: its faults with the worst first, or what makes it a good one."""

from typing import Any, NamedTuple

import numpy as np

from gonio.models.albedo import directional_albedo
from gonio.models.brdf import AbstractBRDF

INCIDENCES = (0.0, 30.0, 60.0, 75.0, 85.0)
"""Degrees, at which the albedo of a fitted model is computed."""
ALBEDO_TOLERANCE = 1e-3
UNEXPLAINED = 0.5
"""Relative rms of the residuals from which on a fit explains too little to be of use."""
NOISE = 1.2
"""Reduced χ² above which the residuals are more than the stored noise."""
FAR_FROM_NOISE = 4.0
"""Reduced χ² above which a fit is poor: the residuals are twice the noise."""
GOOD, FAIR, POOR = "good", "fair", "poor"


class FitJudgement(NamedTuple):
    """A word for a fit (good, fair, poor) and the sentence that says why."""

    verdict: str
    sentence: str


def judge_fit(fit: dict[str, Any], brdf: AbstractBRDF) -> FitJudgement:
    """Judges what a fit reports of itself, and the albedo of its model.

    Args:
        fit: its facts, as a fitted material holds them.
        brdf: the fitted model.
    """
    albedo, where = _largest_albedo(brdf)
    poor, fair = [], []
    if not fit.get("converged", False):
        poor.append(f"it did not converge ({fit.get('reason') or 'no reason given'})")
    if albedo > 1 + ALBEDO_TOLERANCE:
        poor.append(f"its model reflects more light than it receives (albedo {albedo:.3g} at θi {where:g}°)")
    metrics = fit.get("metrics") or {}
    rms, chi2 = (_finite(metrics.get(k)) for k in ("relative_rms", "reduced_chi2"))
    if rms is not None and rms >= UNEXPLAINED:
        poor.append(f"it leaves {100 * rms:.0f} % of the readings' rms unexplained")
    if chi2 is not None and chi2 > NOISE:
        words = f"its residuals are {_plain(np.sqrt(chi2))} times the stored uncertainties (reduced χ² {_plain(chi2)})"
        (poor if chi2 > FAR_FROM_NOISE else fair).append(words)
    residuals = fit.get("residuals") or {}
    structure = (residuals.get("noisiness") or {}).get("verdict")
    if structure == "structure":
        region = residuals.get("worst_region")
        fair.append("its residuals are structure, not noise" + (f", most of all at {region}" if region else ""))
    if open_numbers := len(fit.get("undetermined") or []):
        plural = "combination" if open_numbers == 1 else "combinations"
        fair.append(f"the readings leave {open_numbers} {plural} of its numbers open")
    verdict = POOR if poor else FAIR if fair else GOOD
    opening = {POOR: "A poor fit", FAIR: "A fair fit", GOOD: "A good fit"}[verdict]
    reasons = [*poor, *fair] or ["it converged"]
    good = [] if chi2 is None or chi2 > NOISE else [f"reduced χ² {chi2:.3g}"]
    good += [] if rms is None or rms >= UNEXPLAINED else [f"relative rms {rms:.3g}"]
    good += ["its residuals are noise"] if structure == "noise" else []
    good += [f"albedo at most {albedo:.3g}"] if albedo <= 1 + ALBEDO_TOLERANCE else []
    return FitJudgement(verdict, f"{opening}: {'; '.join(reasons)}" + (f" ({', '.join(good)})." if good else "."))


def _plain(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _finite(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and np.isfinite(value) else None


def _largest_albedo(brdf: AbstractBRDF) -> tuple[float, float]:
    """The largest directional albedo of any channel that the bounds leave no doubt of, and its incidence, degrees."""
    estimate = directional_albedo(brdf, np.radians(INCIDENCES), tolerance=ALBEDO_TOLERANCE)
    value, bound = (np.asarray(a).reshape(len(INCIDENCES), -1) for a in (estimate.value, estimate.bound))
    sure = value - np.where(np.isfinite(bound), bound, 0.0)
    row = int(np.argmax(sure.max(axis=1)))
    return float(sure[row].max()), INCIDENCES[row]

"""Positivity of a model: beside the verdict on reciprocity and energy, part of it if strict."""

import numpy as np

from gonio.checks.certificate import PASS, UNDECIDED, Property, place_in_words, place_of, verdict_of
from gonio.checks.direction_search import climb, pair, precision, values
from gonio.checks.model.evidence import ModelEvidence
from gonio.checks.model.reciprocity import STARTS
from gonio.checks.model.sides import on_every_side


@on_every_side
def model_positivity(evidence: ModelEvidence, tolerance: float) -> Property:
    """How far f falls below 0, in units of its mean over the pairs."""
    angles = evidence.angles
    f = values(evidence.brdf, *pair(angles))
    finite = np.isfinite(f).all(axis=-1)
    undefined = int(np.count_nonzero(~finite))
    scale = max(float(np.mean(np.minimum(np.abs(f[finite]), 1e6))) if finite.any() else 0.0, 1e-300)
    lowest = np.where(finite, f.min(axis=-1), np.inf)
    starts = angles[np.argsort(lowest)[:STARTS]]
    best, depth = climb(lambda where: -np.min(values(evidence.brdf, *pair(where)), axis=-1), starts, rounds=8)
    k = int(np.argmax(np.nan_to_num(depth, nan=-np.inf)))
    least = -float(depth[k])
    residual, bound = max(-least / scale, 0.0), 8 * precision()
    verdict = verdict_of(residual, bound, tolerance)
    detail = f"The least value found is {least:.3g} /sr among {len(angles):,} pairs and a search from the lowest."
    if undefined:
        detail += f" f is not finite at {undefined} pairs, such as {place_in_words(place_of(angles[~finite][0]))}."
        verdict = UNDECIDED if verdict == PASS else verdict
    facts = {"least_per_sr": least, "mean_per_sr": scale, "pairs_without_a_value": undefined}
    return Property("positivity", verdict, residual, bound, tolerance, place_of(best[k]), detail, facts)

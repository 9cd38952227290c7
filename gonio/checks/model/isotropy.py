"""Symmetries of a model: mirrored at a plane, and turned about the normal. No law asks for the second."""

import numpy as np

from gonio.checks.certificate import NOT_APPLICABLE, Property
from gonio.checks.direction_search import mirrored, rotated
from gonio.checks.model.evidence import ModelEvidence
from gonio.checks.model.reciprocity import difference_of_pairs, difference_property, rounding_of
from gonio.checks.model.sides import on_every_side

GRAZING = np.radians(89.9)
TURN = rotated(0.7)


@on_every_side
def model_symmetry(evidence: ModelEvidence, tolerance: float) -> Property:
    """The largest relative difference of f and f mirrored at the x–z plane; only of what claims the symmetry."""
    worst = difference_of_pairs(evidence.brdf, mirrored, evidence.angles)
    detail = (
        "The largest relative difference between f(Δφ) and f(−Δφ), both directions mirrored at the plane of x and the"
        f" normal, is {worst.residual:.2g}, searched over {worst.pairs:,} pairs."
    )
    bound = rounding_of(evidence.brdf, mirrored, worst)
    judged = difference_property("symmetry", evidence, worst, bound, tolerance, detail)
    if not evidence.brdf.symmetric:
        judged.verdict = NOT_APPLICABLE
        judged.detail += " The model does not claim to be symmetric."
    return judged


@on_every_side
def model_isotropy(evidence: ModelEvidence, tolerance: float) -> Property:
    """The largest relative change of f when both directions are turned; not applicable to what claims no isotropy."""
    # Closer to the horizon the rounding of a turned direction is as large as its cosine.
    angles = evidence.angles[np.maximum(evidence.angles[:, 0], evidence.angles[:, 2]) <= GRAZING]
    worst = difference_of_pairs(evidence.brdf, TURN, angles, rounds=0)
    detail = (
        f"The largest relative change of f as both directions are turned by 40° about the normal is"
        f" {worst.residual:.2g}, among {len(angles):,} pairs up to 89.9°."
    )
    bound = rounding_of(evidence.brdf, TURN, worst)
    judged = difference_property("isotropy", evidence, worst, bound, tolerance, detail)
    if not evidence.brdf.isotropic:
        judged.verdict = NOT_APPLICABLE
        judged.detail += " The model does not claim to be isotropic."
    return judged

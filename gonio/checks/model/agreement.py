"""Agreement of a model with a stated truth: a wrong width or factor breaks no law, and shows against it only."""

import numpy as np

from gonio.checks.certificate import NOT_APPLICABLE, Property, without_residual
from gonio.checks.direction_search import pair, pair_angles, precision, refuse_other_channels, values
from gonio.checks.model.evidence import ModelEvidence
from gonio.checks.model.reciprocity import difference_property, worst_difference
from gonio.checks.model.sides import on_every_side
from gonio.checks.table.agreement import table_agreement
from gonio.checks.table.evidence import TableEvidence


def model_agreement(evidence: ModelEvidence, tolerance: float) -> Property:
    """The largest relative difference between f and a truth's, or beside the readings of a table, at these alone.

    Raises GonioError where the two have different numbers of channels, neither of them one.
    """
    if evidence.readings is None:
        return _agreement_with_model(evidence, tolerance)
    beside = TableEvidence(
        evidence.readings, evidence.level, reference=evidence.brdf, reference_channels=evidence.own_channels
    )
    return table_agreement(beside, tolerance)


@on_every_side
def _agreement_with_model(evidence: ModelEvidence, tolerance: float) -> Property:
    """The largest relative difference that a search of the closed hemisphere finds."""
    brdf, reference = evidence.brdf, evidence.reference
    if reference is None:
        return without_residual("agreement", NOT_APPLICABLE, tolerance, "Not testable: no truth is stated.")
    angles = np.concatenate([pair_angles(reference), evidence.angles])
    refuse_other_channels(*(values(b, *pair(angles[:1])).shape[-1] for b in (brdf, reference)))
    worst = worst_difference(
        lambda wi, wo: values(reference, wi, wo), lambda wi, wo: values(brdf, wi, wo), angles, rounds=8
    )
    detail = (
        f"The largest 2|a−b|/(|a|+|b|) of f and the reference's is {worst.residual:.2g}, searched over"
        f" {worst.pairs:,} pairs and refined from the worst."
    )
    return difference_property("agreement", evidence, worst, 64 * precision(), tolerance, detail)

"""Agreement of a table with a stated truth: readings beside a reference's values, by the region that differs most."""

import numpy as np

from gonio.checks.certificate import NOT_APPLICABLE, UNDECIDED, Property, without_residual
from gonio.checks.direction_search import refuse_other_channels, values
from gonio.checks.table.comparison import compare
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.pairs.pairs import FEWEST, Pairs
from gonio.checks.table.pairs.places import pair_angles
from gonio.data.flags import Flag

MOST_READINGS = 200_000


def table_agreement(evidence: TableEvidence, tolerance: float) -> Property:
    """The relative difference between readings and a reference's values: of the region where it is largest.

    Where uncertainties are stored a family of tests decides at the level, as for reciprocity. Raises GonioError where
    the reference has another number of channels, neither of them one.
    """
    if evidence.reference is None:
        return without_residual("agreement", NOT_APPLICABLE, tolerance, "Not testable: no truth is stated.")
    block = evidence.table.samples(MOST_READINGS)
    f = np.where(block.flag == Flag.VALID, block.f, np.nan).astype(float)
    f[~evidence.table.layout.are_readable(block.wi.z, block.wo.z)] = np.nan
    number = int(np.isfinite(f).any(axis=1).sum())
    if np.isfinite(f).sum(axis=0).max(initial=0) < FEWEST:
        detail = f"Only {number} readings can be compared; at least {FEWEST} are needed."
        return without_residual("agreement", UNDECIDED, tolerance, detail)
    truth = values(evidence.reference, block.wi, block.wo)
    refuse_other_channels(f.shape[-1], truth.shape[-1])
    truth, u = np.broadcast_to(truth, f.shape), np.asarray(block.u_f, float)
    angles, exact = pair_angles(block.wi, block.wo), np.zeros(f.shape)
    pairs = Pairs.of_arrays((f, truth, u, exact), angles, len(f), "each with the reference", exchanged=False)
    compared = compare(evidence, pairs, np.ones(len(f)))
    judged = compared.judged("agreement", evidence, tolerance, "The table's readings and the reference's values")
    judged.facts = {"readings": number} | judged.facts
    return judged

"""Agreement of a table with a stated truth: the readings below 70° beside a reference's values."""

import numpy as np

from gonio.checks.certificate import (
    NOT_APPLICABLE,
    UNDECIDED,
    Property,
    place_of,
    relative_difference,
    verdict_of,
    without_residual,
)
from gonio.checks.direction_search import refuse_other_channels, values
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.pairs import FEWEST, Pairs, pair_angles
from gonio.checks.table.regions import ROUNDING
from gonio.checks.table.significance import decided_by_uncertainty, judged_by_level
from gonio.data.flags import Flag

MOST_READINGS = 200_000


def table_agreement(evidence: TableEvidence, tolerance: float) -> Property:
    """The median relative difference between the readings below 70° and a reference's values, channel by channel.

    The channel that differs most decides. Where uncertainties are stored a family of tests does, at the level, as for
    reciprocity. Raises GonioError where the reference has another number of channels, neither of them one.
    """
    if evidence.reference is None:
        return without_residual("agreement", NOT_APPLICABLE, tolerance, "Not testable: no truth is stated.")
    block = evidence.table.samples(MOST_READINGS, np.radians(70.0))
    f = np.where(block.flag == Flag.VALID, block.f, np.nan).astype(float)
    if len(f) < FEWEST:
        detail = f"Only {len(f)} readings below 70° can be compared; at least {FEWEST} are needed."
        return without_residual("agreement", UNDECIDED, tolerance, detail)
    truth = values(evidence.reference, block.wi, block.wo)
    refuse_other_channels(f.shape[-1], truth.shape[-1])
    difference = np.where(np.isfinite(f), relative_difference(np.nan_to_num(f), truth), np.nan)
    medians = np.nanmedian(difference, axis=0)
    channel = int(np.nanargmax(medians))
    residual, largest = float(medians[channel]), float(np.nanmax(difference))
    facts = {"readings": len(f), "median_by_channel": medians.tolist(), "largest": largest}
    angles = pair_angles(block.wi, block.wo)
    u, truth = np.asarray(block.u_f, float), np.broadcast_to(truth, f.shape)
    pairs = Pairs(f, truth, u, np.zeros(f.shape), angles, len(f), "readings")
    if decided_by_uncertainty(pairs):
        what = "The table's readings and the reference's values"
        judged = judged_by_level("agreement", evidence, pairs, np.ones(len(f)), tolerance, what)
        judged.facts = facts | {"median": residual} | judged.facts
        return judged
    detail = (
        f"The median of 2|a−b|/(|a|+|b|) of {len(f):,} readings below 70° and the reference's values is {residual:.2%}"
        f" (±{ROUNDING:.2%}) in the channel that differs most; the largest is {largest:.2g}."
    )
    where = place_of(angles[int(np.nanargmax(difference[:, channel]))], evidence.channel(channel))
    verdict = verdict_of(residual, ROUNDING, tolerance)
    return Property("agreement", verdict, residual, ROUNDING, tolerance, where, detail, facts)

"""Positivity of a table: which readings are negative by more than their noise."""

import numpy as np

from gonio.checks.certificate import UNDECIDED, Property, place_of, verdict_of, without_residual
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.pairs.places import angles_of
from gonio.data.flags import Flag
from gonio.data.polarisation import are_radiances

FEW_SIGMA = 3.0
"""A negative reading within this many standard uncertainties of 0 may be noise about a value that is not negative."""

SIZES = 1_000_000
"""Readings from which their median size is taken."""
BLOCK = 1 << 17
"""Readings that are looked at together."""


def table_positivity(evidence: TableEvidence, tolerance: float) -> Property:
    """The share of the valid readings that are negative by more than their noise; how negative, and where."""
    table = evidence.table
    valid = negative = unexplained = 0
    least, cell, channel, sizes = np.inf, 0, 0, []
    radiances = are_radiances(table.channels.names)
    step = max(1, table.layout.size * len(table.channels) // SIZES)
    for start, stop in table.blocks(BLOCK):
        block = table.read_values(start, stop)
        ok, f = (block["flag"] == Flag.VALID) & radiances, block["f"]
        below = ok & (f < 0)
        valid, negative = valid + int(ok.sum()), negative + int(below.sum())
        if below.any():
            noise = np.nan_to_num(np.asarray(block["u_f"], float), nan=0.0)
            unexplained += int(np.count_nonzero(below & (f < -FEW_SIGMA * noise)))
        if ok.any():
            lowest = np.where(ok, f, np.inf)
            k = np.unravel_index(np.argmin(lowest), lowest.shape)
            if lowest[k] < least:
                least, cell, channel = float(lowest[k]), start + int(k[0]), int(k[1])
            sizes.append(np.abs(f[ok][::step]))
    if valid == 0:
        return without_residual("positivity", UNDECIDED, tolerance, "The table holds no valid reading.")
    median, share = float(np.median(np.concatenate(sizes))), unexplained / valid
    facts = {
        "valid": valid,
        "negative": negative,
        "negative_beyond_noise": unexplained,
        "least_per_sr": least,
        "least_relative_to_median": least / median if median > 0 else None,
    }
    detail = f"{negative:,} of {valid:,} readings are negative"
    if negative:
        detail += f", {unexplained:,} by more than their known noise; the least is {least:.3g} /sr"
        detail += f" ({least / median:.2g} of the median size)" if median > 0 else ""
    where = place_of(angles_of(table.layout, np.array([cell]))[0], evidence.channel(channel))
    return Property("positivity", verdict_of(share, 0.0, tolerance), share, 0.0, tolerance, where, detail + ".", facts)

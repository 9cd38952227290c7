"""The checks of a table, all together; and positivity, which needs only its readings."""

import numpy as np

from gonio.checks.certificate import UNDECIDED, Property, verdict_of
from gonio.checks.model.edges import table_horizon
from gonio.checks.model.isotropy import table_isotropy, table_pole
from gonio.checks.model.reciprocity import where_of
from gonio.checks.table.energy import table_energy
from gonio.checks.table.pairs import angles_of
from gonio.checks.table.reciprocity import table_reciprocity, table_symmetry
from gonio.checks.table.significance import LEVEL
from gonio.data.flags import Flag
from gonio.data.table import Table

FEW_SIGMA = 3.0
"""A negative reading within this many standard uncertainties of 0 may be noise about a value that is not negative."""


def check_table(
    table: Table, limits: dict[str, float], feature_width: float = 0.0, level: float = LEVEL
) -> list[Property]:
    """All properties of a table, against the tolerances by name.

    `level` is that of each family of tests against stored uncertainties.
    """
    return [
        table_reciprocity(table, limits["reciprocity"], level),
        table_energy(table, limits["energy"], feature_width, level),
        table_positivity(table, limits["positivity"]),
        table_symmetry(table, limits["symmetry"], level),
        table_isotropy(table, limits["isotropy"], level),
        table_pole(table, limits["pole"], level),
        table_horizon(table, limits["horizon"]),
    ]


def table_positivity(table: Table, tolerance: float) -> Property:
    """The share of the valid readings that are negative by more than their noise; how negative, and where."""
    valid = negative = unexplained = 0
    least, at, sizes = np.inf, None, []
    for start, stop in table.blocks():
        block = table.read(start, stop)
        ok = block.flag == Flag.VALID
        below = ok & (block.f < 0)
        valid, negative = valid + int(ok.sum()), negative + int(below.sum())
        noise = np.nan_to_num(np.asarray(block.u_f, float), nan=0.0)
        unexplained += int(np.count_nonzero(below & (block.f < -FEW_SIGMA * noise)))
        if ok.any():
            lowest = np.where(ok, block.f, np.inf)
            k = np.unravel_index(np.argmin(lowest), lowest.shape)
            if lowest[k] < least:
                least, at = float(lowest[k]), (start + int(k[0]), int(k[1]))
            sizes.append(np.abs(block.f[ok])[:: max(1, ok.sum() // 100_000)])
    if valid == 0:
        return Property("positivity", UNDECIDED, None, None, tolerance, detail="The table holds no valid reading.")
    median = float(np.median(np.concatenate(sizes)))
    share = unexplained / valid
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
    where = where_of(angles_of(table.layout, np.array([at[0]]))[0], at[1] if len(table.channels) > 1 else None)
    return Property("positivity", verdict_of(share, 0.0, tolerance), share, 0.0, tolerance, where, detail + ".", facts)

"""How many readings of a table a fit used, and what became of the others: masked, missing, negative are not one."""

import numpy as np

from gonio.data.table import Table
from gonio.fitting.problem.readings import Readings

MASKED = ("below_horizon", "shadowed", "saturated", "invalid")


def counted(table: Table, readings: Readings) -> dict[str, int]:
    """Readings (cells × channels) by what became of them.

    `used`; `negative` of those used, which count as they are; `missing`: never measured; `below_horizon`, `shadowed`,
    `saturated`, `invalid`: masked for that reason; `left_out`: valid, but beyond the angle or the number asked for.
    """
    of_table = table.counts()
    used = readings.count
    found = {"used": used, "negative": int(np.count_nonzero(readings.valid & (readings.f < 0)))}
    found["missing"] = of_table["not_measured"]
    found |= {flag: of_table[flag] for flag in MASKED}
    found["left_out"] = max(0, of_table["valid"] - used)
    return found

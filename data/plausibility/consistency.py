"""A table's flags, values and uncertainties held against each other: what is no reading may not be called valid."""

import numpy as np

from gonio.data.flags import FLAG_MEANINGS, Flag
from gonio.data.table import Table
from gonio.models.errors import GonioError
from gonio.models.geometry.sides import BEHIND, FRONT

LARGEST_F = 1e30
"""1/sr: no surface comes near it, and its powers are still numbers."""
LEAST_COSINE = 1e-16
"""Of a direction that can be read: π/2 in double precision has the cosine 6e-17."""
BLOCK = 1 << 18
"""Readings that are looked at together."""


def check_readings(table: Table) -> None:
    """Raises GonioError, naming the first, for readings that contradict their flag, their direction or their noise.

    Those are flags that `Flag` does not have; and, among the valid: values that are not finite or beyond `LARGEST_F`,
    directions on the horizon, or below it where the layout holds the front alone, uncertainties that are negative or
    infinite.
    """
    front = table.layout.sides == FRONT
    for start, stop in table.blocks(BLOCK):
        f, u_f, flag = table.read_values(start, stop).values()
        valid = flag == Flag.VALID
        _refuse(table, start, flag > max(Flag), f"a flag that is none of {_flags()}", "copy the file again")
        remedy = f"flag what is no reading {Flag.INVALID:d} (invalid) or {Flag.NOT_MEASURED:d} (not_measured)"
        with np.errstate(invalid="ignore"):
            absurd, wrong = ~(np.abs(f) <= LARGEST_F) & valid, ((u_f < 0) | np.isinf(u_f)) & valid
        _refuse(table, start, absurd, f"an f flagged valid that is no number, or beyond {LARGEST_F:g} 1/sr", remedy)
        _refuse(table, start, wrong, "a negative or infinite u_f", "give standard uncertainties, 0 exact, NaN unknown")
        grazing = [(c <= LEAST_COSINE) & (front | (c >= BEHIND)) for c in table.layout.cosines(start, stop)]
        below = f"flag it {Flag.BELOW_HORIZON:d} (below_horizon)"
        _refuse(
            table,
            start,
            np.logical_or(*grazing)[:, None] & valid,
            "a direction at or below the horizon flagged valid",
            below,
        )


def _refuse(table: Table, start: int, wrong: np.ndarray, what: str, remedy: str) -> None:
    if wrong.any():
        cell, channel = (int(k) for k in np.argwhere(wrong)[0])
        angles = (float(np.degrees(a[0])) for a in table.layout.angles(start + cell, start + cell + 1))
        named = zip(("θi", "φi", "θo", "φo"), angles, strict=True)
        place = ", ".join(f"{name} {angle:.6g}°" for name, angle in named)
        raise GonioError(f"it holds {what}, at {place}, channel {table.channels.names[channel]}; {remedy}")


def _flags() -> str:
    return ", ".join(f"{flag:d} {meaning}" for flag, meaning in zip(Flag, FLAG_MEANINGS, strict=True))

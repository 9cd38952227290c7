"""Directions of readings that are off by what an instrument states of its apertures and its alignment."""

import math

import numpy as np

from gonio.checks.table.pairs.next_nodes import changes_to_next_nodes
from gonio.checks.table.pairs.pairs import Column, Pairs
from gonio.data.table import Table
from gonio.instrument.description import instrument_of
from gonio.instrument.stated import TERMS

COVERAGE = 2.0
"""Of the standard uncertainties of an instrument's terms."""
UNRESOLVED = 0.5
"""Relative change to the next node from which f may change as much over any smaller angle."""
STEEPER = 2.0
"""Slope of f in the one between two nodes, where it changes by less."""


def displacement(table: Table) -> float:
    """Angle, radians, by which the directions of a reading and of the exchanged one may differ from being exchanged.

    The difference of both apertures' half-angles, whose averages are exchanged only where these are equal, and the
    stated uncertainties of arm angles and tilts, of both readings.
    """
    from gonio.fitting.apertures import half_angles_of

    source, detector = half_angles_of(table)
    return abs(source - detector) + math.sqrt(2) * misalignment(table)


def misalignment(table: Table) -> float:
    """Angle, radians, by which directions may be off by the stated uncertainties of arm angles and tilts."""
    return _expanded(table, [name for name, term in TERMS.items() if term.acts == "angle"])


def miscalibration(table: Table) -> float:
    """Share by which all readings may be off by the stated uncertainties of their factors."""
    return _expanded(table, [name for name, term in TERMS.items() if term.acts == "factor"])


def cosine_error(cosine: np.ndarray, angle: float) -> np.ndarray:
    """Relative change (n,) of the irradiance where light at these cosines is off by an angle."""
    cosine = np.abs(cosine)
    return np.minimum(angle * np.sqrt(np.maximum(1 - cosine**2, 0.0)) / np.maximum(cosine, 1e-12), 1.0)


def _expanded(table: Table, names: list[str]) -> float:
    instrument = instrument_of(table.provenance)
    stated = {} if instrument is None else instrument.uncertainties
    return COVERAGE * math.sqrt(sum(stated[name].standard ** 2 for name in names if name in stated))


def displaced(table: Table, pairs: Pairs, angle: float) -> Pairs:
    """The pairs of a grid, with what such a displacement may change in the error of b; those of a list as they are."""
    if not table.layout.gridded:
        return pairs
    most, off = np.zeros((len(pairs), len(table.channels))), misalignment(table)
    of_light = sum(cosine_error(np.cos(pairs.angles[:, k]), off) for k in (0, 2))
    for change, larger, distance in changes_to_next_nodes(table, pairs.cells):
        share = np.minimum(1.0, STEEPER * angle / np.maximum(distance, 1e-12))[:, None]
        most += np.where(change > UNRESOLVED * larger, change, share * change)

    def change_of(channel: int, column: Column) -> Column:
        size = np.maximum((np.abs(column.a) + np.abs(column.b)) / 2, 1e-300)
        return column._replace(error=column.error + of_light + most[:, channel] / size)

    return pairs.changed(change_of)

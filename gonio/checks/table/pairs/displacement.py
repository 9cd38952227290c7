"""Directions of readings that are off by what an instrument states of its apertures and its alignment."""

import math

import numpy as np

from gonio.checks.table.pairs.nearest_changes import changes_to_nearest_readings
from gonio.checks.table.pairs.next_nodes import Change, changes_to_next_nodes
from gonio.checks.table.pairs.pairs import Column, Pairs
from gonio.data.plausibility.correlated_uncertainty import correlated_uncertainty
from gonio.data.stated import TERMS
from gonio.data.table import Table
from gonio.instrument.description import instrument_of

COVERAGE = 2.0
"""Of the standard uncertainties of an instrument's terms."""
UNRESOLVED = 0.5
"""Relative change to the next node from which f may change as much over any smaller angle."""
ALL = 2.0
"""The largest relative difference of two readings."""
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
    """Share by which all readings may be off: by the stated uncertainties of their factors, or by what they share of
    their stored ones."""
    stated = _expanded(table, [name for name, term in TERMS.items() if term.acts == "factor"])
    return stated or COVERAGE * correlated_uncertainty(table).relative


def cosine_error(cosine: np.ndarray, angle: float) -> np.ndarray:
    """Relative change (n,) of the irradiance where light at these cosines is off by an angle."""
    cosine = np.abs(cosine)
    return np.minimum(angle * np.sqrt(np.maximum(1 - cosine**2, 0.0)) / np.maximum(cosine, 1e-12), 1.0)


def _expanded(table: Table, names: list[str]) -> float:
    instrument = instrument_of(table.provenance)
    stated = {} if instrument is None else instrument.uncertainties
    return COVERAGE * math.sqrt(sum(stated[name].standard ** 2 for name in names if name in stated))


def displaced(table: Table, pairs: Pairs, angle: float) -> Pairs:
    """The pairs, with what such a displacement may change in the error of b.

    f changes as it does to the next nodes of a grid, or to the nearest readings of a list.
    """
    off = misalignment(table)
    of_light = sum(cosine_error(np.cos(pairs.angles[:, k]), off) for k in (0, 2))
    most = _change_on_grid(table, pairs, angle) if table.layout.gridded else _change_in_list(table, pairs, angle)

    def change_of(channel: int, column: Column) -> Column:
        size = np.maximum((np.abs(column.a) + np.abs(column.b)) / 2, 1e-300)
        return column._replace(error=np.minimum(column.error + of_light + most[:, channel] / size, ALL))

    return pairs.changed(change_of)


def _change_on_grid(table: Table, pairs: Pairs, angle: float) -> np.ndarray:
    # Of all axes together.
    most = np.zeros((len(pairs), len(table.channels)))
    for change in changes_to_next_nodes(table, pairs.cells):
        most += _over_angle(change, angle)
    return most


def _change_in_list(table: Table, pairs: Pairs, angle: float) -> np.ndarray:
    # The steepest to the nearest readings of either of a pair, for each of both readings.
    there = pairs.angles[:, [2, 3, 0, 1]] if pairs.exchanged else pairs.angles
    most = np.zeros((2 * len(pairs), len(table.channels)))
    for change in changes_to_nearest_readings(table, np.concatenate([pairs.angles, there])):
        most = np.fmax(most, _over_angle(change, angle))
    return most[: len(pairs)] + most[len(pairs) :]


def _over_angle(change: Change, angle: float) -> np.ndarray:
    """The part of changes (n, channels) that a displacement may make."""
    share = np.minimum(1.0, STEEPER * angle / np.maximum(change.distance, 1e-12))[:, None]
    return np.where(change.size > UNRESOLVED * change.larger, change.size, share * change.size)

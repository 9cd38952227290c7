"""Readings of a fit that repeat others: they count once in its uncertainties and tests."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gonio.data.channels import Channels
from gonio.data.plausibility.copies import Symmetry, Values, first_copies, may_hold_copies, places
from gonio.fitting.problem.parameterisation import parameters
from gonio.fitting.problem.readings import Readings
from gonio.models.expression.builder import build
from gonio.models.expression.parser import Term

STEP = 1e-3
"""Relative change by which free numbers differ, so that widths which may differ do."""


class DistinctReadings(NamedTuple):
    """The readings without copies, and how often (k,) each of them is in the table."""

    readings: Readings
    times: np.ndarray


def symmetry_of(models: Sequence[tuple[Term, ...]], channels: Channels) -> Symmetry:
    """What none of the models can tell apart, whatever their free numbers."""
    turned, exchanged = True, True
    for terms in models:
        s, _, given = parameters(terms, len(channels))
        moved = np.asarray(given) * (1.0 + STEP * np.arange(1, s.size + 1))
        brdf = build(s.filled(terms, [moved]), np.asarray)
        turned &= brdf.isotropic and brdf.symmetric
        exchanged &= "reciprocity" not in brdf.violates
    return Symmetry(turned, exchanged)


def distinct_readings(readings: Readings, symmetry: Symmetry) -> DistinctReadings | None:
    """The readings without those that repeat others; None where they are no copies, see `first_copies`."""
    if readings.rows is not None:
        each = ((places(r.wi, r.wo, symmetry), Values(r.f, r.valid)) for r in readings.parts())
        if not may_hold_copies(each, readings.rows.shape[0]):
            return None
        readings = readings.in_memory
    first = first_copies(readings.wi, readings.wo, Values(readings.f, readings.valid), symmetry)
    if first is None:
        return None
    times = np.bincount(first, minlength=first.size)
    kept = np.flatnonzero(times)
    return DistinctReadings(readings.part(kept), times[kept])


def weighted_as_read(distinct: DistinctReadings, noise_known: bool) -> Readings:
    """The distinct readings with weights for a fit: once each where the noise is known, else as often as they stand.

    Without known noise the numbers are those that all readings give, and their uncertainties those of the distinct.
    """
    return distinct.readings if noise_known else dataclasses.replace(distinct.readings, cell_weight=distinct.times)

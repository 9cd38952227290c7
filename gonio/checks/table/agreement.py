"""Agreement of a table with a stated truth: readings beside a reference's values, by the region that differs most."""

import dataclasses
from typing import NamedTuple

import numpy as np

from gonio.checks.certificate import FAIL, NOT_APPLICABLE, PASS, UNDECIDED, Property, without_residual
from gonio.checks.common_channels import common_channels, without_partner
from gonio.checks.direction_search import refuse_other_channels, values
from gonio.checks.table.comparison import MAY_BE_INTERPOLATION, compare, only_surely
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.one_azimuth import is_taken_as_isotropic, turned_to
from gonio.checks.table.pairs.between_readings import between_readings, change_across_gaps, uncertainty_between
from gonio.checks.table.pairs.displacement import cosine_error, misalignment, miscalibration
from gonio.checks.table.pairs.equal_pairs import some_of
from gonio.checks.table.pairs.pairs import FEWEST, ROUNDING, Pairs
from gonio.checks.table.pairs.places import pair_angles
from gonio.checks.table.regions import MOST_UNCOVERED, uncovered
from gonio.data.flags import Flag
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.display import listed, percent
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import Direction

MOST_READINGS = 200_000
OTHER_AZIMUTHS = (
    " But they were read with the light at other azimuths: a brushed or woven surface differs like that, and no"
    " readings at normal incidence say that it is isotropic."
)
MOST_AVERAGED = 20_000
"""Readings that are held against averages over apertures, each an integral."""
AVERAGED_TO = 1e-3
"""Relative error allowed to these."""
MOST_MOVED = 4_000
"""Readings by which it is seen whether the instrument's alignment explains a difference."""
MAY_BE_OFF = (
    " The instrument's alignment ({angle:.2g}°) or calibration ({share}), as stated, may explain it: k = 2, both"
    " directions off."
)
MAY_SHARE = (
    " What all readings share of their stored uncertainties, as they scatter less ({share}: k = 2), may explain it."
)
MOST_SURELY = 20_000
"""Readings by which it is seen whether what differs may lie between those of another table."""


def table_agreement(evidence: TableEvidence, tolerance: float) -> Property:
    """The relative difference between readings and a reference's values: of the region where it is largest.

    Where uncertainties are stored a family of tests decides at the level, as for reciprocity. Raises GonioError where
    the reference has another number of channels, neither of them one.
    """
    if evidence.reference is None:
        return without_residual("agreement", NOT_APPLICABLE, tolerance, "Not testable: no truth is stated.")
    alike, lacking = _of_common_channels(evidence)
    judged = _agreement(alike, tolerance)
    if lacking:
        judged.detail += lacking
        judged.verdict = UNDECIDED if judged.verdict == PASS else judged.verdict
    return judged


def _of_common_channels(evidence: TableEvidence) -> tuple[TableEvidence, str]:
    """The evidence of the channels that the table and its reference share, and what the reference lacks, in words."""
    table, other = evidence.table, evidence.reference
    channels = other.channels if isinstance(other, Table) else evidence.reference_channels
    pairs = None if channels is None else common_channels(table.channels, channels)
    if pairs is None or channels is None:
        return evidence, ""
    of_table, of_reference = zip(*pairs, strict=True)
    lacking = without_partner(table.channels.names, {*of_table})
    if of_table != tuple(range(len(table.channels))):
        table = table.only([table.channels.names[k] for k in of_table])
    if of_reference != tuple(range(len(channels))):
        if not isinstance(other, Table):
            raise GonioError(
                f"the reference is of {listed(channels.names)}, the table of {listed(table.channels.names)}: a model is"
                " compared in all of its channels; give readings of all of them"
            )
        other = other.only([channels.names[k] for k in of_reference])
    return dataclasses.replace(evidence, table=table, reference=other), lacking


def _agreement(evidence: TableEvidence, tolerance: float) -> Property:
    assert evidence.reference is not None
    block = evidence.table.samples(MOST_READINGS)
    f = np.where(block.flag == Flag.VALID, block.f, np.nan).astype(float)
    f[~evidence.table.layout.are_readable(block.wi.z, block.wo.z)] = np.nan
    number = int(np.isfinite(f).any(axis=1).sum())
    if np.isfinite(f).sum(axis=0).max(initial=0) < FEWEST:
        detail = f"Only {number} readings can be compared; at least {FEWEST} are needed."
        return without_residual("agreement", UNDECIDED, tolerance, detail)
    readings = _Readings(block.wi, block.wo, f, np.asarray(block.u_f, float))
    judged = (
        _with_readings(evidence, evidence.reference, readings, tolerance)
        if isinstance(evidence.reference, Table)
        else _with_model(evidence, evidence.reference, readings, tolerance)
    )
    judged.facts = {"readings": number} | judged.facts
    return judged


class _Readings(NamedTuple):
    """Directions (n,), f, NaN where it is not valid, and its uncertainty, (n, C)."""

    wi: Direction
    wo: Direction
    f: np.ndarray
    u: np.ndarray

    def thinned(self, most: int) -> "_Readings":
        """At most so many of them, chosen at random: a step through a grid may meet the same azimuths again."""
        return self if len(self.f) <= most else self.rows(some_of(len(self.f), most))

    def valid(self) -> "_Readings":
        """Those of which any channel is valid."""
        return self.rows(np.flatnonzero(np.isfinite(self.f).any(axis=1)))

    def rows(self, some: np.ndarray) -> "_Readings":
        """Those of the numbers `some`."""
        wi, wo = (Direction(*(np.asarray(c)[some] for c in w)) for w in (self.wi, self.wo))
        return _Readings(wi, wo, self.f[some], self.u[some])


def _with_model(evidence: TableEvidence, truth: AbstractBRDF, readings: _Readings, tolerance: float) -> Property:
    """By the reference's values, averaged over the apertures that the table states, as its readings are."""
    from gonio.fitting.apertures import half_angles_of

    half_angles, what = half_angles_of(evidence.table), "The table's readings and the reference's values"
    if any(half_angles):
        every = readings.valid()
        readings = every.thinned(MOST_AVERAGED)
        chosen = f" of {len(every.f):,} readings {MOST_AVERAGED:,} chosen at random," * (len(every.f) > MOST_AVERAGED)
        what += f", averaged over half-angles of {_in_degrees(half_angles)} (source, detector),{chosen}"

    def judged(some: _Readings, off: np.ndarray | float) -> Property:
        true, error = _expected(truth, some, half_angles)
        refuse_other_channels(some.f.shape[-1], true.shape[-1])
        size = np.maximum((np.abs(some.f) + np.abs(true)) / 2, 1e-300)
        f, true, u, error = np.broadcast_arrays(some.f, true, some.u, (error + off) / size)
        known, angles = (f, true, u, np.zeros(f.shape)), pair_angles(some.wi, some.wo)
        pairs = Pairs.of_arrays(known, angles, len(f), "each with the reference", error, exchanged=False)
        return compare(evidence, pairs, np.ones(len(f))).judged("agreement", evidence, tolerance, what)

    alone = judged(readings, 0.0)
    angle, share = misalignment(evidence.table), miscalibration(evidence.table)
    if alone.verdict != FAIL or not (angle or share):
        return alone
    some = readings.valid().thinned(MOST_MOVED)
    off = share * np.abs(some.f) + _moved(truth, some, half_angles, angle)
    words = MAY_BE_OFF if "instrument" in evidence.table.provenance else MAY_SHARE
    return only_surely(alone, judged(some, off), words.format(angle=np.degrees(angle), share=percent(share)))


def _expected(
    truth: AbstractBRDF, readings: _Readings, half_angles: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """(values, errors) of the reference over both apertures, 1/sr, (n, C) each."""
    if not any(half_angles):
        value = values(truth, readings.wi, readings.wo)
        return value, np.zeros(value.shape)

    from gonio.instrument.aperture import average_on_sides

    def allowed(f: np.ndarray, _: np.ndarray) -> np.ndarray:
        return AVERAGED_TO * np.abs(f) + 1e-300

    return average_on_sides(truth, readings.wi, readings.wo, half_angles, allowed)


def _moved(truth: AbstractBRDF, some: _Readings, half_angles: tuple[float, float], angle: float) -> np.ndarray:
    """By how much the expected readings change where both directions are off by an angle, 1/sr (n, C)."""
    here = _expected(truth, some, half_angles)[0]
    total = np.abs(here) * cosine_error(some.wi.z, angle)[:, None]
    for of_light in (True, False) if angle else ():
        w = some.wi if of_light else some.wo
        for axis in _across(w):
            change = np.zeros(1)
            for step in (-angle, angle):
                turned = Direction(*(np.cos(step) * c + np.sin(step) * a for c, a in zip(w, axis, strict=True)))
                there = some._replace(**{"wi" if of_light else "wo": turned})
                change = np.fmax(change, np.abs(_expected(truth, there, half_angles)[0] - here))
            total = total + change
    return total


def _across(w: Direction) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Unit vectors of growing polar angle and azimuth at directions (n,)."""
    sine = np.hypot(w.x, w.y)
    c, s = (np.where(sine > 0, a / np.maximum(sine, 1e-300), first) for a, first in ((w.x, 1.0), (w.y, 0.0)))
    return (w.z * c, w.z * s, -sine), (-s, c, np.zeros_like(s))


def _in_degrees(angles: tuple[float, float]) -> str:
    return " and ".join(f"{np.degrees(angle):.3g}°" for angle in angles)


def _with_readings(evidence: TableEvidence, other: Table, readings: _Readings, tolerance: float) -> Property:
    """By what is known of the other table between its readings: no better than these show it, and not beyond them."""
    f, angles = readings.f, pair_angles(readings.wi, readings.wo)
    refuse_other_channels(f.shape[-1], len(other.channels))
    pairs, what = _pairs(readings, other), "The table's readings and the other table's, interpolated,"
    compared = compare(evidence, pairs, np.ones(len(f)))
    if compared.differences.by_channel.max(initial=0) < FEWEST:
        number = int(compared.differences.comparable.sum())
        detail = (
            f"Of {len(f):,} readings {number:,} lie where the other table was read closely enough; at least {FEWEST} "
            "are needed."
        )
        return without_residual("agreement", UNDECIDED, tolerance, detail)
    judged = compared.judged("agreement", evidence, tolerance, what)
    if judged.verdict == FAIL:
        judged = _surely(judged, evidence, other, readings.thinned(MOST_SURELY), tolerance)
    elif judged.verdict == UNDECIDED:
        judged.detail += MAY_BE_INTERPOLATION
    read = angles[np.isfinite(f).any(axis=1)]
    share, where = uncovered(read, angles[compared.differences.comparable], every=True)
    if share > 0:
        judged.detail += f" The other table says nothing of {percent(share)} of them, {where}: undecided there."
        judged.verdict = UNDECIDED if judged.verdict == PASS and share > MOST_UNCOVERED else judged.verdict
    return judged


def _surely(failed: Property, evidence: TableEvidence, other: Table, some: _Readings, tolerance: float) -> Property:
    """What fails by interpolated values, judged by what the readings of the other table allow.

    Pairs that are turned about the normal count where either table is that of an isotropic surface.
    """
    what, angles = "The table's readings and the other table's, around them,", pair_angles(some.wi, some.wo)
    gaps = change_across_gaps(angles, some.f, other, not evidence.table.layout.has_azimuth_of_light)
    pairs = _pairs(some, other, gaps).within_readings()

    def judged(some_of: np.ndarray) -> Property:
        compared = compare(evidence, pairs.where(some_of), np.ones(np.count_nonzero(some_of)))
        return compared.judged("agreement", evidence, tolerance, what)

    surely = only_surely(failed, judged(np.ones(len(pairs), bool)))
    turned = turned_to(other, angles)
    if surely.verdict != FAIL or not turned.any():
        return surely
    both = evidence, dataclasses.replace(evidence, table=other)
    if any(is_taken_as_isotropic(dataclasses.replace(surely), one, tolerance) for one in both):
        return surely
    alike = judged(~turned) if np.count_nonzero(~turned) >= FEWEST else None
    if alike is None or alike.verdict != FAIL:
        surely.verdict = UNDECIDED
        surely.detail += OTHER_AZIMUTHS
        return surely
    return alike


def _pairs(readings: _Readings, other: Table, gaps: np.ndarray | float = 0.0) -> Pairs:
    """The readings with values of the other table; `gaps` (n, C), 1/sr: what may lie between its readings."""
    between = between_readings(other, readings.wi, readings.wo)
    u = uncertainty_between(other, readings.wi, readings.wo)
    f, u_f, value, error, around, u = np.broadcast_arrays(readings.f, readings.u, *between[:3], u)
    dark = np.maximum(np.abs(f), np.abs(value)) <= ROUNDING * np.nanmax(np.abs(f), axis=0, initial=0.0)
    f, value = (np.where(dark, 0.0, v) for v in (f, value))
    size = np.maximum((np.abs(f) + np.abs(value)) / 2, 1e-300)
    around = np.where(around == 0, 0.0, np.maximum(around, gaps)) / size
    return Pairs.of_arrays(
        (f, value, u_f, u), pair_angles(readings.wi, readings.wo), len(f), "each with the other table", error,
        around=around, exchanged=False,
    )  # fmt: skip

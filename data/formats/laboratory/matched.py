"""The round trip of a table into a file whose cells are others, or stand in another order."""

import dataclasses

import numpy as np

from gonio.data.flags import Flag
from gonio.data.material import Material
from gonio.data.round_trip import RoundTrip, compare
from gonio.data.table import Table
from gonio.models.display import listed

MOST_SAMPLES = 40_000
"""Pairs at which a resampled file is compared."""
WITHIN = np.radians(75.0)
SAME_COMPONENT = 1e-8
"""Of unit vectors: directions whose components differ by less are one."""


def matched(written: Table, read: Table, note: str = "") -> RoundTrip:
    """The round trip of a table into one with other cells, or the same in another order, by its valid readings.

    A reading whose directions and channel are not there again is lost; of repeats the first is the first. Channels that
    the file names otherwise are in the note.
    """
    names = [t.channels.names for t in (written, read)]
    if names[0] != names[1]:
        note = "; ".join(filter(None, [note, f"{listed(names[0])} are named {listed(names[1])} there"]))
    (one, f), (two, again) = (_by_direction(table) for table in (written, read))
    _, first, second = np.intersect1d(one, two, assume_unique=True, return_indices=True)
    valid = np.ones(len(first), bool)
    result = compare(f[first], again[second], valid, valid, note)
    return dataclasses.replace(result, lost=one.size - first.size)


def sampled_error(source: Table | Material, read: Table, note: str = "") -> RoundTrip:
    """The round trip of a table or a model that was resampled: the file, interpolated, at readings of the source.

    Of a model these are random pairs of directions within 75° of the normal that the file's grid covers.
    """
    from gonio.data.interpolation.multilinear import as_material
    from gonio.models.evaluation import evaluate, evaluate_in_blocks
    from gonio.models.geometry.directions import from_spherical

    if isinstance(source, Table):
        sample = source.samples(limit=MOST_SAMPLES)
        wi, wo, f, valid = sample.wi, sample.wo, sample.f, sample.flag == Flag.VALID
    else:
        rng = np.random.default_rng(0)
        (ti, to), (pi, po) = rng.uniform(0, WITHIN, (2, MOST_SAMPLES)), rng.uniform(0, 2 * np.pi, (2, MOST_SAMPLES))
        near = np.arange(MOST_SAMPLES) % 2 == 0  # half of them about mirror reflection
        spread = rng.normal(0, 0.1, (2, MOST_SAMPLES))
        to, po = np.where(near, np.clip(ti + spread[0], 0, WITHIN), to), np.where(near, pi + np.pi + spread[1], po)
        wi, wo = from_spherical(ti, pi, np), from_spherical(to, po, np)
        f = np.asarray(evaluate_in_blocks(source.brdf, wi, wo))
        valid = np.isfinite(f)
    again = np.asarray(evaluate(as_material(read), wi, wo))
    f, valid = (np.broadcast_to(a, again.shape) for a in (f, valid))
    return compare(f, again, valid, valid & np.isfinite(again), note)


def _by_direction(table: Table) -> tuple[np.ndarray, np.ndarray]:
    """(a number for directions, channel and repeat, f) of the valid readings of a table."""
    cells = table.valid_cells()
    values = table.values_at(cells)
    row, channel = np.nonzero(values["flag"] == Flag.VALID)
    wi, wo = table.layout.directions_at(cells)
    # The offset keeps round numbers, of which many files are made, off the limits between two integers.
    steps = [np.round(c / SAME_COMPONENT + 0.1237).astype(np.int64).astype(np.uint64)[row] for c in (*wi, *wo)]
    code = np.zeros(row.size, np.uint64)
    for part in (*steps, channel.astype(np.uint64)):
        code = (code ^ part) * np.uint64(0x9E3779B97F4A7C15)
        code ^= code >> np.uint64(29)
    order = np.argsort(code, kind="stable")
    starts = np.flatnonzero(np.concatenate([[True], np.diff(code[order]) != 0])) if row.size else np.zeros(0, int)
    repeat = np.empty(row.size, np.uint64)
    repeat[order] = (np.arange(row.size) - np.repeat(starts, np.diff(starts, append=row.size))).astype(np.uint64)
    return code + repeat, values["f"][row, channel]

"""The budget of a table's quantities: each source's error, put into the readings, and what that makes of them."""

import dataclasses
import math

import numpy as np

from gonio.data.stated import TERMS
from gonio.data.table import Table
from gonio.fitting.apertures import half_angles_of
from gonio.metrology.budget import Budget, Contribution
from gonio.metrology.effects import Readings
from gonio.metrology.measurands import TableMeasurands
from gonio.metrology.sources import ESTIMATED, STORED, Source, Sources

INTERPOLATION, APERTURE, EDGE_LOSS = "interpolation", "aperture", "edge_loss"
NO_SLOPES = "nothing says how f changes between readings on no grid; give a model that fits them"


def table_budget(measurands: TableMeasurands, readings: Readings, sources: Sources) -> Budget:
    """The budget of the quantities of a table; `readings` are those of the same table."""
    table, base = measurands.table, measurands.base
    rows, missing = [], dict(sources.missing)
    for part in sources.noise:
        noise = measurands.read_out(dataclasses.replace(table, u_f=part.u_f)).noise
        rows.append(Contribution(part.name, part.meaning, False, noise, dof=part.dof, origin=part.origin))
    unbounded = ~np.isfinite(base.bounds)
    between = np.where(unbounded, 0.0, np.maximum(base.bounds, 0.0)) / math.sqrt(3.0)
    meaning = "light between and beyond the readings"
    rows.append(Contribution(INTERPOLATION, meaning, False, between, shape="rectangular", origin=ESTIMATED))
    aperture = aperture_shift(table, readings)
    if isinstance(aperture, str):
        missing[APERTURE] = aperture
    elif aperture.any():
        rows.append(of_apertures(measurands.read_out(readings.moved(aperture)).values - base.values))
    if (edge := edge_loss(table, list(table.channels.names))).any():
        rows.append(of_edge_loss(measurands.scaled(table, edge / (1 - edge))))
    for name, source in sources.acting.items():
        if TERMS[name].acts == "factor":
            rows.append(shared(source, measurands.scaled(table, source.stated.standard)))
        elif (shift := readings.shift(name, source.stated.standard)) is None:
            missing[name] = NO_SLOPES
        else:
            rows.append(shared(source, measurands.read_out(readings.moved(shift)).values - base.values))
    return Budget(rows, missing, unbounded)


def shared(source: Source, values: np.ndarray) -> Contribution:
    """The contribution of a systematic term that moves the quantities by these values (Q,)."""
    stated, term = source.stated, TERMS[source.stated.name]
    unit = "rad" if term.acts == "angle" else "1"
    return Contribution(
        stated.name, term.meaning, True, values, stated.standard, unit, stated.shape, stated.dof, source.origin
    )


def of_apertures(values: np.ndarray) -> Contribution:
    """The contribution of averages over the apertures, by which the quantities are off (Q,): it is not corrected."""
    meaning, values = "averages over the apertures, not corrected", values / math.sqrt(3.0)
    return Contribution(APERTURE, meaning, True, values, shape="rectangular", origin=ESTIMATED)


def edge_loss(table: Table, channels: list[str]) -> np.ndarray:
    """The share that spots of finite size lost of each quantity (Q,), by its channel, as the table states it."""
    stated = table.provenance.get("edge_loss")
    lost = stated.get("lost") if isinstance(stated, dict) else None
    if not isinstance(lost, list) or not all(isinstance(v, int | float) and 0 <= v < 1 for v in lost):
        return np.zeros(len(channels))
    names = table.channels.names if len(lost) > 1 else [""]
    known = dict(zip(names, lost, strict=False))
    return np.array([known.get(c if len(lost) > 1 else "", 0.0) for c in channels])


def of_edge_loss(values: np.ndarray) -> Contribution:
    """The contribution of light that left beside the viewed spot, which the quantities (Q,) lack: not corrected."""
    meaning, values = "light that leaves beside the viewed spot, not corrected", values / math.sqrt(3.0)
    return Contribution(EDGE_LOSS, meaning, True, values, shape="rectangular", origin=STORED)


def aperture_shift(table: Table, readings: Readings) -> np.ndarray | str:
    """By how much readings (n, C) are off by being averages over discs; or why that is not known."""
    stated = table.provenance.get("instrument")
    if table.receiver_solid_angle is None and stated is None:
        return "the table stores no solid angle"
    if not any(half_angles_of(table)):
        return np.zeros(1)
    shift = readings.averaged_over_discs()
    return NO_SLOPES if shift is None else shift

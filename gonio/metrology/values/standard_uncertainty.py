"""The standard uncertainty of values of f: between the readings of a table, or of a fitted model."""

import numpy as np
from numpy.typing import ArrayLike

from gonio.checks.table.one_azimuth import azimuth_dependence
from gonio.data.angles import radian_arrays
from gonio.data.flags import Flag
from gonio.data.interpolation.coverage import covered
from gonio.data.interpolation.multilinear import as_material, coarsened, with_light_at_x
from gonio.data.interpolation.scattered import scattered_material
from gonio.data.material import Material
from gonio.data.plausibility.correlated_uncertainty import correlated_uncertainty, with_scatter
from gonio.data.plausibility.understated_uncertainty import as_scattered, understated_uncertainty
from gonio.data.subject import Subject, SubjectLike, resolve_subject
from gonio.data.table import Table
from gonio.metrology.fit_numbers import FitNumbers
from gonio.metrology.values.between_nodes import NodeUncertainty
from gonio.metrology.values.between_samples import SampleUncertainty
from gonio.metrology.values.uncertain_part import RECTANGULAR, Uncertain
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical

ROWS = 200_000
"""Pairs of directions of a fit at once."""
SAME_AZIMUTH = 1e-6
NOTHING = 1e-9
"""Share of f that is no uncertainty but rounding."""


def standard_uncertainty(
    subject: SubjectLike,
    theta_i: ArrayLike,
    phi_i: ArrayLike,
    theta_o: ArrayLike,
    phi_o: ArrayLike,
    degrees: bool = False,
) -> np.ndarray:
    """The standard uncertainty of f of a table or of a fit at any directions, 1/sr.

    Of a table: what its readings' own uncertainties leave in the interpolated value, what they share as far as they
    show it, and what may lie between the readings, as their bends, or the prediction of each by the others, show it.
    Of a table whose readings state no uncertainty it is that of what lies between them alone, and NaN at a reading.
    Of a fit: by the covariance of its numbers. Errors that a table states apart from its readings' uncertainties
    (calibration, angles) are in `gonio.quantities(table, budget=True)`.

    Args:
        subject: a table or a fit, or the file of one.
        theta_i, phi_i, theta_o, phi_o: polar angles and azimuths of light and detector, as `Material.f` takes them.
        degrees: whether they are degrees; else radians.

    Returns:
        Array of the angles' broadcast shape + (channels,); NaN where nothing bounds f, or nothing is known: beyond the
        readings, or of a model that was not fitted.

    Raises:
        GonioError: angles out of range, shapes that do not broadcast, what is no subject.

    References:
        JCGM 100:2008, 4.3.7 and 5.1.2.
    """
    angles = radian_arrays(degrees, True, theta_i=theta_i, phi_i=phi_i, theta_o=theta_o, phi_o=phi_o)
    theta_i, phi_i, theta_o, phi_o = angles
    wi, wo = (from_spherical(t.ravel(), p.ravel(), np) for t, p in ((theta_i, phi_i), (theta_o, phi_o)))
    u = uncertainty_of_values(resolve_subject(subject), wi, wo)
    return u.reshape(*angles[0].shape, u.shape[1])


def uncertainty_of_values(subject: Subject, wi: Direction, wo: Direction) -> np.ndarray:
    """The same of directions with NumPy components (n,): (n, C)."""
    if subject.table is not None:
        return table_uncertainty(subject.table, wi, wo)
    return fit_uncertainty(subject.as_material(), wi, wo)


def fit_uncertainty(material: Material, wi: Direction, wo: Direction) -> np.ndarray:
    """The standard uncertainty (n, C) of f by the covariance of a fit's numbers; NaN of a model that is no fit."""
    numbers, n = FitNumbers.of(material), wi.z.size
    if numbers is None:
        return np.full((n, len(material.channels)), np.nan)
    parts = []
    for start in range(0, max(n, 1), ROWS):
        rows = slice(start, start + ROWS)
        directions = [Direction(*(c[rows] for c in w)) for w in (wi, wo)]

        def values(brdf: AbstractBRDF, directions: list[Direction] = directions) -> np.ndarray:
            return np.asarray(evaluate(brdf, *directions), float).reshape(-1, len(material.channels))

        parts.append(numbers.spread(numbers.slopes(values)))
    u = np.concatenate(parts)
    return np.where(np.isfinite(u), u, np.nan)


def table_uncertainty(table: Table, wi: Direction, wo: Direction) -> np.ndarray:
    """The standard uncertainty (n, C) of f between a table's readings; NaN where nothing bounds it."""
    u = np.full((wi.z.size, len(table.channels)), np.nan)
    if not table.valid_cells().size:
        return u
    same = _same_azimuth(table, wi)
    table = with_light_at_x(table)
    inside = np.flatnonzero(covered(table, wi, wo) & same)
    if not inside.size:
        return u
    wi, wo = (Direction(*(np.asarray(c, float)[inside] for c in w)) for w in (wi, wo))
    value = np.asarray(evaluate(as_material(table), wi, wo)).reshape(inside.size, -1)
    f, rounding = np.asarray(value, float), np.finfo(value.dtype).eps * np.abs(value)
    common = correlated_uncertainty(table)
    read = as_scattered(with_scatter(table, common), understated_uncertainty(table))
    noise, between = _by_part(read, wi, wo, f)
    combined = np.sqrt(noise**2 + between**2 + (common.relative * f) ** 2)
    # Where a reading is nothing lies between: without its own uncertainty none is known there.
    known = np.isfinite(combined) & (states_uncertainties(table) | (combined > NOTHING * np.abs(f)))
    u[inside] = np.where(known, np.hypot(combined, rounding), np.nan)
    return u


def states_uncertainties(table: Table) -> bool:
    """Whether all valid readings of a table state their standard uncertainty."""
    if table.u_f is None:
        return False
    valid = np.asarray(table.flag[...]) == Flag.VALID
    return bool(np.isfinite(np.asarray(table.u_f[...]))[valid].all())


def _by_part(table: Table, wi: Direction, wo: Direction, f: np.ndarray) -> Uncertain:
    """Of directions about which there are readings, by the sides of light and detector; f (n, C) is the value there."""
    if table.interpolant is not None:
        return _by_own_rule(table, wi, wo, f)
    u = Uncertain(*(np.full(f.shape, np.nan) for _ in range(2)))
    upright = [w._replace(z=np.abs(w.z)) for w in (wi, wo)]
    for (light, detector), part in table.parts().items():
        here = np.flatnonzero((light * wi.z > 0) & (detector * wo.z > 0))
        if not here.size or not part.valid_cells().size:
            continue
        i, o = (Direction(*(c[here] for c in w)) for w in upright)
        known = _of_part(part, light == detector, i, o, f[here])
        for kept, new in zip(u, known, strict=True):
            kept[here] = new
    return u


def _by_own_rule(table: Table, wi: Direction, wo: Direction, f: np.ndarray) -> Uncertain:
    """Of a format's own interpolation: by the difference from that of half as many nodes, unknown where it has none."""
    try:
        coarse = np.asarray(evaluate(as_material(coarsened(table)), wi, wo), float).reshape(f.shape)
    except GonioError:
        coarse = np.full(f.shape, np.nan)
    return Uncertain(np.zeros(f.shape), np.abs(f - coarse) / RECTANGULAR)


def _of_part(part: Table, reflects: bool, wi: Direction, wo: Direction, f: np.ndarray) -> Uncertain:
    if part.layout.gridded:
        return NodeUncertainty(part, reflects).of(wi, wo, f)
    turns = azimuth_dependence(part) is None
    known = SampleUncertainty(part, reflects and turns).of(wi, wo, f)
    if turns or not reflects:
        return known
    # Its interpolation takes exchanged readings for the same, turned about the normal: this surface shows otherwise.
    alone = np.asarray(evaluate(scattered_material(part, False), wi, wo), float).reshape(f.shape)
    return known._replace(between=np.hypot(known.between, f - alone))


def _same_azimuth(table: Table, wi: Direction) -> np.ndarray:
    """Whether light (n,) comes from the azimuth that a table was read with, if that matters to its surface."""
    if azimuth_dependence(table) is None:
        return np.ones(wi.z.size, bool)
    _, phi, _, _ = (np.asarray(a, float) for a in table.layout.angles())
    phi = float(phi[np.argmax(np.asarray(table.layout.angles()[0]) > SAME_AZIMUTH)])
    sine = np.hypot(wi.x, wi.y)
    return (wi.x * np.cos(phi) + wi.y * np.sin(phi) > sine - SAME_AZIMUTH) & (sine > SAME_AZIMUTH)

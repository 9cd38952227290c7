"""The edges of the hemisphere: at the normal a direction has no azimuth, and at the horizon no flux leaves."""

import numpy as np

from gonio.checks.certificate import Property, verdict_of
from gonio.checks.direction_search import directions, precision, values
from gonio.checks.model.reciprocity import relative_difference, rounding_floor, where_of
from gonio.checks.table.reciprocity import FEWEST, not_applicable
from gonio.data.flags import Flag
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.low_discrepancy import low_discrepancy

NEAR_POLE = (1e-6, 1e-7)
NEAR_HORIZON = 1e-10
POINTS = 1024


def model_pole(brdf: AbstractBRDF, tolerance: float) -> Property:
    """The change of f with the azimuth of a direction that nears the normal, carried on to the normal itself."""
    u = low_discrepancy(POINTS, 4)
    theta, phi = np.arccos(1 - 0.999 * u[:, 0]), 2 * np.pi * u[:, 1]
    # Half of the others near the normal themselves, where narrow lobes then are.
    theta[::2] = 10 ** (-4 * u[::2, 0])
    first, turn = 2 * np.pi * u[:, 2], np.pi * u[:, 3]
    other = directions(theta, phi)
    gaps = []
    for near in NEAR_POLE:
        pole = [directions(np.full(POINTS, near), a) for a in (first, first + turn)]
        ways = [(pole[k], other) for k in (0, 1)], [(other, pole[k]) for k in (0, 1)]
        f = np.stack([np.stack([values(brdf, *way) for way in both]) for both in ways])
        floor = rounding_floor(float(np.nanmax(np.abs(f), initial=0.0)))
        gaps.append(relative_difference(f[:, 0], f[:, 1], floor).max(axis=-1))
    finite = np.isfinite(gaps[0]) & np.isfinite(gaps[1])
    far, close = (np.where(finite, g, 0.0) for g in gaps)
    ratio = NEAR_POLE[0] / NEAR_POLE[1]
    left = np.abs(ratio * close - far) / (ratio - 1)
    way, k = np.unravel_index(np.argmax(left), left.shape)
    residual = float(left[way, k])
    bound = float(far[way, k] ** 2) + 64 * precision()
    angles = np.array([0.0, first[k], theta[k], phi[k]])
    where = where_of(angles if way == 0 else angles[[2, 3, 0, 1]])
    detail = f"As a direction nears the normal, f still depends on its azimuth by {residual:.2g} (relative) at most."
    if not finite.all():
        detail += f" f is not finite at {int(np.count_nonzero(~finite))} places."
        residual = np.nan if residual <= tolerance else residual
    return Property("pole", verdict_of(residual, bound, tolerance), residual, bound, tolerance, where, detail)


def model_horizon(brdf: AbstractBRDF, tolerance: float) -> Property:
    """f cosθo at the horizon, relative to its largest value at that incidence: light must not leave along the surface.

    By reciprocity, f cosθo > 0 there means that the albedo grows without limit as the light nears the horizon.
    """
    u = low_discrepancy(32, 2)
    theta_i, phi_i = (np.repeat(a, 33) for a in (np.radians(85 * u[:, 0]), 2 * np.pi * u[:, 1]))
    turns = np.tile(np.linspace(0, 2 * np.pi, 33), 32)
    cosines = np.concatenate([[NEAR_HORIZON], np.linspace(0.02, 1, 15)])
    flux = []
    for c in cosines:
        wo = directions(np.full(theta_i.size, np.arccos(c)), phi_i + turns)
        wo = type(wo)(wo.x, wo.y, np.full(theta_i.size, c))
        flux.append(np.abs(values(brdf, directions(theta_i, phi_i), wo)) * c)
    flux = np.stack(flux)
    undefined = not np.isfinite(flux).all()
    largest = np.nan_to_num(flux).reshape(cosines.size, 32, 33, -1).max(axis=(0, 2))
    share = np.nan_to_num(flux[0]).reshape(32, 33, -1) / np.maximum(largest[:, None], 1e-300)
    at = np.unravel_index(np.argmax(share), share.shape)
    residual = float(share[at])
    k = at[0] * 33 + at[1]
    where = where_of(
        np.array([theta_i[k], phi_i[k], np.pi / 2, phi_i[k] + turns[k]]), at[2] if share.shape[2] > 1 else None
    )
    detail = f"f cosθo at the horizon is {residual:.2g} of its largest value at the same incidence."
    if undefined:
        detail += " It is not finite at some places."
    # What is left of √cosθ at this distance counts as the error.
    bound = 2 * np.sqrt(NEAR_HORIZON)
    found = np.nan if undefined and residual <= tolerance else residual
    return Property("horizon", verdict_of(found, bound, tolerance), residual, bound, tolerance, where, detail)


def table_horizon(table: Table, tolerance: float) -> Property:
    """How far the last ring of readings is from where the two before lead, in e-folds: the median below 70° of light.

    A jump there is the sign of a sample too small for the beam, of a blocked arm, or of a shifted axis.
    """
    grid = table.layout.outgoing_grid()
    if grid is None or grid.theta_o.size < 4:
        return not_applicable("horizon", tolerance, "Not testable: the grid has no rings of polar angles.")
    theta_o, theta_i = grid.theta_o, grid.theta_i
    rings = np.flatnonzero(theta_o < np.pi / 2 - 1e-9)[-3:]
    axis = table.layout.dims.index("theta_o")
    lit = theta_i < np.radians(70)
    f, flag = (np.take(np.asarray(v[...])[lit], rings, axis=axis) for v in (table.f, table.flag))
    f, flag = (np.moveaxis(v, axis, 0) for v in (f, flag))
    ok = ((flag == Flag.VALID) & (f > 0)).all(axis=0)
    if np.count_nonzero(ok) < FEWEST or theta_o[rings[-1]] < np.radians(75):
        return not_applicable("horizon", tolerance, "Not testable: too few positive readings beyond 75°.")
    a, b, c = (np.log(np.where(ok, ring, 1.0)) for ring in f)
    t = (theta_o[rings[2]] - theta_o[rings[1]]) / (theta_o[rings[1]] - theta_o[rings[0]])
    jump = np.where(ok, np.abs(c - b - t * (b - a)), np.nan)
    residual, bound = float(np.nanmedian(jump)), 0.0
    if table.u_f is not None:
        u = np.moveaxis(np.take(np.asarray(table.u_f[...])[lit], rings, axis=axis), axis, 0)
        with np.errstate(all="ignore"):
            r = u / f
            noise = np.sqrt(r[2] ** 2 + ((1 + t) * r[1]) ** 2 + (t * r[0]) ** 2)[ok]
        known = noise[np.isfinite(noise)]
        bound = 0.6745 * float(np.median(known)) if known.size else 0.0
    at = np.unravel_index(np.nanargmax(jump), jump.shape)
    where = {"theta_i": float(np.degrees(theta_i[lit][at[0]])), "theta_o": float(np.degrees(theta_o[rings[-1]]))}
    if jump.shape[-1] > 1:
        where["channel"] = int(at[-1])
    detail = (
        f"The ring of {np.degrees(theta_o[rings[-1]]):.4g}° is off the two before by {residual:.2g} e-folds at the"
        f" median, by {jump[at]:.2g} at the most."
    )
    return Property("horizon", verdict_of(residual, bound, tolerance), residual, bound, tolerance, where, detail)

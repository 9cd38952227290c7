"""The edges of the hemisphere: at the normal a direction has no azimuth, and at the horizon no flux leaves."""

import numpy as np

from gonio.checks.certificate import Property, place_of, relative_difference, verdict_of
from gonio.checks.direction_search import directions, precision, values
from gonio.checks.model.evidence import ModelEvidence
from gonio.checks.model.reciprocity import rounding_floor
from gonio.checks.model.sides import on_every_side
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.low_discrepancy import low_discrepancy

NEAR_POLE = (1e-6, 1e-7)
NEAR_HORIZON = 1e-10
POINTS = 1024
INCIDENCES, AZIMUTHS = 32, 33


@on_every_side
def model_pole(evidence: ModelEvidence, tolerance: float) -> Property:
    """The change of f with the azimuth of a direction that nears the normal, extrapolated to the normal itself."""
    u = low_discrepancy(POINTS, 4)
    theta, phi = np.arccos(1 - 0.999 * u[:, 0]), 2 * np.pi * u[:, 1]
    # Half of the others near the normal themselves, where narrow lobes then are.
    theta[::2] = 10 ** (-4 * u[::2, 0])
    first, turn = 2 * np.pi * u[:, 2], np.pi * u[:, 3]
    gaps = [
        _change_with_azimuth(evidence.brdf, near, (first, first + turn), directions(theta, phi)) for near in NEAR_POLE
    ]
    finite = np.isfinite(gaps[0]) & np.isfinite(gaps[1])
    far, close = (np.where(finite, g, 0.0) for g in gaps)
    ratio = NEAR_POLE[0] / NEAR_POLE[1]
    extrapolated = np.abs(ratio * close - far) / (ratio - 1)
    way, k = np.unravel_index(np.argmax(extrapolated), extrapolated.shape)
    residual = float(extrapolated[way, k])
    bound = float(far[way, k] ** 2) + 64 * precision()
    angles = np.array([0.0, first[k], theta[k], phi[k]])
    where = place_of(angles if way == 0 else angles[[2, 3, 0, 1]])
    detail = f"As a direction nears the normal, f still depends on its azimuth by {residual:.2g} (relative) at most."
    if not finite.all():
        detail += f" f is not finite at {int(np.count_nonzero(~finite))} places."
        residual = np.nan if residual <= tolerance else residual
    return Property("pole", verdict_of(residual, bound, tolerance), residual, bound, tolerance, where, detail)


def _change_with_azimuth(
    brdf: AbstractBRDF, near: float, azimuths: tuple[np.ndarray, np.ndarray], other: Direction
) -> np.ndarray:
    """Relative differences of f by two azimuths of a direction so near to the normal: as wi, and as wo; (2, n)."""
    poles = [directions(np.full(POINTS, near), azimuth) for azimuth in azimuths]
    f = np.stack([[values(brdf, p, other) for p in poles], [values(brdf, other, p) for p in poles]])
    floor = rounding_floor(float(np.nanmax(np.abs(f), initial=0.0)))
    return relative_difference(f[:, 0], f[:, 1], floor).max(axis=-1)


@on_every_side
def model_horizon(evidence: ModelEvidence, tolerance: float) -> Property:
    """f cosθo at the horizon, relative to its largest value at that incidence: light must not leave along the surface.

    By reciprocity, f cosθo > 0 there means that the albedo grows without limit as the light nears the horizon.
    """
    u = low_discrepancy(INCIDENCES, 2)
    theta_i, phi_i = (np.repeat(a, AZIMUTHS) for a in (np.radians(85 * u[:, 0]), 2 * np.pi * u[:, 1]))
    turns = np.tile(np.linspace(0, 2 * np.pi, AZIMUTHS), INCIDENCES)
    cosines = np.concatenate([[NEAR_HORIZON], np.linspace(0.02, 1, 15)])
    wi, flux = directions(theta_i, phi_i), []
    for c in cosines:
        x, y, _ = directions(np.full(theta_i.size, np.arccos(c)), phi_i + turns)
        flux.append(np.abs(values(evidence.brdf, wi, Direction(x, y, np.full(theta_i.size, c)))) * c)
    flux = np.stack(flux)
    undefined = not np.isfinite(flux).all()
    flux = np.nan_to_num(flux).reshape(cosines.size, INCIDENCES, AZIMUTHS, -1)
    share = flux[0] / np.maximum(flux.max(axis=(0, 2))[:, None], 1e-300)
    i, j, channel = np.unravel_index(np.argmax(share), share.shape)
    residual = float(share[i, j, channel])
    k = i * AZIMUTHS + j
    angles = np.array([theta_i[k], phi_i[k], np.pi / 2, phi_i[k] + turns[k]])
    where = place_of(angles, evidence.channel(int(channel), share.shape[2]))
    detail = f"f cosθo at the horizon is {residual:.2g} of its largest value at the same incidence."
    if undefined:
        detail += " It is not finite at some places."
    # What √cosθ still is at this distance counts as the error.
    bound = 2 * np.sqrt(NEAR_HORIZON)
    verdict = verdict_of(np.nan if undefined and residual <= tolerance else residual, bound, tolerance)
    return Property("horizon", verdict, residual, bound, tolerance, where, detail)

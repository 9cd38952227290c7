"""Directional albedos of scattered tables: by the format's own warp where there is one, else by nearest readings."""

import numpy as np

from gonio.checks.albedos import Albedos, Incidence, albedos_of
from gonio.checks.direction_search import directions, values
from gonio.checks.grid_resolution import LARGEST
from gonio.checks.hidden_lobes import Features, credible
from gonio.checks.table.albedos.on_grid import floor_of
from gonio.checks.table.pairs.nearest_readings import AnglesAndReadings, Light, lights
from gonio.checks.table.pairs.warped_pairs import warp_of
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction

INCIDENCES = np.radians(np.arange(0.0, 80.1, 10.0))
RULE = (64, 128)
"""Nodes in theta_h and phi_h; half of each is the coarser rule that the error comes from."""


def _half_vector_rule(brdf: AbstractBRDF, n_theta: int, n_phi: int) -> np.ndarray:
    # ∫ f cosθo dωo = ∫ f cosθo 4 (wi·h) dωh, theta_h = u² π/2 so that nodes crowd where lobes are narrow.
    x, w = np.polynomial.legendre.leggauss(n_theta)
    u = (x + 1) / 2
    theta_h, weight = u**2 * np.pi / 2, w / 2 * 2 * u * np.pi / 2
    phi_h = (np.arange(n_phi) + 0.5) * 2 * np.pi / n_phi
    theta_h, phi_h = (a.ravel() for a in np.meshgrid(theta_h, phi_h, indexing="ij"))
    weight = np.repeat(weight, n_phi) * 2 * np.pi / n_phi * np.sin(theta_h)
    h, albedos = directions(theta_h, phi_h), []
    for theta_i in INCIDENCES:
        wi = directions(np.array(theta_i), np.array(0.0))
        facing = wi.x * h.x + wi.y * h.y + wi.z * h.z
        x, y, z = (2 * facing * a - b for a, b in zip(h, wi, strict=True))
        up = (facing > 0) & (z > 1e-9)
        f = values(brdf, wi, Direction(np.where(up, x, 0.0), np.where(up, y, 0.0), np.where(up, z, 1.0)))
        albedos.append(np.sum(np.where(up, weight * 4 * facing * z, 0.0)[:, None] * f, axis=0))
    return np.stack(albedos)


def warped_albedos(table: Table) -> Albedos | str:
    """Albedos of a table that brings its own interpolant, integrated over half vectors at two orders.

    The bound adds to the change between the orders what the readings themselves leave open: every second stored polar
    angle of incidence, and each reading's distance from the mean of its neighbours in the format's own square.
    """
    warp, rough = warp_of(table)
    fine = _half_vector_rule(warp, *RULE)
    bound = 2 * np.abs(fine - _half_vector_rule(warp, *(n // 2 for n in RULE)))
    if hasattr(warp, "spectra"):
        bound = bound + np.abs(fine) * _error_between(np.asarray(warp.spectra, float))
    if rough is not None:
        bound = bound + np.abs(fine - _half_vector_rule(rough, *RULE)) / 3
    rows = (Incidence(t, 0.0, v, b, np.zeros_like(v)) for t, v, b in zip(INCIDENCES, fine, bound, strict=True))
    return albedos_of(rows, "Integrated over half vectors, the values read by the format's own warp.", Features(np.inf))


def _error_between(spectra: np.ndarray) -> np.ndarray:
    # A quarter of each node's distance from its neighbours' mean, in units of the mean: a linear rule's error.
    mean = np.maximum(np.abs(spectra.mean(axis=(0, 1, 2, 3))), 1e-300)
    total = 0.0
    for axis in (2, 3):
        middle = np.moveaxis(spectra, axis, 0)
        bend = middle[1:-1] - (middle[:-2] + middle[2:]) / 2
        total = total + np.abs(bend).mean(axis=(0, 1, 2, 3)) / 4
    return total / mean


def scattered_albedos(table: Table, features: Features, bend: float = 1.0) -> Albedos | str:
    """Albedos at the incidences of a scattered table whose readings cover the hemisphere, by nearest readings.

    `features` and `bend` as of `gonio.checks.table.albedo_on_grid.grid_albedos`.
    """
    light, groups = lights(table, features, bend)
    rows = [_nearest(light, readings) for readings in groups]
    how = ", taking the surface as isotropic and mirror symmetric" if light.mirrored else ""
    albedos = albedos_of(rows, f"Integrated with the value of the nearest reading in each direction{how}.", features)
    none = isinstance(albedos, str) or not albedos.value.any()
    return "at no incidence do its readings cover the hemisphere" if none else albedos


def _nearest(light: Light, readings: AnglesAndReadings) -> Incidence:
    """The albedo of one incidence, with the value of the nearest reading in each direction."""
    cells = light.cells(readings)
    if isinstance(cells, Incidence):
        return cells
    here, around = cells.f[cells.near[:, 0]], cells.f[cells.near]
    if cells.partial:  # what was read alone
        here = np.where((cells.uncovered | ~cells.surrounded())[:, None], 0.0, here)
    value = np.pi * here.mean(axis=0)
    floor = floor_of(value)
    spread = np.minimum(np.ptp(np.log(np.maximum(around, floor)), axis=1), LARGEST)
    error = np.maximum(np.abs(here), floor) * np.expm1(spread) / 2
    error = np.where(cells.uncovered[:, None], np.maximum(error, np.abs(here)), error)
    noise = np.sqrt(np.sum((cells.weight[:, None] * cells.u) ** 2, axis=0))
    bound = np.pi * error.mean(axis=0) + 2 * noise
    hidden = light.hidden(cells, credible(np.maximum(cells.f, 0.0) + 2 * cells.u, value))
    return Incidence(*cells.incidence, value, bound, noise, hidden, partial=cells.partial)

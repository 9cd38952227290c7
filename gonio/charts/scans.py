"""Measuring: schemes of scans, numbers of readings and photons; the error of the fitted model, and the hours."""

import statistics
from collections.abc import Iterator

import numpy as np

from gonio.charts.point import Axis, Chart, Point, Settings
from gonio.charts.tables import Light, light_of
from gonio.charts.timing import precision
from gonio.data import layouts
from gonio.data.interpolation.rgl_warp import RGLMaterial
from gonio.data.layouts import Layout
from gonio.data.table import Table
from gonio.fitting.fit_table import fit
from gonio.instrument.instrument import Instrument
from gonio.instrument.measurement import measure
from gonio.instrument.rgl_scan import measure_rgl
from gonio.instrument.scans import half_difference, in_plane, isotropic
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build

MODEL = "lambert + ggx"
THETA_MAX = np.radians(85.0)


def _random(count: float) -> Layout:
    # Uniform over both hemispheres, taken in the order of the light's angle.
    rng = np.random.default_rng(0)
    cosines = 1 - rng.random((2, int(count))) * (1 - np.cos(THETA_MAX))
    theta, phi = np.arccos(cosines), rng.uniform(0, 2 * np.pi, (2, int(count)))
    order = np.argsort(theta[0])
    return layouts.scattered(theta[0][order], phi[0][order], theta[1][order], phi[1][order])


def _degrees(*steps: float) -> dict[str, float]:
    return {f"{s:g}°": float(np.radians(s)) for s in steps}


SCHEMES = {
    "in the plane of incidence": (in_plane, _degrees(10, 5, 2, 1, 0.5)),
    "isotropic grid": (isotropic, _degrees(30, 15, 10, 5)),
    "half/difference grid": (half_difference, _degrees(30, 15, 10, 5)),
    "random directions": (_random, {"30": 30, "100": 100, "10³": 1000, "10⁴": 10000}),
}
RGL = {"4 × 8²": (4, 8), "8 × 16²": (8, 16), "8 × 32²": (8, 32)}
"""Incidences, and samples along a side of the warped grid."""
PHOTONS, QUICK_PHOTONS = {"10⁴": 1e4, "10⁶": 1e6}, {"10⁴": 1e4}
WIDTHS = (0.3, 0.05)
SEEDS, QUICK_SEEDS = 7, 3


def points(settings: Settings) -> Iterator[Point]:
    """One point for each width, number of photons, scheme and setting: medians over several measurements."""
    with precision("float64"):
        for alpha in WIDTHS:
            truth = build(f"lambert(rho=0.3) + 0.5 * ggx(alpha={alpha:g})")
            light = light_of(truth)
            for counted, photons in (QUICK_PHOTONS if settings.quick else PHOTONS).items():
                panel = f"α = {alpha:g}, {counted} photons"
                yield from _of_rgl(panel, truth, light, photons, settings)
                for method, (make, steps) in SCHEMES.items():
                    for name, step in list(steps.items())[: 3 if settings.quick else None]:
                        scan = make(step)
                        tables = [
                            measure(truth, Instrument(photons=photons), scan, seed=seed, log=lambda text: None)
                            for seed in range(QUICK_SEEDS if settings.quick else SEEDS)
                        ]
                        values, note = _fitted(tables, light)
                        values["hours"] = settings.pace.seconds(scan, photons) / 3600
                        values["readings"] = float(np.count_nonzero(scan.readable()))
                        yield Point(panel, method, name, values, note)


def _of_rgl(panel: str, truth: AbstractBRDF, light: Light, photons: float, settings: Settings) -> Iterator[Point]:
    """The adaptive scan: the model fitted to its readings, and its own file without a model."""
    for name, (incidences, samples) in list(RGL.items())[: 2 if settings.quick else None]:
        scans = [
            measure_rgl(truth, Instrument(photons=photons), incidences, samples, seed=seed, log=lambda text: None)
            for seed in range(QUICK_SEEDS if settings.quick else SEEDS)
        ]
        layout = scans[0].table.layout
        cost = {
            "hours": settings.pace.seconds(layout, photons) / 3600,
            "readings": float(np.count_nonzero(layout.readable())),
        }
        values, note = _fitted([scan.table for scan in scans], light)
        yield Point(panel, "RGL's adaptive scan", name, values | cost, note)
        errors = [light.misplaced(RGLMaterial(scan.fit.data)) for scan in scans]
        values = {"error": statistics.median(errors), "largest_error": max(errors)} | cost
        yield Point(panel, "RGL's adaptive scan, its file without a model", name, values)


def _fitted(tables: list[Table], light: Light) -> tuple[dict[str, float], str]:
    errors, refused = [], 0
    for table in tables:
        try:
            result = fit(table, MODEL)
        except GonioError:  # fewer usable readings than numbers
            errors.append(1.0)
            refused += 1
            continue
        errors.append(light.misplaced(result.brdf))
        refused += not result.converged
    note = f"{refused} of {len(errors)} fits refused or not converged" if refused else ""
    return {"error": statistics.median(errors), "largest_error": max(errors)}, note


CHART = Chart(
    "measuring",
    "Measuring Lambert + GGX, and fitting what was read",
    "Each scan is read with photon noise and the model is fitted to it; the error is the share of the reflected light "
    "that the fitted model misplaces, the median over several measurements. Photons: those expected of the white "
    "diffuser at normal incidence, in each reading. The model is of the material's own kind: what a scan does not look "
    "at costs nothing here, and much where the model is wrong there. Labels: step in angle, readings, or of "
    "the RGL instrument's procedure incidences × samples.",
    ((Axis("hours", "hours on the instrument"), Axis("error", "share of the reflected light misplaced")),),
    points,
)

"""Fits: samples, losses, precisions and solvers; the error of the fitted numbers and of their albedo."""

import functools
import statistics
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from gonio.charts.point import Axis, Chart, Point, Settings
from gonio.charts.timing import in_turns, precision
from gonio.data.table import Table
from gonio.fitting.fit_table import fit
from gonio.models.albedo import directional_albedo
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction
from gonio.stability.fits import readings

TRUTH = np.array([0.3, 0.5, 0.2])
SURFACE = "lambert(rho={!r}) + {!r} * ggx(alpha={!r})"
MODEL = "lambert + ggx"
NAMES = ("lambert.rho", "ggx.scale", "ggx.alpha")
THETA = np.radians([0.0, 30.0, 45.0, 60.0, 70.0, 75.0, 80.0, 85.0])
SAMPLES = {"100": 100, "10³": 10**3, "10⁴": 10**4, "10⁵": 10**5}
NOISE, QUICK_NOISE = (0.001, 0.01, 0.1), (0.01,)
LOSSES, QUICK_LOSSES = ("sigma", "cbrt", "log", "log1p", "linear"), ("sigma", "cbrt")
SEEDS, QUICK_SEEDS = 5, 3


class Solution(NamedTuple):
    """The fitted rho, scale and alpha, and whether the fit converged."""

    numbers: np.ndarray
    converged: bool


Solve = Callable[[Table], Solution]


def _gonio(loss: str, kind: str = "float64", starts: int = 8) -> Solve:
    def solve(table: Table) -> Solution:
        with precision(kind):
            result = fit(table, MODEL, loss=loss, starts=starts)
        numbers = {p.name: float(p.value) for p in result.parameters}
        return Solution(np.array([numbers[n] for n in NAMES]), result.converged)

    return solve


def _scipy(loss: str) -> Solve:
    def solve(table: Table) -> Solution:
        block = table.read()
        numbers = scipy_fit(cosines(block.wi, block.wo), block.f[:, 0], np.asarray(block.u_f)[:, 0], loss)
        return Solution(numbers, True)

    return solve


def methods(quick: bool) -> dict[str, Solve]:
    """The ways of fitting, by name."""
    losses = QUICK_LOSSES if quick else LOSSES
    solvers = {f"gonio, {loss}": _gonio(loss) for loss in losses}
    solvers["gonio, sigma, no random starts"] = _gonio("sigma", starts=0)
    solvers["gonio, sigma, float32"] = _gonio("sigma", "float32")
    return solvers | {f"SciPy, {loss}": _scipy(loss) for loss in losses if loss in COMPARED}


def _albedo(numbers: np.ndarray) -> np.ndarray:
    return directional_albedo(build(SURFACE.format(*numbers.tolist())), THETA, 0.0, 1e-6).value


def albedo_error(numbers: np.ndarray) -> float:
    """The largest relative error of the directional albedo, 0 to 85°, of (rho, scale, alpha)."""
    with precision("float64"):
        return float(np.max(np.abs(_albedo(numbers) / _albedo(TRUTH) - 1)))


def points(settings: Settings) -> Iterator[Point]:
    """One point for each noise, method and number of samples: medians over several tables of noise."""
    solvers = methods(settings.quick)
    for noise in QUICK_NOISE if settings.quick else NOISE:
        for name, count in SAMPLES.items():
            if count > 10**4 and settings.quick:
                continue
            with precision("float64"):
                seeds = range(QUICK_SEEDS if settings.quick else SEEDS)
                tables = [readings(SURFACE.format(*TRUTH.tolist()), count, noise, seed=seed) for seed in seeds]
            # Time is measured on one table, in turns; the others are for the error.
            calls = [functools.partial(solve, tables[0]) for solve in solvers.values()]
            timings = in_turns(calls, *((2, 0.2) if settings.quick else (5, 0.5)))
            for (method, solve), timing in zip(solvers.items(), timings, strict=True):
                values, note = _summary([timing.result, *(solve(table) for table in tables[1:])])
                values |= {"ms": timing.median * 1e3, "first_call_s": timing.first_call}
                yield Point(f"noise {noise * 100:g} %", method, name, values, note)


def _summary(solutions: list[Solution]) -> tuple[dict[str, float], str]:
    errors = [float(np.max(np.abs(s.numbers / TRUTH - 1))) for s in solutions]
    failed = sum(not s.converged for s in solutions)
    values = {
        "error": statistics.median(errors),
        "albedo_error": statistics.median(albedo_error(s.numbers) for s in solutions),
        "largest_error": max(errors),
    }
    return values, f"{failed} of {len(solutions)} say that they did not converge" if failed else ""


TIME = Axis("ms", "time of a fit, ms")
CHART = Chart(
    "fits",
    "Fits of Lambert + GGX to noisy readings",
    "The truth is lambert(rho=0.3) + 0.5 ggx(alpha=0.2), three free numbers; medians over draws of the noise. gonio "
    "starts from three guesses of the data and eight random places, and reports uncertainties; SciPy's bounded least "
    "squares from one place, on a NumPy model, without them. Albedo: at eight incidences to 85°. Labels: readings.",
    (
        (TIME, Axis("error", "worst relative error of the numbers")),
        (TIME, Axis("albedo_error", "worst relative error of the albedo")),
    ),
    points,
)


START, LOW, HIGH = np.array([0.5, 0.5, 0.3]), np.array([0.0, 0.0, 1e-3]), np.array([1.0, 5.0, 1.0])


class Cosines(NamedTuple):
    """Cosines of light, detector and half vector with the normal, shapes (n,)."""

    i: np.ndarray
    o: np.ndarray
    h: np.ndarray


def cosines(wi: Direction, wo: Direction) -> Cosines:
    """The cosines that the model needs, of directions with components (n,)."""
    total = [np.asarray(a) + np.asarray(b) for a, b in zip(wi, wo, strict=True)]
    return Cosines(np.asarray(wi.z), np.asarray(wo.z), total[2] / np.sqrt(sum(c * c for c in total)))


def lambert_ggx(x: np.ndarray, c: Cosines) -> np.ndarray:
    """f, 1/sr, of (rho, scale, alpha): ρ/π + s·D·G/(4 cosθi cosθo) with F = 1 [Walter 2007, Heitz 2014]."""
    rho, scale, alpha = x
    a2 = alpha * alpha
    density = a2 / (np.pi * (c.h**2 * (a2 - 1) + 1) ** 2)
    shadow = c.o * np.sqrt(a2 + (1 - a2) * c.i**2) + c.i * np.sqrt(a2 + (1 - a2) * c.o**2)
    return rho / np.pi + scale * density * 0.5 / shadow


COMPARED: dict[str, Callable[[np.ndarray, Cosines, np.ndarray], np.ndarray]] = {
    "sigma": lambda v, c, u: v / u,
    "linear": lambda v, c, u: v,
    "cbrt": lambda v, c, u: np.cbrt(v * c.i),
    "log1p": lambda v, c, u: np.sign(v) * np.log1p(np.abs(v)),
}


def scipy_fit(c: Cosines, y: np.ndarray, u: np.ndarray, loss: str) -> np.ndarray:
    """(rho, scale, alpha) from one start, with slopes by differences; readings y and their uncertainties u, (n,)."""
    from scipy.optimize import least_squares

    compared = COMPARED[loss]
    target = compared(y, c, u)
    solution = least_squares(
        lambda x: compared(lambert_ggx(x, c), c, u) - target, START, bounds=(LOW, HIGH), x_scale="jac", method="trf"
    )
    return solution.x

"""Fits: samples, losses, precisions and solvers; the error of the numbers found and of the albedo that they make."""

import functools
import statistics
from collections.abc import Callable, Iterator

import numpy as np

from gonio.charts.point import Axis, Chart, Point, Settings
from gonio.charts.scipy_fit import COMPARED, cosines, scipy_fit
from gonio.charts.timing import in_turns, precision
from gonio.data.table import Table
from gonio.fitting.fit_table import fit
from gonio.models.albedo import directional_albedo
from gonio.models.expression.builder import build
from gonio.stability.fits import readings

TRUTH = np.array([0.3, 0.5, 0.2])
SPELLED = "lambert(rho={!r}) + {!r} * ggx(alpha={!r})"
ASKED = "lambert + ggx"
NAMES = ("lambert.rho", "ggx.scale", "ggx.alpha")
THETA = np.radians([0.0, 30.0, 45.0, 60.0, 70.0, 75.0, 80.0, 85.0])
SAMPLES = {"100": 100, "10³": 10**3, "10⁴": 10**4, "10⁵": 10**5}
NOISE, QUICK_NOISE = (0.001, 0.01, 0.1), (0.01,)
LOSSES, QUICK_LOSSES = ("sigma", "cbrt", "log", "log1p", "linear"), ("sigma", "cbrt")
SEEDS, QUICK_SEEDS = 5, 3

Solve = Callable[[Table], tuple[np.ndarray, bool]]


def _ours(loss: str, kind: str = "float64", starts: int = 8) -> Solve:
    def solve(table):
        with precision(kind):
            result = fit(table, ASKED, loss=loss, starts=starts)
        found = {p.name: float(p.value) for p in result.parameters}
        return np.array([found[n] for n in NAMES]), result.converged

    return solve


def _scipys(loss: str) -> Solve:
    def solve(table):
        block = table.read()
        return scipy_fit(cosines(block.wi, block.wo), block.f[:, 0], block.u_f[:, 0], loss), True

    return solve


def methods(quick: bool) -> dict[str, Solve]:
    """The ways of fitting, by name."""
    losses = QUICK_LOSSES if quick else LOSSES
    found = {f"gonio, {loss}": _ours(loss) for loss in losses}
    found["gonio, sigma, no random starts"] = _ours("sigma", starts=0)
    found["gonio, sigma, float32"] = _ours("sigma", "float32")
    return found | {f"SciPy, {loss}": _scipys(loss) for loss in losses if loss in COMPARED}


def albedo_error(found: np.ndarray) -> float:
    """The largest relative error of the directional albedo, 0 to 85°, of (rho, scale, alpha)."""
    with precision("float64"):
        lost, true = (
            directional_albedo(build(SPELLED.format(*(float(v) for v in x))), THETA, 0.0, 1e-6).value
            for x in (found, TRUTH)
        )
    return float(np.max(np.abs(lost / true - 1)))


def points(settings: Settings) -> Iterator[Point]:
    """One point for each noise, method and number of samples: medians over several draws of noise."""
    samples = {n: c for n, c in SAMPLES.items() if c <= 10**4 or not settings.quick}
    solvers = methods(settings.quick)
    truth = SPELLED.format(*TRUTH.tolist())
    for noise in QUICK_NOISE if settings.quick else NOISE:
        for name, count in samples.items():
            with precision("float64"):
                seeds = range(QUICK_SEEDS if settings.quick else SEEDS)
                drawn = [readings(truth, count, noise, seed=seed) for seed in seeds]
            # Time is taken on one draw, in turns; the other draws are for the error.
            calls = [functools.partial(solve, drawn[0]) for solve in solvers.values()]
            timings = in_turns(calls, *((2, 0.2) if settings.quick else (5, 0.5)))
            for (method, solve), timing in zip(solvers.items(), timings, strict=True):
                ends = [timing.result, *(solve(table) for table in drawn[1:])]
                errors = [float(np.max(np.abs(x / TRUTH - 1))) for x, _ in ends]
                refused = sum(not converged for _, converged in ends)
                values = {
                    "ms": timing.median * 1e3,
                    "error": statistics.median(errors),
                    "albedo_error": statistics.median(albedo_error(x) for x, _ in ends),
                    "largest_error": max(errors),
                    "first_call_s": timing.first_call,
                }
                note = f"{refused} of {len(ends)} say that they did not converge" if refused else ""
                yield Point(f"noise {noise * 100:g} %", method, name, values, note)


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

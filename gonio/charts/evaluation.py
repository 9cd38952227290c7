"""Evaluation: models, precisions and numbers of pairs at once, their time and their error at forty digits."""

import functools
from collections.abc import Iterator

import numpy as np

from gonio.charts.point import Axis, Chart, Point, Settings
from gonio.charts.timing import in_turns, precision
from gonio.models.brdf import AbstractBRDF
from gonio.models.catalog import MODELS
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build, example
from gonio.models.geometry.directions import Direction
from gonio.stability.directions import unit_vector
from gonio.stability.precision import cast
from gonio.stability.reference import DIGITS, Reference
from gonio.stability.textbook import TEXTBOOK
from gonio.stability.textbook.frame import mp

QUICK = ("lambert", "eon", "ggx", "beckmann", "std", "hapke")
BATCHES, QUICK_BATCHES = {"1": 1, "10³": 10**3, "10⁶": 10**6}, {"1": 1, "10⁵": 10**5}
PAIRS, FEW = 40, 4
DARK = 1e-3
"""1/sr: errors of smaller f are relative to this."""

Pairs = tuple[Direction, Direction]


def pairs(count: int, seed: int = 0) -> Pairs:
    """Pairs up to 85° from the normal, one half near mirror reflection; components (count,), float64."""
    rng = np.random.default_rng(seed)
    theta, phi = rng.uniform(0, np.radians(85), (2, count)), rng.uniform(0, 2 * np.pi, (2, count))
    near = np.arange(count) % 2 == 0
    theta[1] = np.where(near, np.minimum(np.abs(theta[0] + 0.1 * rng.normal(size=count)), np.radians(85)), theta[1])
    phi[1] = np.where(near, phi[0] + np.pi + 0.1 * rng.normal(size=count), phi[1])
    return Direction(*unit_vector(theta[0], phi[0])), Direction(*unit_vector(theta[1], phi[1]))


def exact_values(expression: str) -> tuple[Pairs, np.ndarray]:
    """Some pairs, and f there by the textbook form at forty digits."""
    reference = Reference(expression, np.float64)
    wi, wo = pairs(FEW if reference.costly else PAIRS)
    with mp.workdps(DIGITS):
        columns = zip(np.transpose(wi), np.transpose(wo), strict=True)
        return (wi, wo), np.array([float(reference.value(reference.inputs(i, o))) for i, o in columns])


def points(settings: Settings) -> Iterator[Point]:
    """One point for each model with a textbook form, precision and number of pairs."""
    names = [name for name in (QUICK if settings.quick else MODELS) if name in TEXTBOOK]
    expressions = {name: example(name).strip("'") for name in names}
    batches = QUICK_BATCHES if settings.quick else BATCHES
    with precision("float64"):
        built = {name: build(expression) for name, expression in expressions.items()}
        exact = {name: exact_values(expression) for name, expression in expressions.items()}
    for kind in ("float64", "float32"):
        with precision(kind):
            models = {name: cast(brdf, kind) for name, brdf in built.items()}
            inputs = {b: [Direction(*(c.astype(kind) for c in w)) for w in pairs(n, 1)] for b, n in batches.items()}
            runs = [(name, batch) for name in names for batch in batches]
            calls = [functools.partial(evaluate, models[name], *inputs[batch]) for name, batch in runs]
            timings = in_turns(calls, 9, settings.clock()[1])
            errors = {name: _error(models[name], *exact[name]) for name in names}
        for (name, batch), timing in zip(runs, timings, strict=True):
            values = {"ns": timing.median / batches[batch] * 1e9, "error": errors[name], "known": 1e-17}
            values |= {"pairs": float(batches[batch]), "compared": float(exact[name][1].size)}
            values |= {"first_call_s": timing.first_call}
            yield Point(f"{batch} pair{'s' * (batch != '1')} a call", kind, name, values)


def _error(brdf: AbstractBRDF, directions: Pairs, exact: np.ndarray) -> float:
    f = np.asarray(evaluate(brdf, *directions), float)
    return float(np.max(np.abs(f - exact) / np.maximum(np.abs(exact), DARK)))


CHART = Chart(
    "evaluation",
    "Evaluation of models",
    "One call of gonio.models.evaluation on NumPy arrays of the precision. The largest error of f, relative to f or to "
    f"{DARK:g}/sr, at up to {PAIRS} pairs, one half near mirror reflection, against the textbook's form at forty "
    "digits; what the rounding of directions and parameters to the precision makes of it is part of it.",
    ((Axis("ns", "time of one evaluation, ns"), Axis("error", "largest relative error of f")),),
    points,
)

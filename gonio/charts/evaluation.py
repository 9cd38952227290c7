"""Evaluation: models, precisions and numbers of pairs at once, their time and their error at forty digits."""

import functools
from collections.abc import Iterator

import mpmath as mp
import numpy as np

from gonio.charts.point import Axis, Chart, Point, Settings
from gonio.charts.timing import in_turns, precision
from gonio.models.catalog import MODELS
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build, example
from gonio.models.geometry.directions import Direction
from gonio.stability.precision import cast
from gonio.stability.reference import DIGITS, Reference

QUICK = ("lambert", "eon", "ggx", "beckmann", "std", "hapke")
BATCHES, QUICK_BATCHES = {"1": 1, "10³": 10**3, "10⁶": 10**6}, {"1": 1, "10⁵": 10**5}
PAIRS, FEW = 40, 4
DARK = 1e-3
"""1/sr: errors of smaller f are held against this."""


def pairs(count: int, seed: int = 0) -> tuple[Direction, Direction]:
    """Pairs up to 85° from the normal, one half near mirror reflection; components (count,), float64."""
    rng = np.random.default_rng(seed)
    theta, phi = rng.uniform(0, np.radians(85), (2, count)), rng.uniform(0, 2 * np.pi, (2, count))
    near = np.arange(count) % 2 == 0
    theta[1] = np.where(near, np.minimum(np.abs(theta[0] + 0.1 * rng.normal(size=count)), np.radians(85)), theta[1])
    phi[1] = np.where(near, phi[0] + np.pi + 0.1 * rng.normal(size=count), phi[1])
    return tuple(
        Direction(np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)) for t, p in zip(theta, phi, strict=True)
    )


def exact(expression: str) -> tuple[tuple[Direction, Direction], np.ndarray]:
    """Some pairs, and f there by the textbook's form at forty digits."""
    reference = Reference(expression, np.float64)
    wi, wo = pairs(FEW if reference.costly else PAIRS)
    with mp.workdps(DIGITS):
        columns = zip(*(np.asarray(c).tolist() for c in (*wi, *wo)), strict=True)
        values = [float(reference.value(reference.inputs(c[:3], c[3:]))) for c in columns]
    return (wi, wo), np.array(values)


def points(settings: Settings) -> Iterator[Point]:
    """One point for each model, precision and number of pairs."""
    spelled = {name: example(name).strip("'") for name in (QUICK if settings.quick else MODELS)}
    batches = QUICK_BATCHES if settings.quick else BATCHES
    with precision("float64"):
        built = {name: build(expression) for name, expression in spelled.items()}
        truths = {name: exact(expression) for name, expression in spelled.items()}
    for kind in ("float64", "float32"):
        with precision(kind):
            mine = {name: cast(brdf, kind) for name, brdf in built.items()}
            many = {
                name: [Direction(*(c.astype(kind) for c in w)) for w in pairs(count, 1)]
                for name, count in batches.items()
            }
            asked = [(name, batch) for name in mine for batch in batches]
            calls = [functools.partial(evaluate, mine[name], *many[batch]) for name, batch in asked]
            timings = in_turns(calls, 9, 0.1 if settings.quick else 0.5)
            errors = {name: _error(mine[name], *truths[name]) for name in mine}
        for (name, batch), timing in zip(asked, timings, strict=True):
            values = {"ns": timing.median / batches[batch] * 1e9, "error": errors[name], "known": 1e-17}
            values |= {"pairs": float(batches[batch]), "compared": float(truths[name][1].size)}
            values |= {"first_call_s": timing.first_call}
            yield Point(f"{batch} pair{'s' * (batch != '1')} a call", kind, name, values)


def _error(brdf, some: tuple[Direction, Direction], truth: np.ndarray) -> float:
    found = np.asarray(evaluate(brdf, *some), float)
    return float(np.max(np.abs(found - truth) / np.maximum(np.abs(truth), DARK)))


CHART = Chart(
    "evaluation",
    "Evaluation of models",
    "One call of gonio.models.evaluation on NumPy arrays of the precision. The largest error of f, relative to f or to "
    f"{DARK:g}/sr, at up to {PAIRS} pairs, one half near mirror reflection, against the textbook's form at forty "
    "digits; what the rounding of directions and parameters to the precision makes of it is part of it.",
    ((Axis("ns", "time of one evaluation, ns"), Axis("error", "largest relative error of f")),),
    points,
)

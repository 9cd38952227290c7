"""Normal equations of fits by compiled loops beside those by XLA: every model, one and three channels, in one run.

python sums_beside_xla.py [MODEL...]     all models of the catalogue that need no base

Readings anywhere above the horizon, and behind it for the detector; free numbers inside their domains. For each: the
CPU time to compile both for the first time (nothing kept), that of one evaluation of 1,000 readings, and how far the
cost, JᵀJ, Jᵀr, the score covariance (by their Cauchy-Schwarz bounds) and f (by its largest) differ.
"""

import os
import sys
import time

os.environ |= {"JAX_ENABLE_X64": "1", "GONIO_NO_CACHE": "1"}

import numpy as np

from gonio.fitting.problem.compiled_sums import compile_sums
from gonio.fitting.problem.normal_equations import Evaluation
from gonio.fitting.problem.parameterisation import parameters
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import LOSSES, Readings
from gonio.models.catalog import MODELS
from gonio.models.errors import GonioError
from gonio.models.expression.builder import parse
from gonio.models.expression.parser import with_defaults
from gonio.models.geometry.directions import Direction

READINGS, REPEATS = 1000, 20
ROUTE = "GONIO_EVALUATE_WITH"


def main() -> None:
    print(f"{'':30}{'compile, CPU s':>18}{'evaluate, ms':>18}{'differences of':>16}")
    print(f"{'model, channels, loss':30}{'loop':>9}{'XLA':>9}{'loop':>9}{'XLA':>9}   cost    JᵀJ     Jᵀr     scores  f")
    for k, name in enumerate(sys.argv[1:] or MODELS):
        for channels in (1, 3):
            try:
                print(row(name, channels, LOSSES[(k + channels) % len(LOSSES)], k), flush=True)
            except GonioError as error:
                print(f"{name:30} {error}"[:120])
                break


def row(name: str, channels: int, loss: str, seed: int) -> str:
    s, fixed, _ = parameters(with_defaults(parse(name)), channels)
    rng, part = np.random.default_rng(seed), readings(channels, seed)
    weight = np.where(part.valid, 0.5 + rng.random(part.f.shape), 0.0)
    problem = FitProblem.create(s, fixed, loss, part, weight, 0.01)
    low = np.where(np.isfinite(s.domains.low), s.domains.low, 0.1)
    p = low + (np.minimum(s.domains.high, low + 1) - low) * rng.uniform(0.2, 0.8, s.size)
    head = f"{name}, {channels}, {loss}"
    os.environ.pop(ROUTE, None)
    start = time.process_time()
    if not compile_sums(s, loss, fixed):
        return f"{head:30} by XLA alone"
    compiled = [time.process_time() - start]
    ours, spent = problem.evaluate(p), [evaluation_ms(problem, p)]
    os.environ[ROUTE] = "xla"
    problem = problem.reweighted(weight)
    start = time.process_time()
    theirs = problem.evaluate(p)
    compiled.append(time.process_time() - start)
    spent.append(evaluation_ms(problem, p))
    times = "".join(f"{x:9.2f}" for x in (*compiled, *spent))
    return f"{head:30}{times}   " + "  ".join(f"{d:.0e}" for d in differences(ours, theirs))


def evaluation_ms(problem: FitProblem, p: np.ndarray) -> float:
    start = time.process_time()
    for _ in range(REPEATS):
        problem.normal_equations(p[None])
    return (time.process_time() - start) / REPEATS * 1e3


def differences(a: Evaluation, b: Evaluation) -> list[float]:
    assert a.scores is not None and b.scores is not None
    cost = abs(float(a.equations.cost) - float(b.equations.cost)) / float(b.equations.cost)
    lengths = []
    for e in (b.equations.matrix, b.scores):
        root = np.sqrt(np.diag(e.whole()))
        lengths.append(np.where(root > 0, root, 1.0))
    matrix, scores = (
        np.max(np.abs(x.whole() - y.whole()) / np.outer(n, n), initial=0.0)
        for x, y, n in zip((a.equations.matrix, a.scores), (b.equations.matrix, b.scores), lengths, strict=True)
    )
    size = lengths[0] * np.sqrt(2 * float(b.equations.cost))
    gradient = np.max(np.abs(a.equations.gradient - b.equations.gradient) / size, initial=0.0)
    return [cost, float(matrix), float(gradient), float(scores), float(np.max(np.abs(a.f - b.f)) / np.max(np.abs(b.f)))]


def readings(channels: int, seed: int) -> Readings:
    rng, w = np.random.default_rng(seed), []
    for behind in (False, True):
        theta, phi = rng.uniform(0, 1.5, READINGS), rng.uniform(0, 2 * np.pi, READINGS)
        z = np.cos(theta) * (np.sign(rng.uniform(-1, 1, READINGS)) if behind else 1.0)
        w.append(Direction(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), z))
    f = rng.uniform(0.01, 1, (READINGS, channels))
    return Readings(*w, f, np.full(f.shape, np.nan), rng.random(f.shape) > 0.1)


if __name__ == "__main__":
    main()

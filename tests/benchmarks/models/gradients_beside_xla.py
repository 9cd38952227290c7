"""Derivatives of f by every parameter: compiled loops beside XLA's programs, in double precision on one thread.

    python gradients_beside_xla.py [PAIRS] [MODEL...]     (20000, all)

Milliseconds of processor time of the first call, which compiles, and of later ones (median of 5); and the largest
difference, relative to the largest derivative by that parameter. Models that loops cannot take are XLA's both times.
"""

import os
import resource
import statistics
import sys
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("NPROC", "1")

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import gonio  # noqa: E402
from gonio.models.catalog import MODELS  # noqa: E402
from gonio.models.expression.builder import example  # noqa: E402

Slopes = dict[str, np.ndarray]


def processor_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def timed(function: Callable[[], Slopes]) -> tuple[float, float, Slopes]:
    """Milliseconds of the first call and of a later one, and what it gives."""
    times = []
    for _ in range(6):
        start = processor_seconds()
        slopes = function()
        times.append(1e3 * (processor_seconds() - start))
    return times[0], statistics.median(times[1:]), slopes


def main(pairs: int, names: list[str]) -> None:
    rng = np.random.default_rng(0)
    angles = [rng.uniform(0, high, pairs) for high in (1.5, 6.28, 1.5, 6.28)]
    print(f"{'model':24}{'loops first':>12}{'then':>9}{'XLA first':>12}{'then':>9}{'difference':>12}")
    for name in names:
        expression, results = example(name).strip("'"), []
        for way in ("", "xla"):
            os.environ["GONIO_EVALUATE_WITH"] = way
            material = gonio.material(expression)
            results.append(timed(lambda material=material: material.gradient(*angles)))
        (first, then, slopes), (xla_first, xla_then, expected) = results
        worst = max(
            (float(np.max(np.abs(slopes[k] - e)) / max(np.max(np.abs(e)), 1e-300)) for k, e in expected.items()),
            default=0.0,
        )
        print(f"{name:24}{first:12.0f}{then:9.2f}{xla_first:12.0f}{xla_then:9.2f}{worst:12.1e}", flush=True)


if __name__ == "__main__":
    main(int(float(sys.argv[1])) if sys.argv[1:] else 20_000, sys.argv[2:] or list(MODELS))

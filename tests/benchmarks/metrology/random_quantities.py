"""Quantities of random tables against those of the surface they are of: how many intervals miss it, and how far.

    python tests/benchmarks/metrology/random_quantities.py [TABLES] [FIRST] [shared]     (40 0)

Isotropic, brushed, ruled and retro-reflecting surfaces over a Lambertian, on uneven grids and lists of them, most lit
from one azimuth, some with 0.4 % of noise. An interval is the value ± 2u, where it is decided; `in` holds the surface's
own number, `near` misses it by less than the interval's half width, WRONG by more. A law of scatter that a surface does
not follow has other numbers over another range of offsets: it is counted apart. With `shared` all readings of a table
are off by one calibration of 1 %, which their stored uncertainties hold.
"""

import collections
import dataclasses
import sys
import warnings
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import gonio  # noqa: E402

sys.path.insert(0, str(Path(__file__).parents[1] / "checks"))
from random_surfaces import layout_of, surface, table_of  # noqa: E402

LAWS = ("ABg", "Harvey")
CALIBRATION = 0.01


def isotropic_surface(rng: np.random.Generator) -> str:
    alpha, lobe = 10 ** rng.uniform(-1.7, -0.1), rng.choice(["ggx", "beckmann"])
    rho, scale, f0 = rng.uniform(0.02, 0.5), rng.uniform(0.05, 0.9), rng.uniform(0.05, 1)
    return f"lambert(rho={rho:.3f}) + {scale:.2f} * {lobe}(alpha={alpha:.4f}, f0={f0:.2f})"


def calibrated(table: gonio.Table, rng: np.random.Generator) -> gonio.Table:
    f, u = np.asarray(table.f), 0.0 if table.u_f is None else np.asarray(table.u_f)
    return dataclasses.replace(table, f=f * (1 + CALIBRATION * rng.standard_normal()), u_f=np.hypot(u, CALIBRATION * f))


def main(tables: int = 40, first: int = 0, shared: bool = False) -> None:
    counts: collections.Counter[tuple[str, str]] = collections.Counter()
    for seed in range(first, first + tables):
        rng = np.random.default_rng([211, seed])
        expression = isotropic_surface(rng) if rng.random() < 0.6 else surface(rng)
        layout, material = layout_of(rng), gonio.material(expression)
        table = table_of(layout, material.f(*layout.angles())[..., 0], rng, listed=rng.random() < 0.4)
        table = calibrated(table, rng) if shared else table
        truth = {(q.name, q.place): q for q in gonio.quantities(material).quantities}
        for q in gonio.quantities(table).quantities:
            true = truth.get((q.name, q.place))
            if true is None or not q.uncertainty > 0 or not (q.decided and np.isfinite(true.value)):
                continue
            off = abs(q.value - true.value) / (2 * (q.uncertainty + true.uncertainty))
            word = "in" if off <= 1 else "near" if off <= 2 else "WRONG"
            counts["law of scatter" if q.name.startswith(LAWS) else "quantity", word] += 1
            if word == "WRONG":
                print(f"{seed} {q.name} {q.place}: {q.value:.5g} ± {2 * q.uncertainty:.2g} for {true.value:.5g}")
                print(f"    {expression}, {table.layout.name} {layout.shape}", flush=True)
    for (kind, word), number in sorted(counts.items()):
        print(f"{kind}, {word}: {number}")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main(*map(int, sys.argv[1:3]), shared="shared" in sys.argv[3:])

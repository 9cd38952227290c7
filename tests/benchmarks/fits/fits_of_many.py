"""A batch of synthetic materials: fits a second, and how often a fit ends at the best cost that 200 starts find.

python fits_of_many.py [MATERIALS] [STARTS] [NODES]     (100, 200 and 19, unless given)

STARTS 0 measures the time alone; NODES is the number of polar angles, with twice as many azimuths: 10 are 2,000 cells.
Materials are drawn from the ranges of the published fits (Ngan 2005: albedos, scales, widths and F₀ of 100 materials),
RGB, with one or two lobes, on an isotropic grid up to 85°, with 0.3, 3 and 10 % of relative noise in turn.
"""

import sys
import time

import jax
import numpy as np

import gonio
from gonio.data import layouts
from gonio.data.table import whole_table_of_values
from gonio.fitting.batch import fit_many
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

NOISE = (0.003, 0.03, 0.1)
MODELS = {"one lobe": "lambert + ggx(f0=?)", "two lobes": "lambert + ggx(f0=0.04) + ggx(f0=0.04)"}


def material(rng: np.random.Generator, lobes: int) -> str:
    def listed(values) -> str:
        return "[" + ", ".join(f"{v:.6f}" for v in values) + "]"

    said = [f"lambert(rho={listed(rng.uniform(0.01, 0.6, 3))})"]
    widths = np.exp(np.sort(rng.uniform(np.log(0.02), np.log(0.5), lobes)))
    for alpha in widths:
        f0 = f"{rng.uniform(0.02, 0.9):.4f}" if lobes == 1 else "0.04"
        said.append(f"{listed(10 ** rng.uniform(-1, 0.3, 3))} * ggx(alpha={alpha:.6f}, f0={f0})")
    return " + ".join(said)


def table_of(expression: str, noise: float, seed: int, nodes: int):
    polar = np.radians(np.linspace(0, 85, nodes))
    layout = layouts.isotropic(polar, polar, np.linspace(0, 2 * np.pi, 2 * nodes, endpoint=False))
    f = np.asarray(evaluate(build(expression), *layout.directions()))
    f = f * (1 + noise * np.random.default_rng(seed).standard_normal(f.shape))
    return whole_table_of_values(layout, f.reshape(*layout.shape, -1), name=expression)


def main(materials: int = 100, starts: int = 200, nodes: int = 19) -> None:
    jax.config.update("jax_enable_x64", True)
    for what, model in MODELS.items():
        rng = np.random.default_rng(7)
        lobes = 1 + (what == "two lobes")
        tables = [table_of(material(rng, lobes), NOISE[k % 3], k, nodes) for k in range(materials)]
        gonio.fit(tables[0], model)
        wall, cpu = time.perf_counter(), time.process_time()
        found = fit_many(tables, model)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        print(
            f"{what}: {materials} materials × {tables[0].layout.size} cells × 3, {model}: {wall:.2f} s, "
            f"{materials / wall:.1f} fits/s, {1e3 * cpu / materials:.0f} CPU ms each, "
            f"{sum(r.converged for r in found)} converged"
        )
        if not starts:
            continue
        best = fit_many(tables, model, starts=starts, seed=1)
        missed = [
            (k, r.cost / b.cost - 1) for k, (r, b) in enumerate(zip(found, best, strict=True))
            if r.cost > b.cost * (1 + 1e-6)
        ]  # fmt: skip
        better = sum(b.cost > r.cost * (1 + 1e-6) for r, b in zip(found, best, strict=True))
        print(
            f"  at the best cost of {starts} starts (to 1e-6): {materials - len(missed)} of {materials}; "
            f"lower than it: {better}"
        )
        for k, above in missed:
            print(f"  missed by {above:.1e}: noise {NOISE[k % 3]}, {tables[k].name}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

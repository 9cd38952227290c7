"""Energy verdicts of random tables on grids, alone and with the help of a model that `gonio.check` selects.

python assisted_energy.py [NUMBER] [SEED]      (24 0)

Truths are mixtures of two or three terms, grey, at steps of 5° or 10°, exact or with 2 % of stored noise, multiplied so
that the largest albedo at the table's incidences is 0.9, 1.005, 1.02 or 1.1. Wrong: a pass where it is above 1.01, or a
fail where it is not. `held`: incidences whose true albedo lies within the stated bound.
"""

import collections
import pathlib
import sys
import time

import jax
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "fits"))

from automatic import INSIDE, OUTSIDE

import gonio
from gonio.checks.hidden_lobes import Features
from gonio.checks.table.albedos.model_assisted import assisted_albedos
from gonio.checks.table.albedos.two_sided import Part
from gonio.checks.table.energy import table_energy
from gonio.checks.table.evidence import TableEvidence
from gonio.data import layouts
from gonio.data.table import Channels, Table, whole_table_of_values
from gonio.models.albedo import directional_albedo
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

LARGEST = (0.9, 1.005, 1.02, 1.1)
DIFFUSE = ("lambert(rho={c:.3f})", "eon(rho={c:.3f}, r={u:.2f})", "oren_nayar(rho={c:.3f}, sigma={u:.2f})")


def drawn(rng: np.random.Generator) -> str:
    """A mixture with random numbers."""
    forms = [DIFFUSE[rng.integers(3)]]
    forms += [(*INSIDE, *OUTSIDE[:6])[rng.integers(len(INSIDE) + 6)] for _ in range(rng.integers(1, 3))]
    log = lambda low, high: float(np.exp(rng.uniform(np.log(low), np.log(high))))  # noqa: E731
    numbers = [
        {
            "c": rng.uniform(0.05, 0.6), "u": rng.uniform(0.2, 0.9), "f": rng.uniform(0.1, 0.5), "a": log(0.04, 0.5),
            "n": log(8, 400), "m": log(4, 80), "q": rng.uniform(0.5, 0.7), "p": rng.uniform(0.4, 0.6),
            "g": rng.uniform(1.7, 5),
        }
        for _ in forms
    ]  # fmt: skip
    return " + ".join(form.format(**values) for form, values in zip(forms, numbers, strict=True))


def table_of(truth: str, step: float, noise: float, largest: float, seed: int) -> tuple[Table, np.ndarray]:
    """The table, and its true albedos at its incidences."""
    polar, azimuth = np.radians(np.arange(0, 86, step)), np.radians(np.arange(0, 360, 15.0))
    layout = layouts.isotropic(polar, polar, azimuth)
    f = np.asarray(evaluate(build(truth), *layout.directions())).reshape(*layout.shape, 1)
    albedo = directional_albedo(build(truth), polar, 0.0, 1e-6).value.reshape(polar.size, -1)
    f, albedo = f * largest / albedo.max(), albedo * largest / albedo.max()
    noisy = f * (1 + noise * np.random.default_rng(seed).standard_normal(f.shape))
    more = {"u_f": noise * f} if noise else {}
    return whole_table_of_values(layout, noisy, channels=Channels.grey(), **more), albedo


def main(number: int, seed: int) -> None:
    jax.config.update("jax_enable_x64", True)
    rng, counts = np.random.default_rng(seed), collections.Counter()
    for k in range(number):
        truth, step, noise, largest = drawn(rng), (5.0, 10.0)[k % 2], (0.0, 0.02)[k // 2 % 2], LARGEST[k // 4 % 4]
        table, albedo = table_of(truth, step, noise, largest, seed + k)
        plain = next(p for p in gonio.check(table).properties if p.name == "energy")
        began, said, held, line = time.perf_counter(), plain.verdict, "", ""
        if plain.verdict == "undecided":
            evidence = TableEvidence(table, model="auto")
            helped, fitted = table_energy(evidence, 0.01), evidence.fitted
            assisted = assisted_albedos(Part(table), fitted, Features(1e-3))
            if not isinstance(assisted, str):
                within = np.abs(assisted.value - albedo) <= np.minimum(assisted.above, assisted.below)
                counts["incidences held"] += int(within.sum())
                counts["incidences not held"] += int((~within).sum())
                held = "" if within.all() else f"NOT HELD at {int((~within).sum())} incidences"
            said, line = helped.verdict, f"± {helped.bound:.2g}: {fitted.expression[:120]}"
        wrong = (said == "pass" and largest > 1.01) or (said == "fail" and largest <= 1.01)
        counts[step, plain.verdict, said, "WRONG" if wrong else "right"] += 1
        print(
            f"{step:3.0f}° noise {noise:.2f} largest {largest:.3f}: {plain.verdict} ± {plain.bound:.2g}, with a model "
            f"{said}{' WRONG' * wrong} {held} {time.perf_counter() - began:.0f} s  {truth}\n     {line}",
            flush=True,
        )
    for key, count in sorted(counts.items(), key=str):
        print(count, key)


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:])) if len(sys.argv) > 2 else main(int(sys.argv[1]) if sys.argv[1:] else 24, 0)

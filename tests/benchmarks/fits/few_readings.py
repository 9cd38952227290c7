"""How often 95 % intervals hold the truth where readings are few: a paint at random pairs, half near the mirror.

python few_readings.py [DRAWS] [SEED]      (60 0)

Noise of 2 %, not stored. `plain`: what the fit would say without leaving each pair of directions out in turn.
"""

import sys

import jax
import numpy as np

import gonio
from gonio.data import layouts
from gonio.data.table import Channels, Table, whole_table_of_values
from gonio.fitting import assembly
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

TRUTH = {"lambert.rho": 0.3, "ggx.scale": 0.4, "ggx.alpha": 0.25}
PAINT, NOISE = "lambert(rho=0.3) + 0.4 * ggx(alpha=0.25)", 0.02


def table_of(number: int, rng: np.random.Generator) -> Table:
    """Readings at random pairs of directions."""
    theta_i, theta_o = np.arccos(np.sqrt(rng.uniform(0.05, 1, (2, number))))
    phi, near = rng.uniform(0, 2 * np.pi, number), np.arange(number) < number // 2
    theta_o = np.where(near, np.clip(np.abs(theta_i + rng.normal(0, 0.2, number)), 0, 1.4), theta_o)
    phi = np.where(near, np.pi + rng.normal(0, 0.2, number), phi) % (2 * np.pi)
    layout = layouts.scattered(theta_i, np.zeros(number), theta_o, phi)
    f = np.asarray(evaluate(build(PAINT), *layout.directions())).reshape(number, 1)
    return whole_table_of_values(layout, f * (1 + NOISE * rng.standard_normal(f.shape)), channels=Channels.grey())


def held(table: Table) -> list[bool]:
    """Whether the interval of each number holds the truth."""
    numbers = {p.name: p for p in gonio.fit(table, "lambert + ggx", loss="cbrt").parameters}
    return [numbers[name].interval95[0] <= value <= numbers[name].interval95[1] for name, value in TRUTH.items()]


def main(draws: int = 60, seed: int = 0) -> None:
    jax.config.update("jax_enable_x64", True)
    rng, leaving_out = np.random.default_rng(seed), assembly.with_clusters
    print(f"readings   {'  '.join(TRUTH)}   plain: {'  '.join(TRUTH)}")
    for number in (6, 8, 12, 20, 40, 80):
        tables = [table_of(number, rng) for _ in range(draws)]
        shares = []
        for function in (leaving_out, lambda e, *_: (e, None)):
            assembly.with_clusters = function
            shares.append(100 * np.mean([held(table) for table in tables], axis=0))
        assembly.with_clusters = leaving_out
        print(f"{number:8d}   {'  '.join(f'{s:9.0f} %' for s in np.concatenate(shares))}", flush=True)


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:]))

"""Quantities of tables of random surfaces on random grids: does what is called known hold the truth?

    python tests/benchmarks/metrology/known_quantities.py [TABLES [FIRST [KIND,...]]]

Table k is made from the seed k and the kinds of `checks/random_tables.py` (isotropic, coarse_light and coarse_azimuths
by default) alone, without noise. The truth is what the surface itself gives. `beyond`: known values that differ from it
by more than the expanded uncertainties (k = 2) and bounds of both; each is printed with how many times that is.
"""

import collections
import pathlib
import sys

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "checks"))

from random_tables import grid, surface  # noqa: E402

import gonio  # noqa: E402
from gonio.data.table import whole_table_of_values  # noqa: E402


def main(tables: int, first: int, kinds: list[str]) -> None:
    known, beyond = collections.Counter(), collections.Counter()
    for seed in range(first, first + tables):
        rng = np.random.default_rng(seed)
        kind = str(rng.choice(kinds))
        expression, _ = surface(rng, rng.uniform(0.2, 0.999))
        layout, material = grid(kind, rng), gonio.material(expression)
        f = np.nan_to_num(material.f(*np.nan_to_num(np.stack(layout.angles())))[..., 0])
        truth = {(q.name, q.place): q for q in gonio.quantities(material).quantities}
        for q in gonio.quantities(whole_table_of_values(layout, f.reshape(layout.shape))).quantities:
            true = truth.get((q.name, q.place))
            if true is None or not q.decided or q.group == "scatter law":  # a law is one of the readings that there are
                continue
            known[q.group] += 1
            allowed = max(2 * (q.uncertainty + true.uncertainty), q.bound + true.bound, 1e-12)
            if abs(q.value - true.value) > allowed:
                beyond[q.group] += 1
                times = abs(q.value - true.value) / allowed
                print(f"{seed} {kind}: {q.name} {q.place} {q.value:.5g}, true {true.value:.5g}, {times:.2f} times: "
                      f"{expression}", flush=True)  # fmt: skip
    for group in known:
        print(f"{group:<16}{known[group]:6} known{beyond[group]:6} beyond")


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:3]]
    named = sys.argv[3] if len(sys.argv) > 3 else "isotropic,coarse_light,coarse_azimuths"
    main(*(numbers + [100, 0][len(numbers) :]), named.replace("_", " ").split(","))

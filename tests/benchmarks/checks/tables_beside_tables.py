"""Agreement of tables with other tables of the same surface, or of another one, on grids and lists that differ.

    python tables_beside_tables.py [PAIRS [FIRST]]

Pair k is made from the seed k alone: a surface, tabulated twice on layouts of different kinds and steps. In a third of
the pairs the second table is of f 1.2 times as large, in a third of a lobe 1.5 times as wide (which may differ little
anywhere). A verdict is WRONG where two tables of one surface fail, or two of f and 1.2 f pass.
"""

import collections
import re
import sys

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402
from random_tables import angles_of_list, grid, surface  # noqa: E402

import gonio  # noqa: E402
from gonio.data.table import whole_table_of_values  # noqa: E402

KINDS = ("isotropic", "coarse light", "half-difference", "in-plane", "random", "holes", "few incidences")
NOISE = 0.01


def tabulated(expression: str, kind: str, noise: float, rng: np.random.Generator) -> gonio.Table:
    lists = kind in ("random", "holes", "few incidences")
    layout = None if lists else grid(kind, rng)
    angles = angles_of_list(kind, rng)[:, :3000] if layout is None else np.stack(layout.angles())
    above = np.isfinite(angles).all(axis=0) & (angles[[0, 2]] <= np.pi / 2).all(axis=0)
    f = gonio.material(expression).f(*np.where(above, angles, 0.0))[..., 0]
    f = f * (1 + noise * rng.normal(size=f.shape))
    u = noise * np.abs(f) if noise else None
    if layout is None:
        return gonio.Table.from_arrays(*angles, f, u_f=u)
    more = {} if u is None else {"u_f": u.reshape(*layout.shape, 1)}
    return whole_table_of_values(layout, f.reshape(layout.shape), **more)


def widened(expression: str) -> str:
    """The surface with wider lobes."""
    wider = re.sub(r"alpha=([\d.]+)", lambda m: f"alpha={min(1.5 * float(m[1]), 1):.4f}", expression)
    return re.sub(r"\bn=([\d.]+)", lambda m: f"n={float(m[1]) / 2.25:.1f}", wider)


def main(pairs: int, first: int) -> None:
    counts = collections.defaultdict(collections.Counter)
    for seed in range(first, first + pairs):
        rng = np.random.default_rng(seed)
        expression, _ = surface(rng, rng.uniform(0.2, 0.8))
        change, noise = str(rng.choice(["same", "1.2 f", "wider"])), float(rng.choice([0, NOISE]))
        other = {"same": expression, "1.2 f": f"1.2 * ({expression})", "wider": widened(expression)}[change]
        kinds = [str(k) for k in rng.choice(KINDS, 2)]
        tables = [tabulated(e, k, noise, rng) for e, k in zip((expression, other), kinds, strict=True)]
        agreement = gonio.check(tables[0], against=tables[1])["agreement"]
        counts[change][agreement.verdict] += 1
        if (change, agreement.verdict) in (("same", "fail"), ("1.2 f", "pass")):
            print(f"WRONG {seed} {change} {kinds} noise {noise:g} {expression}: {agreement.detail}", flush=True)
    for change, of in counts.items():
        print(f"{change:<8}" + ", ".join(f"{verdict} {n}" for verdict, n in of.most_common()))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100, int(sys.argv[2]) if len(sys.argv) > 2 else 0)

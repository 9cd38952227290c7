"""Values of f between the readings of random tables against the surface's own: how many intervals miss it, how far.

    python tests/benchmarks/metrology/random_values.py [TABLES] [FIRST]     (40 0)

The tables of `random_quantities.py`, and half/difference grids, at 600 directions each, half of them about the mirror
direction. An interval is the value ± 2u of `standard_uncertainty`, where it is known; `in` is the share of these that
hold the surface's own value, `worst` how many u the farthest is off, u and error their medians over f.
"""

import sys
import warnings
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import gonio  # noqa: E402
from gonio.data import layouts  # noqa: E402
from gonio.metrology.values.standard_uncertainty import standard_uncertainty  # noqa: E402

sys.path.insert(0, str(Path(__file__).parents[1] / "checks"))
from random_quantities import isotropic_surface  # noqa: E402
from random_surfaces import layout_of, surface, table_of  # noqa: E402

DIRECTIONS, MIRRORED = 600, 300
LEAST = 1e-9
"""Relative error that is none."""


def random_table(rng: np.random.Generator) -> tuple[str, gonio.Table]:
    isotropic = rng.random() < 0.6
    expression = isotropic_surface(rng) if isotropic else surface(rng)
    layout = layouts.merl(counts=(18, 12, 24)) if isotropic and rng.random() < 0.15 else layout_of(rng)
    theta_i, phi_i, theta_o, phi_o = layout.angles()
    above = np.isfinite(theta_i + theta_o) & (np.maximum(theta_i, theta_o) < np.pi / 2)
    f = gonio.material(expression).f(*(np.where(above, a, 0.0) for a in (theta_i, phi_i, theta_o, phi_o)))[..., 0]
    return expression, table_of(layout, f, rng, listed=layout.name != "half_difference" and rng.random() < 0.4)


def directions(rng: np.random.Generator, table: gonio.Table) -> list[np.ndarray]:
    """theta_i, phi_i, theta_o, phi_o within what was read, the light at azimuths that were."""
    read = table.layout.angles()
    theta_i, theta_o = (np.arcsin(np.sqrt(rng.random(DIRECTIONS)) * np.sin(np.nanmax(read[k]))) for k in (0, 2))
    phi_i = rng.choice(np.unique(read[1][np.isfinite(read[1])]), DIRECTIONS)
    phi_o = rng.uniform(0, 2 * np.pi, DIRECTIONS)
    near = slice(0, MIRRORED)
    theta_o[near] = np.abs(theta_i[near] + rng.normal(0, 0.1, MIRRORED)) % (np.pi / 2)
    phi_o[near] = phi_i[near] + np.pi + rng.normal(0, 0.15, MIRRORED)
    return [theta_i, phi_i, theta_o, phi_o]


def main(tables: int = 40, first: int = 0) -> None:
    total = held = 0
    for seed in range(first, first + tables):
        rng = np.random.default_rng([307, seed])
        expression, table = random_table(rng)
        angles = directions(rng, table)
        u = standard_uncertainty(table, *angles)[:, 0]
        known = np.isfinite(u)
        value, true = (gonio.material(subject).f(*angles)[known, 0] for subject in (table, expression))
        off = np.abs(value - true) / np.maximum(u[known], LEAST * np.abs(true))
        medians = [float(np.median(a / np.maximum(true, 1e-12))) for a in (u[known], np.abs(value - true))]
        total, held = total + off.size, held + int(np.sum(off <= 2))
        line = f"known {known.mean():.2f}  in {np.mean(off <= 2):.3f}  worst {np.max(off, initial=0):.1f} u"
        print(f"{seed}: {line}  u {medians[0]:.4f}  error {medians[1]:.4f}", end="  ")
        print(f"{'noise' if table.u_f is not None else ''} {table.layout.name} {table.layout.shape} {expression}")
    print(f"{held} of {total} intervals hold the surface's value: {held / max(total, 1):.4f}")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main(*map(int, sys.argv[1:3]))

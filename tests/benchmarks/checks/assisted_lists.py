"""Model-assisted albedos of random lists of readings, with models right and wrong, against the exact ones.

    python tests/benchmarks/checks/assisted_lists.py [LISTS [SEED]]

Two-lobe paints at random; half of the readings anywhere, half about the mirror direction. A fit counts as missed if the
true albedo of any incidence is beyond the stated bound, whose noise term is k = 2.
"""

import sys

import jax
import numpy as np

import gonio
from gonio.checks.hidden_lobes import Features
from gonio.checks.table.albedos.assisted_scattered import assisted_by_nearest
from gonio.checks.table.albedos.two_sided import Part
from gonio.models.albedo import directional_albedo

MODELS = ("lambert + ggx + ggx", "lambert + ggx", "lambert + phong", "ggx")
FEATURES = Features(1e-3, np.radians(8.0))


def paint(rng: np.random.Generator) -> str:
    alpha, scale = np.exp(rng.uniform(np.log(0.05), np.log(0.5), 2)), rng.uniform(0.05, 0.4, 2)
    lobes = (f"{s:.3f} * ggx(alpha={a:.3f})" for a, s in zip(alpha, scale, strict=True))
    return f"lambert(rho={rng.uniform(0.05, 0.5):.3f}) + {' + '.join(lobes)}"


def readings(material: gonio.Material, rng: np.random.Generator) -> gonio.Table:
    n, noise = int(rng.choice([200, 500, 1000])), float(rng.choice([1e-3, 0.02, 0.05]))
    theta, phi_o = np.radians(rng.uniform(0, 85, (2, n))), rng.uniform(0, 2 * np.pi, n)
    near = np.arange(n) % 2 == 0
    theta[1, near] = np.clip(theta[0] + rng.normal(0, 0.1, n), 0, 1.48)[near]
    phi_o[near] = np.pi + rng.normal(0, 0.1, near.sum())
    f = material.f(theta[0], 0 * phi_o, theta[1], phi_o)[..., 0]
    read = f * (1 + noise * rng.standard_normal(n))
    return gonio.Table.from_arrays(theta[0], 0.0, theta[1], phi_o, read, u_f=noise * f)


def main(lists: int = 60, seed: int = 0) -> None:
    fits = missed = 0
    worst = 0.0
    for k in range(lists):
        rng = np.random.default_rng([seed, k])
        material = gonio.material(paint(rng))
        table = readings(material, rng)
        for model in MODELS:
            albedos = assisted_by_nearest(Part(table), gonio.fit(table, model), FEATURES)
            if isinstance(albedos, str):
                continue
            exact = directional_albedo(material.brdf, albedos.theta_i, albedos.phi_i, tolerance=1e-5).value
            error = np.ravel(exact) - np.ravel(albedos.value)
            bound = np.where(error > 0, np.ravel(albedos.above), np.ravel(albedos.below))
            share = float(np.max(np.abs(error) / bound))
            fits, missed, worst = fits + 1, missed + (share > 1), max(worst, share)
            if share > 1:
                print(f"{share:.2f} times the bound: {model} fitted to {len(table.f)} readings of {material.name}")
    print(f"{fits} fits of {lists} lists: {missed} missed, at most {worst:.2f} times the bound")


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main(*map(int, sys.argv[1:]))

"""Model-assisted albedos of random lists of readings, with models right and wrong, against the exact ones.

    python tests/benchmarks/checks/assisted_lists.py [LISTS [SEED [narrow]]]

Two-lobe paints at random; half of the readings anywhere, half about the mirror direction. `narrow`: a diffuser and one
lobe of α .003 to .05 and of random family, fitted with other families, of which the list holds the mirror direction and
what is 3 to 30° beside it, so that no or few readings test its shape. A fit counts as missed if the true albedo of any
incidence is beyond the stated bound, whose noise term is k = 2; `decided`: no bound of it is above 1 %.
"""

import sys

import jax
import numpy as np

import gonio
from gonio.checks.hidden_lobes import Features, width_of
from gonio.checks.table.albedos.assisted_scattered import assisted_by_nearest
from gonio.checks.table.albedos.two_sided import Part
from gonio.models.albedo import directional_albedo

MODELS = ("lambert + ggx + ggx", "lambert + ggx", "lambert + phong", "ggx")
FEATURES = Features(1e-3, np.radians(8.0))
NARROW = (
    "ggx(alpha={a:.4f})", "beckmann(alpha={a:.4f})", "phong(n={n:.1f})", "gtr(alpha={a:.4f}, gamma=1.4)",
    "ward(alpha={a:.4f})",
)  # fmt: skip
OF_NARROW = ("lambert + ggx", "lambert + beckmann", "lambert + phong", "lambert + ward")


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


def narrow(rng: np.random.Generator) -> tuple[str, Features]:
    """A diffuser and a narrow lobe, and what it is safe to say of its width."""
    alpha = 10 ** rng.uniform(-2.5, -1.3)
    lobe = str(rng.choice(NARROW)).format(a=alpha, n=2 / alpha**2)
    diffuser = f"lambert(rho={rng.uniform(0.05, 0.7):.3f})"
    return f"{diffuser} + {rng.uniform(0.05, 0.6):.3f} * {lobe}", Features(1e-3, width_of(alpha) / 2)


def few_on_the_lobe(material: gonio.Material, rng: np.random.Generator) -> gonio.Table:
    """Five incidences, the mirror direction of each, and readings at random tilts from it and anywhere."""
    light = np.repeat(np.radians([0, 20, 40, 60, 75.0]), 120)
    tilt = np.radians(10 ** rng.uniform(np.log10(3), 1.5, light.size))
    tilt[::120], turn = 0.0, rng.uniform(0, 2 * np.pi, light.size)
    theta, phi = np.abs(light + tilt * np.cos(turn)), np.pi + tilt * np.sin(turn) / np.maximum(np.sin(light), 0.1)
    anywhere = np.arange(light.size) % 2 == 1
    theta[anywhere] = np.arcsin(np.sqrt(rng.uniform(0, 0.99, anywhere.sum())))
    phi[anywhere] = rng.uniform(0, 2 * np.pi, anywhere.sum())
    theta = np.minimum(theta, np.radians(85))
    f, noise = material.f(light, 0 * light, theta, phi)[..., 0], float(rng.choice([1e-3, 0.02]))
    read = f * (1 + noise * rng.standard_normal(f.size))
    return gonio.Table.from_arrays(light, 0.0, theta, np.mod(phi, 2 * np.pi), read, u_f=noise * f)


def main(lists: int = 60, seed: int = 0, kind: str = "") -> None:
    fits = missed = decided = 0
    worst = 0.0
    for k in range(lists):
        rng = np.random.default_rng([seed, k])
        expression, features = narrow(rng) if kind else (paint(rng), FEATURES)
        material = gonio.material(expression)
        table = few_on_the_lobe(material, rng) if kind else readings(material, rng)
        for model in OF_NARROW if kind else MODELS:
            albedos = assisted_by_nearest(Part(table), gonio.fit(table, model), features)
            if isinstance(albedos, str):
                continue
            exact = directional_albedo(material.brdf, albedos.theta_i, albedos.phi_i, tolerance=1e-5).value
            error = np.ravel(exact) - np.ravel(albedos.value)
            bound = np.where(error > 0, np.ravel(albedos.above), np.ravel(albedos.below))
            share = float(np.max(np.abs(error) / bound))
            decided += bool(np.max(albedos.above) < 0.01)
            fits, missed, worst = fits + 1, missed + (share > 1), max(worst, share)
            if share > 1:
                print(f"{share:.2f} times the bound: {model} fitted to {len(table.f)} readings of {material.name}")
    print(f"{fits} fits of {lists} lists: {missed} missed, at most {worst:.2f} times the bound; {decided} decided")


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main(*map(int, sys.argv[1:3]), *sys.argv[3:4])

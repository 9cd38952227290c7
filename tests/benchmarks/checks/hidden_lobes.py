"""Lobes of random width that random grids leave out: is energy ever passed where the surface sends back too much?

    python hidden_lobes.py [TABLES] [SEED]     (400 0)

A diffuser and a lobe (Beckmann, GGX, Phong; on spherical grids Beckmann of two widths) that send back up to 2.6 times
the light, on isotropic and spherical grids of 3° to 10°, with nodes off the mirror direction along either angle or
both, and with 2 % of noise in every other table. Each table is judged without a width, where a pass is WRONG if the
surface gains more than 1 %, and with a stated width of 0.3 to 1 times the lobe's own. `decided`: by a pass or fail that
is right.
"""

import collections
import sys

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

from gonio.checks.hidden_lobes import width_of  # noqa: E402
from gonio.checks.table.energy import table_energy  # noqa: E402
from gonio.checks.table.evidence import TableEvidence  # noqa: E402
from gonio.data import layouts  # noqa: E402
from gonio.data.table import whole_table_of_values  # noqa: E402
from gonio.models.albedo import directional_albedo  # noqa: E402
from gonio.models.evaluation import evaluate  # noqa: E402
from gonio.models.expression.builder import build  # noqa: E402

TOLERANCE = 0.01
GGX_WIDTH = np.sqrt(np.sqrt(2) - 1) / np.sqrt(np.log(2))  # of a GGX lobe's width in that of a Beckmann lobe


def surface(rng: np.random.Generator, isotropic: bool) -> tuple[str, float]:
    """A diffuser and a lobe, and the lobe's full width at half maximum at normal incidence, radians."""
    alpha, diffuse, scale = 10 ** rng.uniform(-2.8, -0.7), rng.uniform(0, 0.6), 10 ** rng.uniform(-1, 0.3)
    kind = rng.choice(["beckmann", "ggx", "phong"] if isotropic else ["beckmann", "anisotropic"])
    lobe, width = {
        "beckmann": (f"beckmann(alpha={alpha:.5f})", width_of(alpha)),
        "ggx": (f"ggx(alpha={alpha:.5f})", width_of(GGX_WIDTH * alpha)),
        "phong": (f"phong(n={1.9 / alpha**2:.1f})", 2 * np.arccos(0.5 ** (alpha**2 / 1.9))),
        "anisotropic": (
            f"beckmann(alpha_x={alpha:.5f}, alpha_y={min(alpha * rng.uniform(1, 6), 1):.5f})",
            width_of(alpha),
        ),
    }[str(kind)]
    return f"lambert(rho={diffuse:.3f}) + {scale:.4f} * {lobe}", float(width)


def grid(rng: np.random.Generator, isotropic: bool) -> layouts.Layout:
    """A grid whose nodes miss the mirror direction by polar angle, by azimuth, or by both."""
    step, by = float(rng.choice([3.0, 5.0, 7.5, 10.0])) if isotropic else 10.0, int(rng.integers(3))
    polar = np.radians(np.arange(rng.uniform(0.1, 0.9) * step if by != 1 else 0.0, 89.9, step))
    around = np.radians(np.arange(0, 360, step) + (rng.uniform(0.1, 0.9) * step if by else 0.0))
    incident = np.radians(np.arange(0, 81, 20.0))
    if isotropic:
        return layouts.isotropic(incident, polar, around)
    return layouts.spherical(incident[1:4], np.radians([0.0, 50.0]), polar, around)


def main(tables: int, seed: int) -> None:
    counts: collections.Counter[tuple[str, str]] = collections.Counter()
    for k in range(tables):
        rng = np.random.default_rng([seed, k])
        isotropic, noise = bool(rng.integers(4)), (0.0, 0.02)[k % 2]
        expression, width = surface(rng, isotropic)
        layout, brdf = grid(rng, isotropic), build(expression)
        f = np.asarray(evaluate(brdf, *layout.directions())).reshape(*layout.shape)
        light = [layout.axes["theta_i"], layout.axes.get("phi_i", np.zeros(1))]
        lawful = max(np.max(directional_albedo(brdf, light[0], p, 1e-6).value) for p in light[1]) <= 1 + TOLERANCE
        more = {"u_f": noise * f[..., None]} if noise else {}
        table = whole_table_of_values(layout, f * (1 + noise * rng.standard_normal(f.shape)), **more)
        stated = rng.uniform(0.3, 1) * width
        for name, w in (("no width", 0.0), ("width stated", stated)):
            energy = table_energy(TableEvidence(table, feature_width=w), TOLERANCE)
            right = energy.verdict == ("pass" if lawful else "fail")
            outcome = "undecided" if energy.verdict == "undecided" else "decided" if right else "WRONG"
            counts[name, outcome] += 1
            if outcome == "WRONG":
                print(
                    f"WRONG {k} {name} {np.degrees(w):.3g}°: {expression} on {layout.name}: {energy.detail}", flush=True
                )
            least = energy.facts.get("passes_with_feature_width_deg")
            if name == "no width" and energy.verdict == "undecided":
                counts["a sufficient width", "none" if least is None else "told"] += 1
                broken = least is not None and least <= np.degrees(width) and not lawful
                counts["a sufficient width", "WRONG"] += broken
                if broken:
                    print(f"WRONG {k} least {least}: {expression} on {layout.name}: {energy.detail}", flush=True)
    for (name, outcome), count in sorted(counts.items()):
        print(f"{name:20} {outcome:10} {count}")


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:])) if len(sys.argv) > 2 else main(int(sys.argv[1]) if sys.argv[1:] else 400, 0)

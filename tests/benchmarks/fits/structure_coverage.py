"""How often 95 % intervals hold the best-fitting numbers where residuals are structure, not noise.

python structure_coverage.py [DRAWS] [SEED]      default 200 draws

The truths are outside the fitted family, with 1 % independent noise; the best-fitting numbers are those of a fit to
40,000 fresh directions of the same kind, without noise. Each draw reads 24 random incidences at 50 random outgoing
directions. The table says for each truth how often the printed interval, and that of independent noise, held each
number, and the median of the factor between both.
"""

import sys

import jax
import numpy as np

import gonio
from gonio.data import layouts
from gonio.data.table import Channels, whole_table_of_values
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction, from_spherical

CASES = (
    ("lambert(rho=0.2) + 0.3*gtr(alpha=0.25, gamma=1.6)", "lambert + ggx"),
    ("oren_nayar(rho=0.5, sigma=0.5) + 0.1*cook_torrance(alpha=0.3)", "lambert + beckmann"),
    ("lambert(rho=0.1) + 0.3*ward(alpha=0.3) + 0.05*charlie(alpha=0.5)", "lambert + ggx"),
    ("hapke(w=0.6, b=0.3, c=0.5, b0=0.5, h=0.2)", "minnaert"),
)
INCIDENCES, EACH, NOISE = 24, 50, 0.01


def table(truth: str, rng: np.random.Generator, incidences: int, each: int, noise: float) -> gonio.Table:
    theta_i = np.repeat(np.arccos(rng.uniform(np.cos(1.2), 1.0, incidences)), each)
    theta_o = np.arccos(rng.uniform(np.cos(1.2), 1.0, theta_i.size))
    phi = rng.uniform(0, 2 * np.pi, theta_i.size)
    pair = (Direction(*from_spherical(a, b, np)) for a, b in ((theta_i, 0 * phi), (theta_o, phi)))
    layout = layouts.scattered(theta_i, 0 * phi, theta_o, phi)
    f = np.asarray(evaluate(build(truth), *pair)).reshape(-1, 1) * (1 + noise * rng.standard_normal((phi.size, 1)))
    return whole_table_of_values(layout, f, channels=Channels.grey())


def main(draws: str = "200", seed: str = "0") -> None:
    jax.config.update("jax_enable_x64", True)
    for number, (truth, model) in enumerate(CASES):
        rng = np.random.default_rng([int(seed), number])
        best = {p.label: p.value for p in gonio.fit(table(truth, rng, 4000, 10, 0.0), model, starts=2).parameters}
        inside, widths = [], []
        for _ in range(int(draws) // len(CASES)):
            result = gonio.fit(table(truth, rng, INCIDENCES, EACH, NOISE), model, starts=1)
            free = [p for p in result.parameters if p.status != "fixed"]
            inside.append([p.interval95[0] <= best[p.label] <= p.interval95[1] for p in free])
            widths.append([abs(p.value - best[p.label]) / p.standard_uncertainty for p in free])
        share, z = np.mean(inside, axis=0), np.sqrt(np.mean(np.square(widths), axis=0))
        each = ", ".join(f"{p.label} {s:.0%} (rms z {v:.2f})" for p, s, v in zip(free, share, z, strict=True))
        print(f"{truth} by {model}: {each}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])

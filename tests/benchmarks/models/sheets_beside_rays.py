"""Random sheets with rough sides beside rays followed through them: R and T, by their errors.

python tests/benchmarks/models/sheets_beside_rays.py [SHEETS] [SEED] [RAYS]
"""

import sys
from pathlib import Path

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.expression.builder import build
from support.rough_faces import Sheet, sheet_light


def drawn(rng: np.random.Generator) -> tuple[Sheet, float]:
    """A sheet and an angle of incidence, radians."""
    alpha = 0.02 * 20 ** rng.random()
    behind = alpha if rng.random() < 0.4 else 0.02 * 20 ** rng.random()
    eta = rng.uniform(1.2, 2.0)
    clear = 1.0 if rng.random() < 0.4 else rng.uniform(0.5, 1.0)
    return Sheet(alpha, behind, eta, clear), np.radians(rng.uniform(0, 80))


def main(sheets: int = 120, seed: int = 1, rays: int = 20_000) -> None:
    jax.config.update("jax_enable_x64", True)
    rng, errors, totals = np.random.default_rng(seed), [], []
    for k in range(sheets):
        sheet, theta = drawn(rng)
        truth = sheet_light(sheet, theta, rays, seed * 1000 + k)[:2]
        model = build("rough_slab(alpha={}, alpha_behind={}, eta={}, clear={})".format(*sheet))
        light = [
            np.ravel(integral(model, theta, 0.0, 1e-5).value)[0]
            for integral in (directional_albedo, directional_transmittance)
        ]
        errors.append(np.subtract(light, truth))
        totals.append(sum(light))
    for name, error in zip("RT", np.transpose(errors), strict=True):
        quantiles = np.quantile(np.abs(error), [0.5, 0.9, 0.95, 1])
        print(f"{name}: mean {error.mean():+.4f}, rms {np.sqrt(np.mean(error**2)):.4f}; |error|, median 90 95 100 %:")
        print("   " + " ".join(f"{q:.4f}" for q in quantiles))
    print(f"largest R + T: {max(totals):.5f}")


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:]))

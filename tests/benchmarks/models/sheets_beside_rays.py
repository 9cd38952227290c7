"""Random sheets with rough sides beside rays followed through them: R and T by incidence, f about the peaks by view.

    python tests/benchmarks/models/sheets_beside_rays.py [SHEETS] [SEED] [RAYS] [nearly]

`nearly`: sheets that are nearly clear, `clear` from 0.95 to 0.9999.
"""

import itertools
import sys
from pathlib import Path

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction
from support.rough_faces import Sheet, sheet_light

INCIDENCES = (0, 30, 45, 60, 80)
VIEWS = (0, 30, 50, 65, 80)
ANGLES = np.arange(0, 80, 5.0)
NEAR = 0.1
"""Of the greatest f on a side: views with less are left out."""


def drawn(rng: np.random.Generator, nearly: bool = False) -> tuple[Sheet, float]:
    """A sheet, one that is nearly clear at will, and an angle of incidence, radians."""
    alpha = 0.02 * 20 ** rng.random()
    behind = alpha if rng.random() < 0.4 else 0.02 * 20 ** rng.random()
    eta = rng.uniform(1.2, 2.0)
    clear = 1.0 if rng.random() < 0.4 else rng.uniform(0.5, 1.0)
    if nearly:
        clear = 1.0 - 10 ** rng.uniform(-4.0, np.log10(0.05))
    return Sheet(alpha, behind, eta, clear), np.radians(rng.uniform(0, 80))


def in_plane(side: int) -> np.ndarray:
    """Views in the plane of incidence, away from the light, behind the sheet (−1) or in front."""
    angles = np.radians(ANGLES)
    return np.stack([-np.sin(angles), 0 * angles, side * np.cos(angles)], 1)


def quantiles(name: str, errors: np.ndarray) -> None:
    if errors.size:
        rms = np.sqrt(np.mean(errors**2))
        levels = " ".join(f"{q:.4f}" for q in np.quantile(np.abs(errors), [0.5, 0.9, 0.95, 1]))
        print(
            f"{name}: {errors.size:4d}, mean {errors.mean():+.4f}, rms {rms:.4f}; |error|, median 90 95 100 %: {levels}"
        )


def by_band(name: str, edges: tuple[int, ...], degrees: np.ndarray, errors: np.ndarray) -> None:
    quantiles(name, errors)
    for low, high in itertools.pairwise(edges):
        quantiles(f"  {low:2d} to {high:2d}°", errors[(degrees >= low) & (degrees < high)])


def main(sheets: int = 120, seed: int = 1, rays: int = 20_000, nearly: bool = False) -> None:
    jax.config.update("jax_enable_x64", True)
    rng, errors, degrees, totals = np.random.default_rng(seed), [], [], []
    views = np.concatenate([in_plane(1), in_plane(-1)])
    off: tuple[list, list] = ([], [])
    for k in range(sheets):
        sheet, theta = drawn(rng, nearly)
        r, t, f = sheet_light(sheet, theta, rays, seed * 1000 + k, list(views))
        model = build("rough_slab(alpha={}, alpha_behind={}, eta={}, clear={})".format(*sheet))
        light = [
            np.ravel(integral(model, theta, 0.0, 1e-5).value)[0]
            for integral in (directional_albedo, directional_transmittance)
        ]
        errors.append(np.subtract(light, (r, t)))
        degrees.append(np.degrees(theta))
        totals.append(sum(light))
        ours = np.ravel(evaluate(model, Direction(np.sin(theta), 0.0, np.cos(theta)), Direction(*views.T)))
        for kept, ratio in zip(off, np.split(np.stack([f, ours]), 2, axis=1), strict=True):
            near = ratio[0] > NEAR * ratio[0].max()
            kept.append(np.stack([ANGLES[near], ratio[1, near] / ratio[0, near] - 1]))
    for name, error in zip("RT", np.transpose(errors), strict=True):
        by_band(f"{name}, by θi", INCIDENCES, np.array(degrees), error)
    for name, kept in zip(("reflected", "transmitted"), off, strict=True):
        angles, ratio = np.concatenate(kept, axis=1)
        by_band(f"f {name}, share, by θo", VIEWS, angles, ratio)
    print(f"largest R + T: {max(totals):.5f}")


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:] if a != "nearly"), nearly="nearly" in sys.argv)

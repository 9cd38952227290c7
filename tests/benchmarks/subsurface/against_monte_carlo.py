"""Models of light below the surface beside a half space by Monte Carlo, and slabs by adding-doubling if it is there.

    python tests/benchmarks/subsurface/against_monte_carlo.py [PHOTONS] [SEED]

Isotropic scattering, matched index, a narrow beam along the normal. `iadpython` (pip install iadpython) is optional.
"""

import importlib.util
import pathlib
import sys

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from gonio.models.subsurface.catalog import BSSRDFS  # noqa: E402
from gonio.models.subsurface.dipole import Dipole  # noqa: E402
from gonio.models.subsurface.evaluation import evaluated, totals  # noqa: E402
from gonio.models.subsurface.spots import kept_share  # noqa: E402
from support.half_space import leaving_light, total_with_error  # noqa: E402

DISTANCES = np.array([1.0, 3.0, 10.0, 30.0])
SLABS = (  # albedo, optical thickness, g, index, R and T of adding-doubling
    (0.9, 2.0, 0.75, 1.0, 0.09736, 0.66050),
    (0.9, 1.0, 0.9, 1.4, 0.06434, 0.79450),
    (0.9, np.inf, 0.0, 1.5, 0.25994, 0.0),
)


def profiles(photons: int, seed: int) -> None:
    print(f"{'albedo':8}{'':24}{'total':>10}{'±':>9}   share of it beyond 1, 3, 10, 30 mean free paths")
    for albedo in (0.8, 0.95, 0.99):
        total, error, beyond, _ = total_with_error(albedo, photons, seed)
        print(f"{albedo:<8}{'Monte Carlo':24}{total:10.5f}{error:9.5f}   {'  '.join(f'{b:8.5f}' for b in beyond)}")
        for name, kind in BSSRDFS.items():
            model = kind(albedo=albedo, mfp=1.0)
            whole = totals(model)[0]
            rest = 1 - evaluated(model, "cumulative", DISTANCES)[:, 0] / whole
            off = f"{100 * (whole / total - 1):+8.2f}%"
            print(f"{'':8}{name:24}{whole:10.5f}{off}   {'  '.join(f'{b:8.5f}' for b in rest)}")


def edges(photons: int, seed: int) -> None:
    """The share that concentric spots keep: of the dipole by both rules, of a half space by Monte Carlo beside."""
    print("\nshare kept by spots of radii a, b (mean free paths), albedo 0.95: dipole, random points, half space")
    rng, model = np.random.default_rng(seed), Dipole(albedo=0.95, mfp=1.0)
    r, w = leaving_light(0.95, photons // 4, seed)
    table = np.geomspace(1e-3, 300, 4000)
    share = evaluated(model, "cumulative", table)[:, 0] / totals(model)[0]
    drawn = np.interp(rng.random(r.size), share, table)
    for a, b in ((1.0, 1.0), (3.0, 1.0), (10.0, 3.0), (2.0, 0.5)):
        start = b * np.sqrt(rng.random(r.size))  # reciprocity: from the viewed spot into the lit one
        turn = 2 * np.pi * rng.random(r.size)
        inside = [np.hypot(start + d * np.cos(turn), d * np.sin(turn)) < a for d in (drawn, r)]
        kept = kept_share(model, a, b)
        print(
            f"a {a:4g}  b {b:4g}   {kept.value[0]:.6f} (±{kept.bound[0]:.0e})   {inside[0].mean():.4f}   "
            f"{np.sum(w * inside[1]) / np.sum(w):.4f}"
        )


def slabs(photons: int, seed: int) -> None:
    known = importlib.util.find_spec("iadpython") is not None
    print(f"\nslabs: adding-doubling {'here' if known else 'of the record (iadpython is not installed)'}; Monte Carlo")
    for albedo, thickness, g, index, r, t in SLABS:
        if known:
            import iadpython

            sample = iadpython.Sample(a=albedo, b=thickness, g=g, n=index, quad_pts=16)
            r, t = sample.rt()[:2]
        line = f"a {albedo} b {thickness:g} g {g} n {index}:   R {r:.5f} T {t:.5f}"
        if np.isinf(thickness):
            front = ((index - 1) / (index + 1)) ** 2
            inside, error, *_ = total_with_error(albedo, photons, seed, g=g, eta=index)
            line += f"   Monte Carlo R {front + (1 - front) * inside:.5f} ± {(1 - front) * error:.5f}"
        print(line)


if __name__ == "__main__":
    given = [int(v) for v in sys.argv[1:]]
    count, start = [*given, *(1_000_000, 1)[len(given) :]]
    profiles(count, start)
    edges(count, start)
    slabs(count // 4, start)

"""Adaptive tables beside uniform grids, and whether what they say of their error is true.

    python tests/benchmarks/planning/adaptive_tables.py [SEEDS] [TARGET] [PHOTONS] [MATERIAL...]

For each material `gonio.adapt` runs to the target (of ideal readings, or with so many photons). Printed are its
readings, hours, the error and the bound that it states, and its true error at 4000 other directions; of exact readings
and the first seed also the errors of regular grids, each by its own interpolation, at as many readings or more, and at
as many hours or more, the better of the isotropic one and MERL's spacing; and the readings of the coarsest that is as
good. A grid needs no more readings than symmetry leaves: half of its azimuths. At the end: how many of the targets
shown were true.
"""

import sys

import jax
import numpy as np

from gonio.data.interpolation.multilinear import as_material
from gonio.data.layouts import Layout
from gonio.data.subject import load_material, reference_materials
from gonio.data.table import whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.instrument import Instrument
from gonio.instrument.scans import half_difference, isotropic, spherical
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.planning.adaptive.accuracy import difference, random_directions
from gonio.planning.adaptive.adaptive_measurement import adapt

OTHERS = (
    "lambert(rho=0.2) + 0.4 * beckmann(alpha=0.12)",
    "lambert(rho=0.1) + std(alpha=0.1, gamma=2.5)",
    "eon(rho=0.6, r=0.8) + 0.3 * ggx(alpha=0.08, f0=0.04)",
    "0.9 * ward(alpha=0.2) + lambert(rho=0.05)",
    "coat(base=lambert(rho=0.5), alpha=0.08, eta=1.5)",
)
STEPS = (30, 22.5, 18, 15, 11.25, 10, 9, 7.5, 6, 5, 4.5, 3.75, 3)
TURNED = (30, 22.5, 18, 15)
"""Steps of isotropic grids, and of those that turn the sample, degrees."""
HELD_OUT = 4000


def grids(same_all_round: bool) -> list[tuple[str, Layout, int]]:
    """Name, layout, and the readings that symmetry leaves of each."""
    if same_all_round:
        every = [(f"isotropic {s:g}°", isotropic(np.radians(s))) for s in STEPS]
        every += [(f"half-difference {s:g}°", half_difference(np.radians(s))) for s in STEPS]
    else:
        every = [(f"spherical {s:g}°", spherical(np.radians(s))) for s in TURNED]
        every += [(f"half-difference {s:g}°", half_difference(np.radians(s), np.radians(s))) for s in TURNED]
    return [(name, g, int(g.readable().sum()) // (2 if same_all_round else 1)) for name, g in every]


def hours_of(instrument: Instrument, layout: Layout, share: float) -> float:
    """Of a grid, of whose readings a share is taken."""
    return share * instrument.pace.seconds(layout, instrument.pace.count_rate * instrument.seconds) / 3600


def values(brdf: AbstractBRDF, pair: tuple[Direction, Direction]) -> np.ndarray:
    """f (n, C)."""
    return np.asarray(evaluate_in_blocks(brdf, *pair)).reshape(pair[0].z.size, -1)


def errors(predicted: np.ndarray, f: np.ndarray, cosine: np.ndarray) -> tuple[float, float]:
    """(rms relative error as adaptive measurements state it, rms of the difference of f cosθo over the rms of that)."""
    absolute = np.sqrt(np.mean(((predicted - f) * cosine) ** 2) / np.mean((f * cosine) ** 2))
    return float(np.sqrt(np.mean(difference(predicted, f)[0] ** 2))), float(absolute)


def compared(name: str, instrument: Instrument, target: float, seeds: int) -> list[tuple[bool, bool]]:
    """Prints one material; (shown, true) of each seed."""
    brdf = load_material(name).brdf
    angles = random_directions(HELD_OUT, Instrument(), brdf.isotropic, np.random.default_rng(2024))
    pair = from_spherical(*angles[:2], np), from_spherical(*angles[2:], np)
    f, cosine, outcomes = values(brdf, pair), pair[1].z[:, None], []
    for seed in range(seeds):
        table = adapt(name, instrument, target=target, seed=seed)
        kept = table.provenance["adaptive"]
        count, hours = table.layout.size, kept["rounds"][-1]["seconds"] / 3600
        true, absolute = errors(values(as_material(table), pair), f, cosine)
        outcomes.append((kept["shown"], true <= target))
        print(
            f"{name}: {count} readings, {hours:.2f} h, {'shown' if kept['shown'] else 'not shown'} {kept['error']:.2%} "
            f"(bound {kept['bound']:.2%}), true {true:.2%}, absolute {absolute:.2%}",
            flush=True,
        )
        if seed or instrument.has_noise:
            continue
        rows = []
        for title, grid, readings in grids(brdf.isotropic):
            e = errors(values(as_material(whole_table_of_values(grid, grid_values(brdf, grid))), pair), f, cosine)
            rows.append((title, readings, hours_of(instrument, grid, readings / grid.readable().sum()), *e))
        for what, column, least in (("readings", 1, count), ("hours", 2, hours)):
            enough = [r for kind in {r[0].split()[0] for r in rows} for r in _first(rows, kind, column, least)]
            best = min(enough, key=lambda r: r[3])
            title, readings, took, e, a = best
            print(
                f"    equal {what}: {title} ({readings} readings, {took:.2f} h) {e:.2%}, × {e / max(true, 1e-9):.1f}; "
                f"absolute {a:.2%}, × {a / max(absolute, 1e-9):.1f}"
            )
        good = [r for r in rows if r[3] <= true]
        coarsest = min(good, key=lambda r: r[1]) if good else None
        more = "none of them" if coarsest is None else f"{coarsest[0]}: × {coarsest[1] / count:.1f} readings"
        print(f"    as good a grid: {more}", flush=True)
    return outcomes


def _first(rows: list[tuple], kind: str, column: int, least: float) -> list[tuple]:
    """The coarsest grid of a kind that has at least so much; else its finest."""
    own = [r for r in rows if r[0].startswith(kind)]
    return [next((r for r in own if r[column] >= least), own[-1])]


def main(seeds: int, target: float, photons: float, names: list[str]) -> None:
    instrument = Instrument(photons=photons or None)
    outcomes = [o for n in names for o in compared(n, instrument, target, seeds)]
    shown = [true for s, true in outcomes if s]
    print(f"{len(outcomes)} runs, {len(shown)} shown, {sum(shown)} of these true")


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    given = sys.argv[1:] + ["1", "0.01", "0"][len(sys.argv) - 1 :]
    main(int(given[0]), float(given[1]), float(given[2]), given[3:] or [*reference_materials(), *OTHERS])

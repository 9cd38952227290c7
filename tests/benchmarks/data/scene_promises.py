"""What is promised of tables in scenes, against the truth: reference materials and random surfaces × tables × scenes.

    python scene_promises.py [SURFACES [REDUCED [FIRST]]]

Every reference material (from number FIRST on) and SURFACES random ones (seeded; default 40) are tabled in every way of
`tables`, without provenance, and judged in each scene. The true error is that of the table's interpolant against the
surface, by a plain Monte Carlo of its own: lights and views at random over their ranges, no directions of gonio's. A
ratio of the true error to the promised one above 1 is a promise broken. REDUCED of the cases (default 60) are reduced
too, half of them with the provenance that names the surface, and the reduced tables judged likewise.
"""

import collections
import math
import sys
import time
from collections.abc import Callable, Iterator

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

from gonio.data import layouts  # noqa: E402
from gonio.data.interpolation.multilinear import as_material  # noqa: E402
from gonio.data.reduction.coarsest_table import reduce_table  # noqa: E402
from gonio.data.reduction.table_resolution import resolution  # noqa: E402
from gonio.data.reduction.thin_grid import SceneValues  # noqa: E402
from gonio.data.scene import Range, Scene, load_scene, shipped_scenes  # noqa: E402
from gonio.data.subject import load_material, reference_materials  # noqa: E402
from gonio.data.table import Table, whole_table_of_values  # noqa: E402
from gonio.models.brdf import AbstractBRDF  # noqa: E402
from gonio.models.errors import GonioError  # noqa: E402
from gonio.models.evaluation import evaluate_in_blocks  # noqa: E402
from gonio.models.expression.builder import build, to_expression  # noqa: E402
from gonio.models.geometry.directions import Direction  # noqa: E402

ROUND = (0.0, 2 * math.pi)
VIEWS, SKY = 15_000, 8
MORE_VIEWS, MORE_SKY = 60_000, 64  # where those say that a promise is broken: few draws make an error too large
PAIRS = 15_000
LOBES = (
    "ggx(alpha={w:.4f}, eta={n:.3f})", "beckmann(alpha={w:.4f}, f0={f:.3f})", "retro(alpha={w:.4f}, f0={f:.3f})",
    "phong(n={p:.1f})", "cook_torrance(alpha={w:.4f}, f0={f:.3f})", "std(alpha={w:.4f}, gamma=1.9)",
    "charlie(alpha={c:.3f})", "ggx(alpha_x={w:.4f}, alpha_y={v:.4f}, f0={f:.3f})",
)  # fmt: skip
BODIES = (
    "lambert(rho={a:.3f})", "eon(rho={a:.3f}, r={b:.3f})", "minnaert(rho={a:.3f}, k={k:.3f})",
    "oren_nayar(rho={a:.3f}, sigma={b:.3f})", "hapke(w={a:.3f}, b={b:.3f}, c=0.3, b0={b:.3f}, h={h:.3f})",
)  # fmt: skip


def surfaces(count: int) -> Iterator[tuple[str, AbstractBRDF]]:
    """The reference materials, then so many random mixtures of a body and a lobe."""
    for name in reference_materials():
        yield name, load_material(name).brdf
    for seed in range(count):
        rng = np.random.default_rng(seed)
        n = {
            "w": 10 ** rng.uniform(-1.7, -0.1), "v": 10 ** rng.uniform(-1.3, -0.1), "n": rng.uniform(1.2, 2.5),
            "f": rng.uniform(0.03, 1), "p": 10 ** rng.uniform(0.3, 3), "c": rng.uniform(0.1, 1),
            "a": rng.uniform(0.05, 0.9), "b": rng.uniform(0.05, 0.9), "k": rng.uniform(0.6, 2),
            "h": rng.uniform(0.02, 0.3),
        }  # fmt: skip
        body, lobe = BODIES[seed % len(BODIES)].format(**n), rng.choice(LOBES).format(**n)
        text = f"{body} + {10 ** rng.uniform(-1.5, 0):.3f} * {lobe}"
        yield text, build(text)


def tables(brdf: AbstractBRDF, rng: np.random.Generator) -> Iterator[tuple[str, Table]]:
    """Tables of a surface: regular, offset, uneven, stretched and half/difference grids, noise told and not, lists."""

    def polar(step: float, last: float = 85.0) -> np.ndarray:
        return np.radians(np.arange(0, last + 0.01, step))

    uneven = np.radians(np.sort([0, 85, *rng.uniform(0, 85, 14)]))
    stretched = np.radians(85 * np.linspace(0, 1, 18) ** 1.4)
    grids = {
        "2.5°": layouts.isotropic(polar(2.5), polar(2.5), polar(5, 355)),
        "5°": layouts.isotropic(polar(5), polar(5), polar(5, 355)),
        "10°": layouts.isotropic(polar(10), polar(10), polar(10, 350)),
        "half of 5°": layouts.isotropic(polar(5), polar(5), polar(5, 180)),
        "offset": layouts.isotropic(polar(15), polar(5) + np.radians(2.5), polar(10, 350)),
        "random steps": layouts.isotropic(uneven, uneven, np.radians(np.sort([180, *rng.uniform(0, 360, 30)]))),
        "stretched": layouts.isotropic(stretched, stretched, polar(10, 350)),
        "to 60°": layouts.isotropic(polar(5, 60), polar(5, 60), polar(10, 350)),
        "half/difference": layouts.merl("lower", (45, 30, 24)),
        "few half/difference": layouts.merl("centre", (18, 18, 18)),
    }  # fmt: skip
    if not brdf.isotropic:
        grids = {
            f"all azimuths, {s}°": layouts.spherical(polar(s), polar(2 * s, 359), polar(s), polar(2 * s, 359))
            for s in (7.5, 15)
        }
    for name, layout in grids.items():
        f = values(brdf, *layout.directions()).reshape(*layout.shape, -1)
        yield name, whole_table_of_values(layout, f)
        if name in ("5°", "half/difference"):
            share = 10 ** rng.uniform(-2.5, -0.7)
            u = share * np.abs(f)
            noisy = f + u * rng.standard_normal(f.shape)
            yield f"{name}, noise told", whole_table_of_values(layout, noisy, u_f=u)
            yield f"{name}, noise not told", whole_table_of_values(layout, noisy)
    if brdf.isotropic:
        z, phi = rng.uniform(0.05, 1, (2, 1000)), rng.uniform(0, 2 * np.pi, 1000)
        layout = layouts.scattered(np.arccos(z[0]), np.zeros(1000), np.arccos(z[1]), phi)
        yield "1,000 at random", whole_table_of_values(layout, values(brdf, *layout.directions()))


def scenes() -> list[Scene]:
    """Those that come with gonio, and four more."""
    low, wide, high = (tuple(np.radians(a)) for a in ((75, 88), (0, 80), (40, 45)))
    views = (Range(wide, ROUND, 1.0),)
    more = [
        Scene("grazing", 0.05, (Range(low, ROUND, 1.0),), views),
        Scene("sky", 0.05, (Range(wide, ROUND, 1.0, True),), views),
        Scene("lamp", 0.05, (Range(high, (0.0, 0.1), 1.0),), views),
        Scene("lamp seen in its mirror", 0.05, (Range(high, (0.0, 0.1), 1.0),), (Range(high, (3.0, 3.3), 1.0),)),
    ]
    return [*map(load_scene, shipped_scenes()), *more]


def values(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> np.ndarray:
    """f (n, channels)."""
    return np.nan_to_num(evaluate_in_blocks(brdf, wi, wo))


def true_error(scene: Scene, table: AbstractBRDF, surface: AbstractBRDF, seed: int, promised: float) -> float:
    """The rms error of the radiance over its rms, by plain Monte Carlo; a view is foreshortened."""
    error = drawn_error(scene, table, surface, seed, (VIEWS, SKY))
    return error if error <= promised else drawn_error(scene, table, surface, seed, (MORE_VIEWS, MORE_SKY))


def drawn_error(scene: Scene, table: AbstractBRDF, surface: AbstractBRDF, seed: int, draws: tuple[int, int]) -> float:
    """The same by so many views, and directions of a light that fills its range at each."""
    rng, (views, sky) = np.random.default_rng(seed), draws
    wo = scene.views[0].directions(rng.random(views), rng.random(views))
    error = radiance = 0.0
    for light in scene.lights:
        places = sky if light.fills else 1
        for _ in range(places):
            wi = light.directions(rng.random(views), rng.random(views))
            amount = (light.weight / places * wi.z)[:, None]
            f, truth = values(table, wi, wo), values(surface, wi, wo)
            error, radiance = error + amount * (f - truth), radiance + amount * truth
    rms = [math.sqrt(float(np.sum(np.asarray(wo.z)[:, None] * r**2))) for r in (error, radiance)]
    return rms[0] / rms[1]


def report(name: str, rows: list[tuple[float, float, float, str]]) -> None:
    """Ratios of (true error, promised error, tolerance, case): the worst, the median, and what was withheld."""
    promised = [(true / bound, case) for true, bound, _, case in rows if bound < math.inf]
    broken = [r for r in promised if r[0] > 1]
    ratios = np.array([r for r, _ in promised] or [0.0])
    kept = [r for r in rows if r[1] <= r[2]]
    withheld = [r for r in rows if r[0] <= r[2] < r[1]]
    print(
        f"{name}: {len(rows)} cases, {len(promised)} with a finite promise; true/promised: largest {ratios.max():.2f}, "
        f"median {np.median(ratios):.2f}, above 1 in {len(broken)}; {len(kept)} within the tolerance as promised, "
        f"{len(withheld)} within it and not promised", flush=True,
    )  # fmt: skip
    for ratio, case in sorted(promised, reverse=True)[:5]:
        print(f"  {ratio:.2f}  {case}", flush=True)


def judge(count: int, first: int, seen: Callable[[str, AbstractBRDF, str, Table, Scene, float], None]) -> None:
    """Judges every table in every scene; `seen` is told each case and the true error."""
    rows, by_table = [], collections.defaultdict(list)
    for number, (name, surface) in list(enumerate(surfaces(count)))[first:]:
        for kind, table in tables(surface, np.random.default_rng(1000 + number)):
            interpolant = as_material(table)
            for scene in scenes():
                pairs = scene.pairs(PAIRS)
                f = evaluate_in_blocks(interpolant, pairs.wi, pairs.wo)
                bound = resolution(table, SceneValues(pairs, f)).error
                true = true_error(scene, interpolant, surface, number, bound)
                rows.append((true, bound, scene.tolerance, f"{name}, {kind}, {scene.name}: {true:.2%} of {bound:.2%}"))
                by_table[kind].append(rows[-1])
                seen(name, surface, kind, table, scene, true)
                if true > bound:
                    print(f"broken: {rows[-1][3]}", file=sys.stderr, flush=True)
        ratios = [r[0] / r[1] for r in rows if r[1] < math.inf]
        words = f"{sum(x > 1 for x in ratios)} broken of {len(rows)}, {len(ratios)} with a finite promise, "
        print(f"{name}: {words}true/promised {np.median(ratios):.2f} in the median", file=sys.stderr, flush=True)
    report("whole tables", rows)
    for kind, of in by_table.items():
        report(kind, of)


def main(count: int = 40, reduced: int = 60, first: int = 0) -> None:
    began, chosen, rows = time.perf_counter(), np.random.default_rng(7), []

    def seen(name: str, surface: AbstractBRDF, kind: str, table: Table, scene: Scene, true: float) -> None:
        if len(rows) >= reduced or chosen.random() > 0.05 or true > 0.2:
            return
        named = len(rows) % 2 == 1
        if named:
            table.provenance["material"] = {"name": name, "spelling": to_expression(surface)}
        try:
            small = reduce_table(table, scene)
        except GonioError:
            return
        finally:
            table.provenance.clear()
        error = true_error(scene, as_material(small.table), surface, 99, small.promised)
        case = f"{name}, {kind}{', named' * named}, {scene.name}: {error:.2%} of {small.promised:.2%}"
        rows.append((error, small.promised, small.tolerance, case))
        print(f"reduced: {case}", file=sys.stderr, flush=True)

    judge(count, first, seen)
    report("reduced tables", rows)
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

"""Hemisphere integrals: rules, orders and widths of the lobe, the claimed bound beside the true error."""

import math
from collections.abc import Callable, Iterable, Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from gonio.charts.point import Axis, Chart, Point, Settings
from gonio.charts.timing import in_turns, precision
from gonio.checks.model.cubature import cubature_albedo
from gonio.checks.table.energy import table_albedos
from gonio.data import layouts
from gonio.data.table import whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.albedo import directional_albedo
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.stability.albedos import UNRESOLVED, ring_albedo
from gonio.stability.directions import AZIMUTH, unit_vector

THETA = np.radians([5.0, 20.0, 35.0, 50.0, 60.0, 70.0, 80.0, 85.0])
CONFIDENCE = math.log(2 / 1e-6)
"""The bound of a random rule may be exceeded once in a million."""

Albedos = Callable[[], Iterable[np.ndarray]]
"""Computes the albedos at the incidences, and the claimed bounds; NaN where the rule claims none."""


def _incoming() -> Direction:
    return Direction(*(jnp.asarray(c) for c in unit_vector(THETA)))


def _lobe_map(brdf: AbstractBRDF, tolerance: float) -> Albedos:
    return lambda: directional_albedo(brdf, THETA, AZIMUTH, tolerance)[:2]


def _rings(brdf: AbstractBRDF, tolerance: float) -> Albedos:
    def one(theta: float) -> tuple[float, float]:
        value, error = ring_albedo(brdf, theta, "mirror", tolerance)
        return value, error + UNRESOLVED * max(abs(value), 1.0)

    return lambda: np.transpose([one(t) for t in THETA.tolist()])


def _cubature(brdf: AbstractBRDF, tolerance: float) -> Albedos:
    return lambda: np.transpose([np.ravel(cubature_albedo(brdf, t, AZIMUTH, tolerance)) for t in THETA.tolist()])


def _grid(brdf: AbstractBRDF, step: float) -> Albedos:
    polar = np.radians(np.arange(0, 90 + step / 2, step))
    where = layouts.isotropic(THETA, polar, np.radians(np.arange(0, 360, step)))
    table = whole_table_of_values(where, grid_values(brdf, where))

    def call() -> tuple[np.ndarray, np.ndarray]:
        albedos = table_albedos(table)
        assert not isinstance(albedos, str), albedos
        return albedos.value[:, 0], np.maximum(albedos.above, albedos.below)[:, 0]

    return call


def _product(brdf: AbstractBRDF, order: float) -> Albedos:
    n = int(order)
    x, w = np.polynomial.legendre.leggauss(n)
    theta, phi = (x + 1) * np.pi / 4, np.arange(2 * n) * np.pi / n
    t, p = (g.ravel() for g in np.meshgrid(theta, phi, indexing="ij"))
    wo = from_spherical(t, p, np)
    weight = np.repeat(w * np.pi / 4 * np.sin(theta) * np.cos(theta) * np.pi / n, 2 * n)

    def call() -> tuple[np.ndarray, np.ndarray]:
        wi = Direction(*(np.asarray(c)[:, None] for c in _incoming()))
        return np.asarray(evaluate(brdf, wi, wo)) @ weight, np.full(THETA.size, np.nan)

    return call


@eqx.filter_jit
def _sampled(brdf: AbstractBRDF, wi: Direction, u1: jax.Array, u2: jax.Array) -> tuple[jax.Array, jax.Array]:
    def one(w: Direction, a: jax.Array, b: jax.Array) -> jax.Array:
        wo, leaves = brdf.sample(w, a, b)
        weight = jnp.maximum(wo.z, 0.0) / jnp.where(leaves, brdf.pdf(w, wo), 1.0)
        return jnp.where(leaves, brdf.f(w, wo) * weight, 0.0)

    values = jax.vmap(lambda w: jax.vmap(lambda a, b: one(w, a, b))(u1, u2))(wi)
    return jnp.mean(values, 1), jnp.var(values, 1, ddof=1)


def _sampling(brdf: AbstractBRDF, count: float) -> Albedos:
    n = int(count)
    u1, u2 = (jnp.asarray(a) for a in np.random.default_rng(0).random((2, n)))

    def call() -> tuple[np.ndarray, np.ndarray]:
        mean, variance = (np.asarray(a) for a in _sampled(brdf, _incoming(), u1, u2))
        # Without a Fresnel factor f cosθ over the density is masking over masking, within [0, 1]: an empirical
        # Bernstein bound holds [Maurer & Pontil 2009, theorem 4], for both sides.
        return mean, np.sqrt(2 * variance * CONFIDENCE / n) + 7 * CONFIDENCE / (3 * (n - 1))

    return call


TOLERANCES = {"10⁻³": 1e-3, "10⁻⁵": 1e-5, "10⁻⁷": 1e-7, "10⁻⁹": 1e-9, "10⁻¹¹": 1e-11}
RULES = {
    "lobe map": (_lobe_map, TOLERANCES),
    "rings": (_rings, TOLERANCES),
    "adaptive cubature": (_cubature, {n: t for n, t in TOLERANCES.items() if t > 1e-8}),
    "table's grid": (_grid, {"10°": 10.0, "5°": 5.0, "2°": 2.0, "1°": 1.0}),
    "product rule": (_product, {str(n): float(n) for n in (8, 16, 32, 64, 128, 256)}),
    "sampling": (_sampling, {f"2{e}": 2.0**n for n, e in ((8, "⁸"), (11, "¹¹"), (14, "¹⁴"), (17, "¹⁷"))}),
}
WIDTHS, QUICK = (1.0, 0.5, 0.1, 0.05, 0.01, 0.001), (0.5, 0.05, 0.005)


def truth(brdf: AbstractBRDF) -> tuple[np.ndarray, np.ndarray]:
    """(albedos, their uncertainties): two rules that share nothing, and how far they are apart."""
    rings = np.array([ring_albedo(brdf, float(t), "mirror", 1e-13).value for t in THETA])
    mapped = directional_albedo(brdf, THETA, AZIMUTH, 1e-15).value
    return mapped, np.abs(rings - mapped) + 1e-14


def points(settings: Settings) -> Iterator[Point]:
    """One point for each width, rule and setting: the largest error over eight incidences."""
    with precision("float64"):
        for alpha in QUICK if settings.quick else WIDTHS:
            brdf = build(f"ggx(alpha={alpha:g})")
            exact, known = truth(brdf)
            runs = [
                (rule, name, make(brdf, setting))
                for rule, (make, by_name) in RULES.items()
                for name, setting in list(by_name.items())[:: 2 if settings.quick else 1]
            ]
            timings = in_turns([call for *_, call in runs], *settings.clock())
            for (rule, name, _), timing in zip(runs, timings, strict=True):
                value, bound = timing.result
                values = {"ms": timing.median / THETA.size * 1e3, "known": float(np.max(known))}
                errors, note = _errors(np.abs(value - exact), bound, known)
                yield Point(f"α = {alpha:g}", rule, name, values | errors | {"first_call_s": timing.first_call}, note)


def _errors(error: np.ndarray, bound: np.ndarray, known: np.ndarray) -> tuple[dict[str, float], str]:
    # The largest error and bound, and a note; of the worst incidence alone where a bound is exceeded.
    if np.isnan(bound).any():
        return {"error": float(np.max(error))}, ""
    if not np.any(error > bound + known):
        return {"error": float(np.max(error)), "bound": float(np.max(bound))}, ""
    worst = int(np.argmax(error - bound - known))
    note = f"bound exceeded at {np.degrees(THETA[worst]):g}°"
    return {"error": float(error[worst]), "bound": float(bound[worst])}, note


CHART = Chart(
    "hemisphere",
    "Directional albedo of GGX",
    "Largest error over eight incidences from 5° to 85°, beside the bound that the rule itself claims (thin line up to "
    "a bar; an arrow where that is above 10 or infinite). The truth: two rules that share nothing, known as far as "
    "they agree. Labels: tolerance asked, step of the grid, order, or samples. The product rule in both angles "
    "claims no bound; that of sampling holds but for one in a million.",
    ((Axis("ms", "time of one albedo, ms"), Axis("error", "error of the albedo")),),
    points,
)

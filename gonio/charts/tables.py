"""Tables: layouts, resolutions and interpolations, their error against the model that was measured, and their bytes."""

import dataclasses
import functools
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from gonio.charts.point import Axis, Chart, Point, Settings
from gonio.charts.timing import in_turns, precision
from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.interpolation.multilinear import as_material
from gonio.data.interpolation.rgl_fit import fit_rgl
from gonio.data.interpolation.rgl_layout import RGLLayout
from gonio.data.interpolation.rgl_warp import RGLMaterial
from gonio.data.layouts import Layout
from gonio.data.table import whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate, sampled_directions, sampling_density
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import NORMAL, Direction
from gonio.stability.directions import unit_vector

THETA_MAX = np.radians(80.0)


@dataclasses.dataclass(frozen=True)
class Light:
    """Random pairs (n,), dense where a surface reflects, with the weight cosθo/density and f there."""

    wi: Direction
    wo: Direction
    weight: np.ndarray
    f: np.ndarray

    def misplaced(self, brdf: AbstractBRDF) -> float:
        """∫∫ |f' − f| cosθo dωo / ∫∫ f cosθo dωo under uniform light, of another f'; NaN counts as all of it."""
        other = np.asarray(evaluate(brdf, self.wi, self.wo), float).reshape(self.f.size, -1).mean(axis=1)
        off = np.where(np.isfinite(other), np.abs(other - self.f), self.f)
        return float(np.sum(self.weight * off) / np.sum(self.weight * self.f))


def light_of(brdf: AbstractBRDF, count: int = 20_000, seed: int = 0) -> Light:
    """Pairs for a one-channel surface: the light cosine-weighted, wo by the surface's own sampler, both below 80°."""
    rng = np.random.default_rng(seed)
    theta = np.arcsin(np.sin(THETA_MAX) * np.sqrt(rng.random(count)))
    phi = rng.uniform(0, 2 * np.pi, count)
    wi = Direction(*unit_vector(theta, phi))
    wo = sampled_directions(brdf, wi, rng.random(count), rng.random(count))
    # Always as many pairs: one compiled program serves all surfaces of a kind.
    up = np.asarray(wo.z) > np.cos(THETA_MAX)
    wi, wo = (Direction(*(np.where(up, c, e) for c, e in zip(w, NORMAL, strict=True))) for w in (wi, wo))
    f = np.asarray(evaluate(brdf, wi, wo), float).reshape(count)
    return Light(wi, wo, np.where(up, wo.z / np.asarray(sampling_density(brdf, wi, wo)), 0.0), f)


DIFFUSE = "lambert(rho=0.2)"
WIDTHS, QUICK = (0.5, 0.2, 0.05, 0.01), (0.3, 0.05)
STORED_BYTES = 4
"""Of one value in single precision."""


def _isotropic(step: float) -> Layout:
    polar = np.radians(np.arange(0, 90 + step / 2, step))
    return layouts.isotropic(polar, polar, np.radians(np.arange(0, 180 + step / 2, step)))


def _merl(step: float) -> Layout:
    n = round(90 / step)
    return layouts.merl(counts=(n, n, 2 * n))


def _even_half(step: float) -> Layout:
    n = round(90 / step)
    h, d, p = np.arange(n) / n, np.arange(n) / n, np.arange(2 * n) / (2 * n)
    return layouts.half_difference(h * np.pi / 2, d * np.pi / 2, p * np.pi)


class _NearestAxis(eqx.Module):
    axis: Any

    def bracket(self, x: Any, xp: ModuleType = jnp) -> tuple[Any, tuple[Any, Any]]:
        nodes, (_, upper) = self.axis.bracket(x, xp)
        whole = xp.round(upper)
        return nodes, (1.0 - whole, whole)


class _Exponential(AbstractBRDF):
    # Interpolation of log(f + floor): lobes are near to parabolas there.
    logs: AbstractBRDF
    floor: jax.Array

    def formula(self, wi: Direction, wo: Direction) -> jax.Array:
        return jnp.exp(self.logs.formula(wi, wo)) - self.floor


def _linear(grid: Layout, f: np.ndarray) -> AbstractBRDF:
    return as_material(whole_table_of_values(grid, f))


def _nearest(grid: Layout, f: np.ndarray) -> AbstractBRDF:
    table: Any = _linear(grid, f)
    return eqx.tree_at(lambda t: t.axes, table, tuple(_NearestAxis(a) for a in table.axes))


def _logarithmic(grid: Layout, f: np.ndarray) -> AbstractBRDF:
    floor = 1e-6 * float(np.nanmax(f))
    return _Exponential(_linear(grid, np.log(np.maximum(f, 0.0) + floor)), jnp.asarray(floor))


LAYOUTS = {"isotropic": _isotropic, "half/difference, MERL": _merl, "half/difference, even": _even_half}
QUICK_LAYOUTS = 2
INTERPOLATIONS = {"nearest": _nearest, "linear": _linear, "linear in log f": _logarithmic}
STEPS, QUICK_STEPS = (15.0, 10.0, 5.0, 2.0, 1.0), (15.0, 5.0, 2.0)
RGL_BYTES, QUICK_RGL_BYTES = (1024, 4096, 16384, 65536), (4096,)
"""Of a channel of a written RGL file."""


def points(settings: Settings) -> Iterator[Point]:
    """One point for each width, layout, step and interpolation."""
    with precision("float64"):
        for alpha in QUICK if settings.quick else WIDTHS:
            brdf = build(f"{DIFFUSE} + 0.5 * ggx(alpha={alpha:g})")
            light = light_of(brdf)
            for step in QUICK_STEPS if settings.quick else STEPS:
                yield from _of_step(f"α = {alpha:g}", brdf, light, step, settings)
            for channel_bytes in QUICK_RGL_BYTES if settings.quick else RGL_BYTES:
                yield _of_rgl(f"α = {alpha:g}", brdf, light, channel_bytes, settings)


def _of_step(panel: str, brdf: AbstractBRDF, light: Light, step: float, settings: Settings) -> Iterator[Point]:
    cases: list[tuple[str, Layout, AbstractBRDF]] = []
    for name, make_layout in list(LAYOUTS.items())[: QUICK_LAYOUTS if settings.quick else None]:
        grid = make_layout(step)
        f = grid_values(brdf, grid)
        cases += [(f"{name}, {how}", grid, interpolate(grid, f)) for how, interpolate in INTERPOLATIONS.items()]
    calls = [functools.partial(evaluate, interpolant, light.wi, light.wo) for *_, interpolant in cases]
    for (method, grid, interpolant), timing in zip(cases, in_turns(calls, *settings.clock()), strict=True):
        values = {
            "ns": timing.median / light.f.size * 1e9,
            "error": light.misplaced(interpolant),
            "bytes": float(grid.size * STORED_BYTES),
            "first_call_s": timing.first_call,
        }
        yield Point(panel, method, f"{step:g}°", values)


def _of_rgl(panel: str, brdf: AbstractBRDF, light: Light, channel_bytes: int, settings: Settings) -> Point:
    layout = RGLLayout.of_bytes(channel_bytes, None)
    fit = fit_rgl(brdf, Channels.grey(), layout, lambda wi, wo: np.ones(wi.z.shape, bool), panel)
    interpolant = RGLMaterial(fit.data)
    (timing,) = in_turns([functools.partial(evaluate, interpolant, light.wi, light.wo)], *settings.clock())
    values = {
        "ns": timing.median / light.f.size * 1e9,
        "error": light.misplaced(interpolant),
        "bytes": float(layout.nodes * STORED_BYTES),
        "first_call_s": timing.first_call,
    }
    return Point(panel, "RGL file", f"{layout.theta_i.size} × {layout.side}²", values)


ERROR = Axis("error", "share of the reflected light misplaced")
CHART = Chart(
    "tables",
    "Tables of Lambert + GGX",
    "The error is ∫∫ |f' − f| cosθo dωo over ∫∫ f cosθo dωo under uniform light, both directions within 80° of the "
    "normal. Bytes of one channel in single precision, cells below the horizon counted. Labels: step in angle (for "
    "MERL's spacing, that of theta_d); of an RGL file, as gonio convert writes it, incidences × samples: the maps of "
    "its warp, the same for all channels, are not counted. Interpolation in log f adds 1e-6 of the peak before taking "
    "the logarithm.",
    ((Axis("bytes", "bytes of a channel"), ERROR), (Axis("ns", "time of one look-up, ns"), ERROR)),
    points,
)

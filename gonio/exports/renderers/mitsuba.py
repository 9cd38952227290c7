"""Mitsuba 3: sums of its diffuse, roughconductor and roughdielectric plugins, exact where the terms are its own; or its
principled plugins. What goes through a sheet evenly is one that only transmits."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gonio.exports.forms import Appearance, Form, Number, Values, base_terms, diffusing, plain
from gonio.exports.pairs import Pairs
from gonio.exports.renderers.glass import NUMBERS as GLASS
from gonio.exports.renderers.glass import glass
from gonio.exports.renderers.lobes import column, eon
from gonio.exports.renderers.mitsuba_plugins import (
    WIDEST_THROUGH,
    Plugin,
    body_f,
    describe_body,
    lobe_f,
    lobe_through,
    rough_conductor,
    straight_facets,
    summed,
    texture,
    translucent,
    two_sided,
)
from gonio.exports.renderers.mitsuba_principled import principled, principled_thin
from gonio.models.brdf import AbstractBRDF
from gonio.models.diffuse.lambert import Lambert
from gonio.models.microfacet.beckmann import Beckmann
from gonio.models.microfacet.ggx import GGX
from gonio.models.microfacet.widths import along_axes
from gonio.models.transmission.lambert_transmission import LambertTransmission
from gonio.models.transmission.rough_dielectric import RoughDielectric
from gonio.models.transmission.thin_sheet import TwoSidedLambert

ZERO = np.zeros(())
INVISIBLE = 1e-6
"""Reflectance of what is left out of a sum."""


def forms(sought: Appearance) -> tuple[Form, ...]:
    """The sum of plugins that the surface is, where it is one; else what may be near to it."""
    exact = _own(sought)
    if exact is not None:
        return (exact,)
    if sought.interface:
        terms = [model for _, model in base_terms(sought.material.brdf)]
        gaussian = any(isinstance(m, RoughDielectric) and m.distribution == "beckmann" for m in terms)
        return (glass(_glass, "separable"), *([_gaussian_glass()] if gaussian else []))
    others = any(model.lobe and not isinstance(model, GGX) for _, model in base_terms(sought.material.brdf))
    kinds = ["ggx", "beckmann"] if others or not sought.widths else ["ggx"]
    lobes: list[Sequence[str]] = [("dielectric",), ("metal",), ("white",)]
    if sought.isotropic:
        lobes += [("dielectric", "dielectric"), ("white", "dielectric")]
    sums = [_sum("diffuse", (), "ggx", sought.isotropic), _sum("plastic", (), "ggx", sought.isotropic)]
    sums += [_sum("diffuse", lobe, kind, sought.isotropic) for kind in kinds for lobe in lobes]
    sums += [_sum("plastic", lobe, "ggx", sought.isotropic) for lobe in (lobes[0], *lobes[3:4])]
    if not sought.transmits:
        return (*sums, principled(sought.isotropic))
    lobed = [_sum("diffuse", lobe, kind, True) for kind in kinds for lobe in lobes[:2] if sought.isotropic]
    lit = [diffusing(form, _through(form)) for form in sums]
    return (*lit, *(passing(form) for form in [sums[0], *lobed]), principled_thin(sought.isotropic))


def _through(form: Form) -> Callable[[Values], Plugin]:
    """The plugin of a form on both sides, with what goes through."""

    def describe(v: Values) -> Plugin:
        parts = [two_sided(form.describe(v))]
        if np.max(v["through"]) > INVISIBLE:
            parts.append(translucent(v["through"]))
        if "lobe_through" in v:
            parts.append(lobe_through(v["lobe_through"], float(v["alpha_through"])))
        return summed(parts)

    return describe


PASSING = (
    Number("lobe_through", 0.0, 1.0, 0.4, coloured=True),
    Number("alpha_through", 1e-3, WIDEST_THROUGH, 0.05, log=True, width=True),
)


def passing(form: Form) -> Form:
    """A form of which some light goes through evenly, and some by facets about the straight direction."""
    even = diffusing(form, form.describe)

    def f(v: Values, pairs: Pairs) -> np.ndarray:
        if np.all(pairs.wo.z > 0):
            return form.f(v, pairs)
        alpha = v["alpha_through"]
        return even.f(v, pairs) + v["lobe_through"] * straight_facets(pairs, alpha, alpha)

    return Form(f"{even.name} + a lobe in transmission", (*even.numbers, *PASSING), f, _through(form), transmits=True)


def _own(sought: Appearance) -> Form | None:
    """The surface in Mitsuba's own plugins, where each of its terms is one of them."""
    parts, colourless = [], plain(sought.material.channels)
    for scale, model in base_terms(sought.material.brdf):
        part = _plugin(np.asarray(scale), model, sought, colourless)
        if part is None:
            return None
        parts.append(part)
    plugins = [plugin for plugin, _, _ in parts]

    def f(values: Values, pairs: Pairs) -> np.ndarray:
        return functools.reduce(np.add, (of(pairs) for _, of, _ in parts))

    names = " + ".join(plugin["type"] for plugin in plugins)
    return Form(names, (), f, lambda values: summed(plugins), transmits=any(through for _, _, through in parts))


def _plugin(
    scale: np.ndarray, model: AbstractBRDF, sought: Appearance, colourless: bool
) -> tuple[Plugin, Callable[[Pairs], np.ndarray], bool] | None:
    """(plugin, f, whether it transmits) of a term, or None where Mitsuba has none that is the same."""
    if isinstance(model, Lambert):
        rho = _colour(scale * np.asarray(model.rho), sought)
        return {"type": "diffuse", "reflectance": texture(rho)}, lambda p: _front(p, eon(p, rho, ZERO)), False
    if isinstance(model, TwoSidedLambert):
        rho, behind = (_colour(scale * np.asarray(r), sought) for r in (model.rho, model.rho_behind))
        sides = [{"type": "diffuse", "reflectance": texture(r)} for r in (rho, behind)]
        return two_sided(*sides), lambda p: _front(p, eon(p, rho, ZERO)), False
    if isinstance(model, LambertTransmission):
        tau = _colour(scale * np.asarray(model.tau), sought)
        return translucent(tau), lambda p: np.where(column(p.wo.z) < 0, tau / np.pi, 0.0), True
    separable = {GGX: ("separable",), Beckmann: ("walter",)}
    if isinstance(model, GGX | Beckmann) and model.smith in separable[type(model)] and model.energy == "single":
        index = [None if v is None else np.asarray(v) for v in (model.eta, model.k)]
        if model.f0 is not None or (not colourless and any(v is not None and v.ndim for v in index)):
            return None
        widths = [np.asarray(w) for w in model.widths]
        if any(w.ndim for w in widths):
            return None
        tint = _colour(scale, sought)
        kind = "ggx" if isinstance(model, GGX) else "beckmann"
        description = rough_conductor(kind, (float(widths[0]), float(widths[1])), index[0], index[1], tint)
        return description, lambda p: _front(p, tint * lobe_f(p, kind, widths, index[0], index[1])), False
    if isinstance(model, RoughDielectric) and scale.ndim == 0 and scale == 1 and np.ndim(model.eta) == 0:
        return _interface(model)
    return None


def _interface(model: RoughDielectric) -> tuple[Plugin, Callable[[Pairs], np.ndarray], bool] | None:
    if model.smith != ("separable" if model.distribution == "ggx" else "walter"):
        return None
    from gonio.models.evaluation import evaluate_in_blocks

    alpha_x, alpha_y = along_axes(model, "alpha")
    description = {
        "type": "roughdielectric", "distribution": model.distribution, "alpha_u": float(alpha_x),
        "alpha_v": float(alpha_y), "int_ior": float(model.eta), "ext_ior": 1.0,
    }  # fmt: skip
    return description, lambda p: evaluate_in_blocks(model, p.wi, p.wo), True


def _glass(v: Values, distribution: str = "ggx") -> Plugin:
    plugin = {"type": "roughdielectric", "distribution": distribution, "alpha": float(v["alpha"])}
    return plugin | {"int_ior": float(v["eta"]), "ext_ior": 1.0}


def _gaussian_glass() -> Form:
    """The plugin with Beckmann's facets, whose masking is Walter's."""
    import jax.numpy as jnp

    from gonio.models.evaluation import evaluate_in_blocks

    def f(v: Values, pairs: Pairs) -> np.ndarray:
        alpha, eta = (jnp.asarray(v[name]) for name in ("alpha", "eta"))
        model = RoughDielectric(alpha=alpha, eta=eta, distribution="beckmann", smith="walter")
        return evaluate_in_blocks(model, pairs.wi, pairs.wo)

    name = "a rough interface (Beckmann)"
    return Form(name, GLASS, f, lambda values: _glass(values, "beckmann"), transmits=True)


def _front(pairs: Pairs, f: np.ndarray) -> np.ndarray:
    return np.where(column(pairs.wo.z) > 0, f, 0.0)


def _colour(values: np.ndarray, sought: Appearance) -> np.ndarray:
    return np.broadcast_to(values, (sought.to_rgb.shape[1],)) @ sought.to_rgb.T


LOBES = {"dielectric": "a dielectric's lobe", "metal": "a metal's lobe", "white": "a tinted lobe"}


def _sum(below: str, lobes: Sequence[str], kind: str, isotropic: bool) -> Form:
    """A diffuser, free or under a smooth coat, and lobes: of a dielectric, a metal, or with a Fresnel factor of 1."""
    numbers = [Number("rho", 0.0, 1.0, 0.3, coloured=True)]
    numbers += [Number("body_eta", 1.01, 3.0, 1.5, log=True)] if below == "plastic" else []
    for j, lobe in enumerate(lobes):
        axes = ("alpha",) if isotropic else ("alpha_u", "alpha_v")
        numbers += [Number(f"{axis}{j}", 1e-4, 1.0, 0.2, log=True, width=True) for axis in axes]
        numbers += {
            "dielectric": [Number(f"eta{j}", 1.01, 4.0, 1.5, log=True), Number(f"scale{j}", 0.0, 20.0, 1.0)],
            "metal": [
                Number(f"eta{j}", 0.02, 10.0, 1.0, coloured=True, log=True),
                Number(f"k{j}", 0.0, 20.0, 3.0, coloured=True),
            ],
            "white": [Number(f"scale{j}", 0.0, 1.0, 0.3, coloured=True)],
        }[lobe]

    def parts(v: Values) -> list[tuple[tuple[Any, Any], Any, Any, Any]]:
        each = []
        for j in range(len(lobes)):
            widths = (v[f"alpha{j}"],) * 2 if isotropic else (v[f"alpha_u{j}"], v[f"alpha_v{j}"])
            each.append((widths, v.get(f"eta{j}"), v.get(f"k{j}"), v.get(f"scale{j}", np.ones(()))))
        return each

    def f(v: Values, pairs: Pairs) -> np.ndarray:
        lit = (scale * lobe_f(pairs, kind, widths, eta, k) for widths, eta, k, scale in parts(v))
        return functools.reduce(np.add, lit, body_f(v, pairs))

    def describe(v: Values) -> Plugin:
        plugins = [
            rough_conductor(kind, (float(w[0]), float(w[1])), eta, k, np.atleast_1d(tint))
            for w, eta, k, tint in parts(v)
        ]
        return summed([describe_body(v), *plugins] if np.max(v["rho"]) > INVISIBLE or not lobes else plugins)

    names = ["diffuse under a smooth coat" if below == "plastic" else "diffuse", *(LOBES[lobe] for lobe in lobes)]
    return Form(" + ".join(names) + " (Beckmann)" * (kind == "beckmann"), tuple(numbers), f, describe)

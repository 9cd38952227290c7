"""Mitsuba's plugins as it is told of them, their sums, and f of those that reflect."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gonio.exports.forms import Values
from gonio.exports.pairs import Pairs
from gonio.exports.renderers.lobes import beckmann_facets, column, conductor, dielectric, ggx_facets

Plugin = dict[str, Any]
WIDEST_THROUGH = 0.3**2
"""Width of the facets of `lobe_through` at most."""
LEAST_SHARE = 0.1
"""Of a part in a blend, from which it is drawn."""


def lobe_f(
    pairs: Pairs, kind: str, widths: Sequence[np.ndarray], eta: np.ndarray | None, k: np.ndarray | None
) -> np.ndarray:
    """f of a lobe, (n, C): of a metal, of a dielectric where it has no k, or of facets that reflect everything."""
    x, y = widths
    facets = beckmann_facets(pairs, x, y) if kind == "beckmann" else ggx_facets(pairs, x, y, "separable")
    if eta is None:
        return facets
    return facets * (dielectric(pairs.cos_d, eta) if k is None else conductor(pairs.cos_d, eta, k))


def rough_conductor(
    kind: str, widths: tuple[float, float], eta: np.ndarray | None, k: np.ndarray | None, tint: np.ndarray
) -> Plugin:
    """The plugin `roughconductor`; with k = 0 it reflects as a dielectric does."""
    alpha = {"alpha": widths[0]} if widths[0] == widths[1] else {"alpha_u": widths[0], "alpha_v": widths[1]}
    index = {"material": "none"} if eta is None else {"eta": texture(eta), "k": texture(0.0 if k is None else k)}
    plugin = {"type": "roughconductor", "distribution": kind, **alpha, **index}
    return plugin if np.all(tint == 1) else plugin | {"specular_reflectance": texture(tint)}


def two_sided(front: Plugin, behind: Plugin | None = None) -> Plugin:
    """What reflects on its front alone, on both sides, or with another plugin behind."""
    return {"type": "twosided", "front": front} | ({} if behind is None else {"behind": behind})


def translucent(tau: Any) -> Plugin:
    """A diffuser in transmission: `principledthin`, all of whose light goes through without a lobe."""
    return {"type": "principledthin", "base_color": texture(tau), "diff_trans": 2.0, "roughness": 1.0}


def lobe_through(tint: Any, alpha: float) -> Plugin:
    """GGX facets of index 1 about the straight direction; `principledthin` makes them 0.3 times as rough as stated."""
    rough = {"roughness": float(np.sqrt(alpha / WIDEST_THROUGH)), "eta": 1.0}
    return {"type": "principledthin", "base_color": texture(tint), "spec_trans": 1.0, **rough}


def straight_facets(pairs: Pairs, alpha_x: Any, alpha_y: Any) -> np.ndarray:
    """f of the facets of `principledthin` that pass all light, of pairs behind the surface, but for the Fresnel factor.

    It drops facets whose front the light leaves by.
    """
    mirrored = pairs.through()
    leaves = mirrored.cos_d < 2.0 * column(mirrored.wo.z * mirrored.h.z)
    return np.where(leaves, ggx_facets(mirrored, alpha_x, alpha_y, "separable"), 0.0)


def texture(values: Any) -> Plugin:
    """A colour, or a grey; beyond 1 a raw one, as reflectances are refused there."""
    v = np.atleast_1d(np.asarray(values, float))
    if v.size == 1 or np.all(v == v[0]):
        return {"type": "uniform", "value": float(v[0])}
    return {"type": "rgb", "value": [float(x) for x in v]}


def summed(parts: Sequence[Plugin]) -> Plugin:
    """The sum of BSDFs: a blend, in which each stands as many times as bright as its share is smaller."""
    if len(parts) == 1:
        return parts[0]
    needs = np.array([max(LEAST_SHARE, *_brightness(p)) for p in parts])
    share = float(needs[0] / needs.sum())
    first, rest = scaled(parts[0], 1 / (1 - (1 - share))), [scaled(p, 1 / (1 - share)) for p in parts[1:]]
    return {"type": "blendbsdf", "weight": 1 - share, "first": first, "second": summed(rest)}


REFLECTANCES = {"diffuse": "reflectance", "plastic": "diffuse_reflectance", "principledthin": "base_color"}
NESTED = {"blendbsdf": ("first", "second"), "twosided": ("front", "behind")}


def _reflectance(plugin: Plugin) -> str:
    return REFLECTANCES.get(plugin["type"], "specular_reflectance")


def _brightness(plugin: Plugin) -> list[float]:
    if plugin["type"] in NESTED:
        parts = [_brightness(plugin[name]) for name in NESTED[plugin["type"]] if name in plugin]
        if plugin["type"] == "blendbsdf":
            shares = (1 - plugin["weight"], plugin["weight"])
            return [sum(share * max(part) for share, part in zip(shares, parts, strict=True))]
        return [max(map(max, parts))]
    value = plugin.get(_reflectance(plugin), {}).get("value", 0.0)
    return value if isinstance(value, list) else [0.0, value if plugin["type"] in REFLECTANCES else 0.0]


def scaled(plugin: Plugin, factor: float) -> Plugin:
    """A plugin that reflects so many times as much."""
    if plugin["type"] in NESTED:
        return plugin | {name: scaled(plugin[name], factor) for name in NESTED[plugin["type"]] if name in plugin}
    name = _reflectance(plugin)
    value = np.asarray(plugin.get(name, {"value": 1.0})["value"]) * factor
    description = texture(value)
    if value.ndim and value.max() > 1:
        description = {"type": "rawconstant", "value": description["value"]}
    return plugin | {name: description}


def body_f(v: Values, pairs: Pairs) -> np.ndarray:
    """f of `diffuse`, or of `plastic` without its highlight, which has another mean reflectance from within."""
    f = v["rho"] / np.pi * np.ones((pairs.wi.z.size, 1))
    if "body_eta" not in v:
        return f
    eta = float(v["body_eta"])
    inside = 0.0636 * eta + 0.6681 + 0.7099 / eta - 1.4399 / eta**2
    passed = [1.0 - dielectric(column(w.z), eta) for w in (pairs.wi, pairs.wo)]
    return f * passed[0] * passed[1] / (eta**2 * (1.0 - inside))


def describe_body(v: Values) -> Plugin:
    """The plugin of `body_f`."""
    if "body_eta" not in v:
        return {"type": "diffuse", "reflectance": texture(v["rho"])}
    plugin = {"type": "plastic", "int_ior": float(v["body_eta"]), "ext_ior": 1.0}
    return plugin | {"diffuse_reflectance": texture(v["rho"]), "specular_reflectance": texture(0.0)}

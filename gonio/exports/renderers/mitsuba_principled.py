"""Mitsuba's plugins `principled` and `principledthin`: f as they compute it, without sheen and clearcoat."""

from collections.abc import Callable

import numpy as np

from gonio.exports.forms import Form, Number, Values
from gonio.exports.pairs import Pairs
from gonio.exports.renderers.lobes import column, dielectric, ggx_facets, schlick
from gonio.exports.renderers.mitsuba_plugins import Plugin, straight_facets, texture

LEAST_SPECULAR = 1e-3
"""Of `principled`, which drops the metal's lobe too where this is 0."""
LEAST_WIDTH = 1e-3
LUMINANCE = np.array([0.212671, 0.715160, 0.072169])
ZERO = np.zeros(())
COLOUR = Number("base_color", 0.0, 1.0, 0.5, coloured=True)
WIDTH = Number("alpha", LEAST_WIDTH, 1.0, 0.2, log=True, width=True)
GRAIN = Number("anisotropic", 0.0, 1.0, 0.5)


def principled(isotropic: bool) -> Form:
    """The plugin without its sheen and its clearcoat (which its code does not divide by the cosines)."""
    shares = {"metallic": 0.2, "spec_tint": 0.1, "flatness": 0.1}
    numbers = [COLOUR, WIDTH, Number("specular", LEAST_SPECULAR, 1.0, 0.5)]
    numbers += [Number(name, 0.0, 1.0, start) for name, start in shares.items()]
    numbers += [] if isotropic else [GRAIN]
    return Form("principled", tuple(numbers), _principled_f, _described("principled"), colours_mix=True)


def principled_thin(isotropic: bool) -> Form:
    """A sheet: facets that reflect, the same wider or narrower about the straight direction, and diffusers."""
    numbers = [COLOUR, WIDTH, Number("eta", 1.0, 4.0, 1.5), Number("spec_trans", 0.0, 1.0, 0.5)]
    numbers += [Number("diff_trans", 0.0, 2.0, 1.0), Number("flatness", 0.0, 1.0, 0.1)]
    numbers += [] if isotropic else [GRAIN]
    return Form("principledthin", tuple(numbers), _thin_f, _described("principledthin"), transmits=True)


def _described(kind: str) -> Callable[[Values], Plugin]:
    def describe(v: Values) -> Plugin:
        colour = {"base_color": texture(v["base_color"]), "roughness": float(np.sqrt(v["alpha"]))}
        return {"type": kind, **colour} | {name: float(v[name]) for name in v if name not in ("base_color", "alpha")}

    return describe


def _widths(alpha: np.ndarray, v: Values) -> tuple[np.ndarray, np.ndarray]:
    aspect = np.sqrt(1.0 - 0.9 * v.get("anisotropic", ZERO))
    return np.maximum(alpha / aspect, LEAST_WIDTH), np.maximum(alpha * aspect, LEAST_WIDTH)


def _diffuse(v: Values, pairs: Pairs) -> np.ndarray:
    """The diffuse lobe with its retro-reflection, and what stands for subsurface scattering [Burley 2012, 2015]."""
    z_i, z_o, cos_d = column(pairs.wi.z), column(pairs.wo.z), pairs.cos_d
    f_i, f_o = ((1.0 - c) ** 5 for c in (z_i, z_o))
    flat = np.sqrt(v["alpha"]) * cos_d**2
    retro = (1.0 + (2.0 * flat - 0.5) * f_i) * (1.0 + (2.0 * flat - 0.5) * f_o)
    smooth = (1.0 + (flat - 1.0) * f_i) * (1.0 + (flat - 1.0) * f_o)
    flatter = 1.25 * (smooth * (1.0 / (z_i + z_o) - 0.5) + 0.5)
    return (retro + (flatter - retro) * v["flatness"]) * v["base_color"] / np.pi


def _principled_f(v: Values, pairs: Pairs) -> np.ndarray:
    """As the plugin computes it [Burley 2012, with exact Fresnel reflection]."""
    base, metallic, cos_d = v["base_color"], v["metallic"], pairs.cos_d
    f0 = 0.08 * float(v["specular"])
    luminance = float(np.sum(LUMINANCE * base)) if base.size == 3 else float(base[0])
    tint = base / luminance if luminance > 0 else np.ones(1)
    plain_f = dielectric(cos_d, np.asarray(2.0 / (1.0 - np.sqrt(f0)) - 1.0))
    tinted = plain_f + (schlick(cos_d, f0 * tint) - plain_f) * v["spec_tint"]
    fresnel = tinted + (schlick(cos_d, base) - tinted) * metallic
    facets = ggx_facets(pairs, *_widths(v["alpha"], v), "separable")
    return (1.0 - metallic) * _diffuse(v, pairs) + fresnel * facets


def _thin_f(v: Values, pairs: Pairs) -> np.ndarray:
    """As the plugin computes it: through the surface, facets of a roughness (0.65 η − 0.35) times as large."""
    lobe, through, eta = v["spec_trans"], 0.5 * v["diff_trans"], v["eta"]
    if np.all(pairs.wo.z > 0):
        facets = ggx_facets(pairs, *_widths(v["alpha"], v), "separable")
        return lobe * dielectric(pairs.cos_d, eta) * facets + (1.0 - lobe) * (1.0 - through) * _diffuse(v, pairs)
    facets = straight_facets(pairs, *_widths((0.65 * eta - 0.35) ** 2 * v["alpha"], v))
    passed = lobe * (1.0 - dielectric(pairs.through().cos_d, eta)) * facets
    return v["base_color"] * (passed + (1.0 - lobe) * through / np.pi)

"""OpenPBR's surface, as MaterialX's own graph of `open_pbr_surface` 1.1.1 layers it.

The facets are those of the specification; MaterialX's shaders for graphics processors mask anisotropic ones by their
mean width.
"""

from typing import Any

import numpy as np

from gonio.exports.forms import THROUGH, Appearance, Form, Number, Values, weighed
from gonio.exports.pairs import Pairs
from gonio.exports.renderers.glass import glass
from gonio.exports.renderers.lobes import (
    column,
    dielectric,
    eon,
    f0_of,
    f82,
    ggx_albedos,
    ggx_facets,
    index_of,
)

COLOUR = Number("base_color", 0.0, 1.0, 0.5, coloured=True)
DIFFUSE_ROUGHNESS = Number("base_diffuse_roughness", 0.0, 1.0, 0.1)
TINT = Number("specular_color", 0.0, 1.0, 0.9, coloured=True)
IOR = Number("specular_ior", 1.01, 4.0, 1.5, log=True)
COAT = (
    Number("coat_weight", 0.0, 1.0, 0.7),
    Number("coat_alpha", 1e-4, 1.0, 0.1, log=True, width=True),
    Number("coat_ior", 1.01, 3.0, 1.5, log=True),
)


def forms(sought: Appearance) -> tuple[Form, ...]:
    """A dielectric over a diffuser, a metal, and both under a coat; glass."""
    if sought.interface:
        return (glass(_glass),)
    axes = ("alpha",) if sought.isotropic else ("alpha_x", "alpha_y")
    widths = tuple(Number(axis, 1e-4, 1.0, 0.2, log=True, width=True) for axis in axes)
    plastic = (COLOUR, DIFFUSE_ROUGHNESS, *widths, IOR, Number("specular_weight", 0.0, 4.0, 1.0))
    metal = (COLOUR, TINT, *widths, Number("specular_weight", 0.0, 1.0, 1.0))
    mixed = (*plastic[:-1], TINT, Number("base_metalness", 0.0, 1.0, 0.5))
    bases = {"dielectric": plastic, "metal": metal, "dielectric and metal": mixed}
    if sought.transmits:
        sheets = {name: (*bases[name], THROUGH) for name in ("dielectric", "dielectric and metal")}
        return tuple(
            Form(f"{name}, thin-walled, with subsurface transmission", numbers, surface, description, True, True)
            for name, numbers in sheets.items()
        )
    every = [Form(name, numbers, surface, description) for name, numbers in bases.items()]
    if sought.isotropic:
        every += [Form(f"{name} under a coat", (*bases[name], *COAT), surface, description) for name in bases]
    return tuple(every)


def surface(v: Values, pairs: Pairs) -> np.ndarray:
    """f of the graph; wo is the view."""
    coat, coat_ior = float(v.get("coat_weight", 0.0)), float(v.get("coat_ior", 1.6))
    alphas = _widths(v, coat)
    base = _base(v, pairs, alphas, _index_below(v, coat, coat_ior))
    if not coat:
        return base
    ebase = v["base_color"] * (float(v.get("specular_weight", 1.0)) if _metalness(v) == 1 else 1.0)
    inside = 1.0 - (1.0 - f0_of(coat_ior)) / coat_ior**2
    darkening = 1.0 + coat * ((1.0 - inside) / (1.0 - ebase * inside) - 1.0)
    reflected, passed = _dielectric(pairs, (v["coat_alpha"], v["coat_alpha"]), coat_ior)
    return coat * reflected + (1.0 - coat * (1.0 - passed)) * darkening * base


def _metalness(v: Values) -> float:
    return float(v.get("base_metalness", 0.0 if "specular_ior" in v else 1.0))


def _widths(v: Values, coat: float) -> tuple[Any, Any]:
    """Widths of the base, which a rough coat widens."""
    if "alpha" not in v:
        return v["alpha_x"], v["alpha_y"]
    if not coat:
        return v["alpha"], v["alpha"]
    widened = min(1.0, 2.0 * float(v["coat_alpha"]) ** 2 + float(v["alpha"]) ** 2) ** 0.25
    root = (1.0 - coat) * np.sqrt(v["alpha"]) + coat * widened
    return root**2, root**2


def _index_below(v: Values, coat: float, coat_ior: float) -> float:
    """Index of the dielectric base, relative to the coat over it, with the weight of its reflection in it."""
    ior = float(v.get("specular_ior", 1.5))
    relative = max(ior / coat_ior, coat_ior / ior)
    eta = (1.0 - coat) * ior + coat * relative
    return float(index_of(min(float(v.get("specular_weight", 1.0)) * f0_of(eta), 0.99999)))


def _base(v: Values, pairs: Pairs, alphas: tuple[Any, Any], eta: float) -> np.ndarray:
    metalness, f = _metalness(v), np.zeros((pairs.wi.z.size, 1))
    through = v.get("through", np.zeros(()))
    if np.any(pairs.wo.z < 0):
        passed = _dielectric(pairs.through(), alphas, eta)[1]
        return (1.0 - metalness) * passed * through / np.pi
    if metalness > 0:
        reflected = _compensated(pairs, alphas, f82(pairs.cos_d, v["base_color"], v["specular_color"]))
        f = f + metalness * float(v.get("specular_weight", 1.0)) * reflected
    if metalness < 1:
        reflected, passed = _dielectric(pairs, alphas, eta)
        tint = v.get("specular_color", np.ones(1))
        below = (1.0 - weighed(through)[0]) * eon(pairs, v["base_color"], v["base_diffuse_roughness"])
        f = f + (1.0 - metalness) * (tint * reflected + passed * below)
    return f


def _compensated(pairs: Pairs, alphas: tuple[Any, Any], fresnel: np.ndarray) -> np.ndarray:
    """Facets with what bounces more than once given back by 1 + F(1 − E)/E at the view [Turquin 2019]."""
    white = column(ggx_albedos(pairs.wo.z, float(np.sqrt(alphas[0] * alphas[1])))[0])
    return ggx_facets(pairs, *alphas) * fresnel * (1.0 + fresnel * (1.0 - white) / white)


def _dielectric(pairs: Pairs, alphas: tuple[Any, Any], eta: float) -> tuple[np.ndarray, np.ndarray]:
    """(f of the interface, what it leaves to the layer below)."""
    fresnel = dielectric(pairs.cos_d, np.asarray(eta))
    white, grazing = (column(e) for e in ggx_albedos(pairs.wo.z, float(np.sqrt(alphas[0] * alphas[1]))))
    gain = 1.0 + fresnel * (1.0 - white) / white
    albedo = (f0_of(eta) * (white - grazing) + grazing) * gain
    return ggx_facets(pairs, *alphas) * fresnel * gain, 1.0 - albedo


def _glass(v: Values) -> dict[str, Any]:
    rough = {"specular_ior": float(v["eta"]), "specular_roughness": float(np.sqrt(v["alpha"]))}
    return {"base_metalness": 0.0, "transmission_weight": 1.0, **rough}


def anisotropy(alpha_x: float, alpha_y: float) -> tuple[float, float]:
    """(roughness, anisotropy) of widths with α_x ≥ α_y: α_x = r²√(2/(1 + (1 − a)²)), α_y = (1 − a) α_x."""
    ratio = alpha_y / alpha_x
    return float(np.sqrt(alpha_x * np.sqrt(0.5 * (1.0 + ratio**2)))), 1.0 - ratio


def description(v: Values) -> dict[str, Any]:
    """Inputs of `open_pbr_surface`; `turned` where the wide axis is y."""
    inputs: dict[str, Any] = {"base_metalness": _metalness(v)}
    for name in ("base_color", "specular_color"):
        if name in v:
            inputs[name] = np.broadcast_to(v[name], (3,)).tolist()
    for name in ("base_diffuse_roughness", "specular_ior", "specular_weight", "coat_weight", "coat_ior"):
        if name in v:
            inputs[name] = float(v[name])
    if "through" in v:
        inputs |= _subsurface(v["through"])
    if "coat_alpha" in v:
        inputs["coat_roughness"] = float(np.sqrt(v["coat_alpha"]))
    if "alpha" in v:
        return inputs | {"specular_roughness": float(np.sqrt(v["alpha"]))}
    wide, narrow = sorted((float(v["alpha_x"]), float(v["alpha_y"])), reverse=True)
    roughness, aspect = anisotropy(wide, narrow)
    turned = float(v["alpha_y"]) > float(v["alpha_x"])
    return inputs | {"specular_roughness": roughness, "specular_roughness_anisotropy": aspect, "turned": turned}


def _subsurface(through: np.ndarray) -> dict[str, Any]:
    """Of a thin-walled surface: all of it scattered forwards.

    MaterialX's graph multiplies by the colour twice, where the specification does so once; of a grey it is white.
    """
    weight, colour = weighed(through)
    inputs = {"geometry_thin_walled": True, "subsurface_scatter_anisotropy": 1.0, "subsurface_weight": weight}
    return inputs | {"subsurface_color": np.broadcast_to(np.sqrt(colour), (3,)).tolist()}

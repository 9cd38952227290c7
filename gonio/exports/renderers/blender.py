"""Blender's Principled BSDF (from 4.0 on) as Cycles computes it, and a Translucent BSDF for what goes through."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.exports.forms import Appearance, Form, Number, Values, diffusing, fixed
from gonio.exports.pairs import Pairs
from gonio.exports.renderers.glass import glass
from gonio.exports.renderers.lobes import (
    column,
    dielectric,
    dielectric_average,
    dielectric_share,
    eon,
    f0_of,
    f82,
    f82_average,
    ggx_albedos,
    ggx_average,
    ggx_facets,
)

COLOUR = Number("base_color", 0.0, 1.0, 0.5, coloured=True)
DIFFUSE_ROUGHNESS = Number("diffuse_roughness", 0.0, 1.0, 0.1)
TINT = Number("specular_tint", 0.0, 1.0, 0.9, coloured=True)
WIDTH = Number("alpha", 1e-4, 1.0, 0.2, log=True, width=True)
ASPECT = Number("anisotropic", 0.0, 1.0, 0.6)
IOR = Number("ior", 1.0, 4.0, 1.5)
COAT = (
    Number("coat_weight", 0.0, 1.0, 0.7),
    Number("coat_alpha", 1e-4, 1.0, 0.1, log=True, width=True),
    Number("coat_ior", 1.0, 3.0, 1.5),
)
TRANSLUCENT = "Translucent"
"""Among the sockets of a description: the colour of a Translucent BSDF that is added."""
WIDE = 0.25
"""Width of lobes from which on it shows whether what bounces between facets is lost."""
DISTRIBUTION = "distribution"
ONCE = "a rough interface (distribution GGX)"
"""What bounces between facets is lost."""
"""Among the sockets of a description: the property of the node."""
SOCKETS = {
    "base_color": "Base Color", "diffuse_roughness": "Diffuse Roughness", "specular_tint": "Specular Tint",
    "anisotropic": "Anisotropic", "ior": "IOR", "metallic": "Metallic", "coat_weight": "Coat Weight",
    "coat_ior": "Coat IOR",
}  # fmt: skip


def forms(sought: Appearance) -> tuple[Form, ...]:
    """A dielectric over a diffuser, a metal, and both under a coat; glass."""
    if sought.interface:
        single = dataclasses.replace(glass(lambda v: _glass(v) | {DISTRIBUTION: "GGX"}), name=ONCE)
        return (glass(_glass, whole=True), single)
    wide = not sought.widths_known or sought.widths[-1:] > [WIDE]
    turns = (False,) if sought.isotropic else (False, True)
    smooth = {"alpha": 1.0, "ior": 1.0, "diffuse_roughness": 0.0}
    every = [fixed(_form("diffuse", (COLOUR, WIDTH, IOR, DIFFUSE_ROUGHNESS), False), "diffuse", smooth)]
    for turned in turns:
        shape = (WIDTH,) if sought.isotropic else (WIDTH, ASPECT)
        bases = {
            "dielectric": (COLOUR, DIFFUSE_ROUGHNESS, *shape, IOR),
            "metal": (COLOUR, TINT, *shape),
            "dielectric and metal": (
                COLOUR, DIFFUSE_ROUGHNESS, TINT, *shape, IOR, Number("metallic", 0.0, 1.0, 0.5)
            ),
        }  # fmt: skip
        for name, numbers in bases.items():
            every.append(_form(name, numbers, turned))
            if wide:
                every.append(_form(f"{name} (distribution GGX)", numbers, turned, single=True))
        if sought.isotropic:
            every += [_form(f"{name} under a coat", (*bases[name], *COAT), False) for name in bases]
    if sought.transmits:
        return tuple(diffusing(form, _diffusing(form)) for form in every)
    return tuple(every)


def _diffusing(form: Form) -> Callable[[Values], dict[str, Any]]:
    return lambda v: form.describe(v) | {TRANSLUCENT: [*np.broadcast_to(v["through"], (3,)).tolist(), 1.0]}


def _form(name: str, numbers: tuple[Number, ...], turned: bool, single: bool = False) -> Form:
    def f(v: Values, pairs: Pairs) -> np.ndarray:
        return surface(v, pairs, turned, single)

    return Form(name, numbers, f, lambda v: description(v, turned, single))


def surface(v: Values, pairs: Pairs, turned: bool = False, single: bool = False) -> np.ndarray:
    """f of the node; wo is the view.

    Args:
        v: the numbers.
        pairs: of directions, in front.
        turned: whether the wide axis is y.
        single: whether what bounces between facets is lost, but for the coat: the node's distribution is "GGX".
    """
    f, throughput = np.zeros((pairs.wi.z.size, 1)), np.ones(1)
    if "coat_weight" in v:
        reflected, albedo = _dielectric(pairs, (v["coat_alpha"], v["coat_alpha"]), float(v["coat_ior"]), np.ones(1))
        f, throughput = v["coat_weight"] * reflected, 1.0 - v["coat_weight"] * albedo.max(axis=1, keepdims=True)
    aspect = np.sqrt(1.0 - 0.9 * v.get("anisotropic", 0.0))
    wide, narrow = min(v["alpha"] / aspect, 1.0), v["alpha"] * aspect
    alphas = (narrow, wide) if turned else (wide, narrow)
    metallic = float(v.get("metallic", 0.0 if "ior" in v else 1.0))
    tint = v.get("specular_tint", np.ones(1))
    if metallic > 0:
        average = f82_average(v["base_color"], tint)
        metal = f82(pairs.cos_d, v["base_color"], tint) * ggx_facets(pairs, *alphas)
        metal = metal * (1.0 if single else _gain(pairs, alphas, average))
        f = f + throughput * metallic * metal
    if metallic < 1:
        throughput = throughput * (1.0 - metallic)
        reflected, albedo = _dielectric(pairs, alphas, float(v["ior"]), tint, single)
        below = throughput * (1.0 - albedo.max(axis=1, keepdims=True))
        # Cycles has the colour once more in what the diffuser scatters more than once
        f = f + throughput * reflected + below * eon(pairs, v["base_color"], v["diffuse_roughness"], v["base_color"])
    return f


def _gain(pairs: Pairs, alphas: tuple[Any, Any], average: Any) -> np.ndarray:
    """What bounces more than once given back, at the view; `average`: of the Fresnel factor [Kulla & Conty 2017]."""
    alpha = float(np.sqrt(alphas[0] * alphas[1]))
    white, white_average = column(ggx_albedos(pairs.wo.z, alpha)[0]), ggx_average(alpha)
    several = average * white_average / (1.0 - average * (1.0 - white_average))
    return 1.0 + several * (1.0 - white) / white


def _dielectric(
    pairs: Pairs, alphas: tuple[Any, Any], eta: float, tint: np.ndarray, single: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """(f of the interface, its albedo at the view); a tint multiplies the reflectance at normal incidence alone."""
    f0 = f0_of(eta)
    if eta <= 1.0 + 1e-9:
        return np.zeros((pairs.wi.z.size, 1)), np.zeros((pairs.wi.z.size, 1))

    def tinted(real: Any) -> np.ndarray:
        return f0 * tint + (1.0 - f0 * tint) * (real - f0) / (1.0 - f0)

    gain = np.ones(1) if single else _gain(pairs, alphas, tinted(dielectric_average(np.asarray(eta))))
    alpha = float(np.sqrt(alphas[0] * alphas[1]))
    darkening = gain * column(ggx_albedos(pairs.wo.z, alpha)[0])
    albedo = tinted(column(dielectric_share(pairs.wo.z, alpha, eta))) * darkening
    return tinted(dielectric(pairs.cos_d, np.asarray(eta))) * ggx_facets(pairs, *alphas) * gain, albedo


def _glass(v: Values) -> dict[str, Any]:
    rough = {"Roughness": float(np.sqrt(v["alpha"])), "IOR": float(v["eta"])}
    return {"Metallic": 0.0, "Base Color": [1.0] * 4, "Transmission Weight": 1.0, **rough}


def description(v: Values, turned: bool = False, single: bool = False) -> dict[str, Any]:
    """Values of the node's sockets, by their names, and its distribution where that is not MULTI_GGX."""
    sockets: dict[str, Any] = {"Metallic": 0.0 if "ior" in v else 1.0, "Roughness": float(np.sqrt(v["alpha"]))}
    for name, value in v.items():
        if name in SOCKETS:
            colour = name in ("base_color", "specular_tint")
            sockets[SOCKETS[name]] = [*np.broadcast_to(value, (3,)).tolist(), 1.0] if colour else float(value)
    if "coat_alpha" in v:
        sockets["Coat Roughness"] = float(np.sqrt(v["coat_alpha"]))
    sockets |= {DISTRIBUTION: "GGX"} if single else {}
    return sockets | ({"Anisotropic Rotation": 0.25} if turned else {})

"""glTF 2.0's material, as its appendix B and the KHR extensions ior, specular, anisotropy, clearcoat, transmission
(with volume, for an interface; without, for a sheet) and diffuse_transmission say it."""

from typing import Any

import numpy as np

from gonio.exports.forms import THROUGH, Appearance, Form, Number, Values, fixed, weighed
from gonio.exports.pairs import Pairs
from gonio.exports.renderers.glass import glass
from gonio.exports.renderers.lobes import column, f0_of, ggx_facets, schlick

COLOUR = Number("base_color", 0.0, 1.0, 0.5, coloured=True)
WIDTH = Number("alpha", 1e-4, 1.0, 0.2, log=True, width=True)
STRENGTH = Number("anisotropy", 0.0, 1.0, 0.5)
SPECULAR = (Number("ior", 1.0, 4.0, 1.5), Number("specular", 0.0, 1.0, 0.9))
TINT = Number("specular_color", 0.0, 4.0, 1.0, coloured=True)
COAT = (Number("clearcoat", 0.0, 1.0, 0.7), Number("coat_alpha", 1e-4, 1.0, 0.1, log=True, width=True))
COAT_F0 = 0.04
ZERO = np.zeros(())
PASSED = Number("transmission", 0.0, 1.0, 0.5)


def forms(sought: Appearance) -> tuple[Form, ...]:
    """A dielectric over a diffuser, a metal, both mixed, and under a clear coat; glass."""
    if sought.interface:
        return (glass(_glass, "separable", lambda cos_d, eta: schlick(cos_d, f0_of(eta))),)
    lambert = {"alpha": 1.0, "ior": 1.5, "specular": 0.0}
    diffuse = (COLOUR, WIDTH, *SPECULAR, *((THROUGH,) if sought.transmits else ()))
    name = "diffusers on both sides" if sought.transmits else "diffuse"
    every = [fixed(_form(name, diffuse, False), name, lambert)]
    for turned in (False,) if sought.isotropic else (False, True):
        shape = (WIDTH,) if sought.isotropic else (WIDTH, STRENGTH)
        bases = {
            "dielectric": (COLOUR, *shape, *SPECULAR),
            "metal": (COLOUR, *shape),
            "dielectric and metal": (COLOUR, *shape, *SPECULAR, TINT, Number("metallic", 0.0, 1.0, 0.5)),
        }
        if sought.transmits:
            every += _sheets(bases["dielectric"], turned)
            continue
        every += [_form(name, numbers, turned) for name, numbers in bases.items()]
        if sought.isotropic:
            every += [_form(f"{name} under a clear coat", (*bases[name], *COAT), False) for name in bases]
    return tuple(every)


def _form(name: str, numbers: tuple[Number, ...], turned: bool) -> Form:
    def f(v: Values, pairs: Pairs) -> np.ndarray:
        return surface(v, pairs, turned)

    names = {n.name for n in numbers}
    mixes, through = bool(names & {TINT.name, THROUGH.name}), bool(names & {PASSED.name, THROUGH.name})
    return Form(name, numbers, f, lambda v: description(v, turned), colours_mix=mixes, transmits=through)


def _sheets(dielectric: tuple[Number, ...], turned: bool) -> list[Form]:
    """A dielectric over diffusers on both sides, over facets that transmit, and over both."""
    ways: dict[str, tuple[Number, ...]] = {
        "diffuse transmission": (THROUGH,),
        "rough transmission": (PASSED,),
        "diffuse and rough transmission": (THROUGH, PASSED),
    }
    return [_form(f"dielectric with {way}", (*dielectric, *numbers), turned) for way, numbers in ways.items()]


def surface(v: Values, pairs: Pairs, turned: bool = False) -> np.ndarray:
    """f of the material; wo is the view. `turned`: the wide axis is y."""
    if np.any(pairs.wo.z < 0):
        return _behind(v, pairs, turned)
    specular = _specular(v, pairs, turned)
    metallic = float(v.get("metallic", 0.0 if "ior" in v else 1.0))
    f = metallic * specular * schlick(pairs.cos_d, v["base_color"])
    if metallic < 1:
        fresnel, throughput = _interface(v, pairs)
        kept = (1.0 - weighed(v.get("through", ZERO))[0]) * (1.0 - v.get("transmission", 0.0))
        f = f + (1.0 - metallic) * (fresnel * specular + throughput * kept * v["base_color"] / np.pi)
    if "clearcoat" not in v:
        return f
    coat = v["clearcoat"] * schlick(column(pairs.wo.z), COAT_F0)
    return (1.0 - coat) * f + coat * ggx_facets(pairs, v["coat_alpha"], v["coat_alpha"], "separable")


def _interface(v: Values, pairs: Pairs) -> tuple[np.ndarray, np.ndarray]:
    """(what the dielectric's facets reflect, what they leave to all below)."""
    f0 = np.minimum(f0_of(v["ior"]) * v.get("specular_color", np.ones(1)), 1.0) * v["specular"]
    fresnel = schlick(pairs.cos_d, f0, v["specular"])
    return fresnel, 1.0 - fresnel.max(axis=1, keepdims=True)


def _behind(v: Values, pairs: Pairs, turned: bool) -> np.ndarray:
    """Light through a sheet: of a diffuser, and of the same facets about the straight direction, in the base's colour.

    With both, the facets' share is of all, and the diffuser's of the rest.
    """
    mirrored, passed = pairs.through(), v.get("transmission", 0.0)
    spread = v.get("through", ZERO) * np.ones((pairs.wo.z.size, 1)) / np.pi
    lobe = v["base_color"] * _specular(v, mirrored, turned) if "transmission" in v else 0.0
    return _interface(v, mirrored)[1] * (passed * lobe + (1.0 - passed) * spread)


def _specular(v: Values, pairs: Pairs, turned: bool) -> np.ndarray:
    """The masking is separable in the appendix, and correlated in the extension for anisotropy."""
    alpha = v["alpha"]
    if "anisotropy" not in v:
        return ggx_facets(pairs, alpha, alpha, "separable")
    wide = alpha + (1.0 - alpha) * v["anisotropy"] ** 2
    return ggx_facets(pairs, *((alpha, wide) if turned else (wide, alpha)))


def _glass(v: Values) -> dict[str, Any]:
    extensions = {
        "KHR_materials_ior": {"ior": float(v["eta"])},
        "KHR_materials_transmission": {"transmissionFactor": 1.0},
        "KHR_materials_volume": {"thicknessFactor": 2.0},
    }
    rough = {"baseColorFactor": [1.0] * 4, "metallicFactor": 0.0, "roughnessFactor": float(np.sqrt(v["alpha"]))}
    return {"pbrMetallicRoughness": rough, "extensions": extensions}


def description(v: Values, turned: bool = False) -> dict[str, Any]:
    """The material as JSON."""
    metallic = float(v.get("metallic", 0.0 if "ior" in v else 1.0))
    extensions: dict[str, Any] = {}
    if "ior" in v:
        extensions["KHR_materials_ior"] = {"ior": float(v["ior"])}
        extensions["KHR_materials_specular"] = {"specularFactor": float(v["specular"])}
        if "specular_color" in v:
            tint = np.broadcast_to(v["specular_color"], (3,)).tolist()
            extensions["KHR_materials_specular"]["specularColorFactor"] = tint
    if "anisotropy" in v:
        rotation = {"anisotropyRotation": float(np.pi / 2)} if turned else {}
        extensions["KHR_materials_anisotropy"] = {"anisotropyStrength": float(v["anisotropy"]), **rotation}
    if "transmission" in v:
        extensions["KHR_materials_transmission"] = {"transmissionFactor": float(v["transmission"])}
    if "through" in v:
        weight, tint = weighed(v["through"])
        extensions["KHR_materials_diffuse_transmission"] = {
            "diffuseTransmissionFactor": weight,
            "diffuseTransmissionColorFactor": np.broadcast_to(tint, (3,)).tolist(),
        }
    if "clearcoat" in v:
        extensions["KHR_materials_clearcoat"] = {
            "clearcoatFactor": float(v["clearcoat"]), "clearcoatRoughnessFactor": float(np.sqrt(v["coat_alpha"])),
        }  # fmt: skip
    thin = {"doubleSided": True} if "through" in v or "transmission" in v else {}
    return thin | {
        "pbrMetallicRoughness": {
            "baseColorFactor": [*np.broadcast_to(v["base_color"], (3,)).tolist(), 1.0],
            "metallicFactor": metallic,
            "roughnessFactor": float(np.sqrt(v["alpha"])),
        },
        "extensions": extensions,
    }

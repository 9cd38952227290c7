"""What files of `gonio convert --to` say, read back by other code than wrote them: f of each at pairs of directions.

Mitsuba evaluates its files itself. No other renderer is installed: their files are parsed by the clients' own libraries
or from the text, and their numbers go through the formulas that `gonio.exports` has of each renderer.
"""

import json
import pathlib
import re
from collections.abc import Callable
from typing import Any

import MaterialX
import mitsuba as mi
import numpy as np

from gonio.exports.pairs import Pairs
from gonio.exports.renderers import blender, gltf, openpbr
from gonio.exports.renderers.glass import glass
from gonio.exports.renderers.lobes import conductor, dielectric, f0_of, ggx_facets, schlick
from gonio.exports.renderers.pbrt import under_coat
from support.mitsuba_client import f_cosine

F = Callable[[Pairs], np.ndarray]
"""f, (n, 1 or 3), of pairs on one side."""
mi.set_variant("scalar_rgb")


def client_f(bsdf: Any, pairs: Pairs) -> np.ndarray:
    """f (n, 3) of a BSDF of Mitsuba's."""
    return f_cosine(bsdf, pairs.wi, pairs.wo) / np.abs(pairs.wo.z[:, None])


def _behind(pairs: Pairs) -> bool:
    return bool(pairs.wo.z[0] < 0)


def _nothing(pairs: Pairs) -> np.ndarray:
    return np.zeros((pairs.wo.z.size, 1))


def _interface(alpha: float, eta: float, renderer: str) -> F:
    form = glass(lambda values: None, whole=renderer == "blender")
    if renderer == "gltf":
        form = glass(lambda values: None, "separable", lambda cosine, index: schlick(cosine, f0_of(index)))
    return lambda pairs: form.f({"alpha": np.asarray(alpha), "eta": np.asarray(eta)}, pairs)


def read_mitsuba(path: pathlib.Path) -> F:
    """The renderer's own values; what passes an interface is seen over η² there."""
    bsdf = mi.load_file(str(path)).shapes()[0].bsdf()
    index = re.search(r'"roughdielectric".*?int_ior" value="([\d.]+)"', path.read_text(), re.S)
    eta = float(index[1]) if index else 1.0
    return lambda pairs: client_f(bsdf, pairs) * (eta**2 if _behind(pairs) else 1.0)


def read_gltf(path: pathlib.Path) -> F:
    """The material of a .gltf file."""
    material = json.loads(path.read_text())["materials"][0]
    plain, more = material["pbrMetallicRoughness"], material.get("extensions", {})
    more = {name.removeprefix("KHR_materials_"): {k: np.asarray(v) for k, v in e.items()} for name, e in more.items()}
    alpha, index = plain["roughnessFactor"] ** 2, more.get("ior", {}).get("ior", np.asarray(1.5))
    if "volume" in more:
        return _interface(alpha, float(index), "gltf")
    values = {"alpha": np.asarray(alpha), "base_color": np.asarray(plain["baseColorFactor"][:3])}
    if plain["metallicFactor"] < 1:
        s = more.get("specular", {})
        values |= {"ior": index, "metallic": np.asarray(plain["metallicFactor"])}
        values |= {"specular": s.get("specularFactor", np.asarray(1.0))}
        values |= {"specular_color": s.get("specularColorFactor", np.ones(3))}
    turned = "anisotropyRotation" in more.get("anisotropy", {})
    if "anisotropy" in more:
        values["anisotropy"] = more["anisotropy"]["anisotropyStrength"]
    if "clearcoat" in more:
        coat = more["clearcoat"]
        values |= {"clearcoat": coat["clearcoatFactor"], "coat_alpha": coat["clearcoatRoughnessFactor"] ** 2}
    if "transmission" in more:
        values["transmission"] = more["transmission"]["transmissionFactor"]
    if "diffuse_transmission" in more:
        through = more["diffuse_transmission"]
        values["through"] = through["diffuseTransmissionFactor"] * through["diffuseTransmissionColorFactor"]
    thin = bool({"transmission", "through"} & set(values))
    return lambda pairs: gltf.surface(values, pairs, turned) if thin or not _behind(pairs) else _nothing(pairs)


OF_OPENPBR = (
    "base_color", "base_diffuse_roughness", "specular_weight", "specular_ior", "specular_color", "coat_weight",
    "coat_ior", "base_metalness",
)  # fmt: skip


def read_materialx(path: pathlib.Path) -> F:
    """The open_pbr_surface of a .mtlx file, parsed by the materialx package."""
    document = MaterialX.createDocument()
    MaterialX.readFromXmlFile(document, str(path))
    surface = next(n for n in document.getNodes() if n.getCategory() == "open_pbr_surface")
    turned, given = False, dict[str, np.ndarray]()
    for entry in surface.getInputs():
        if entry.getName() == "geometry_tangent":
            turned = True
        else:
            value = entry.getValue()
            given[entry.getName()] = np.asarray(list(value.asTuple()) if hasattr(value, "asTuple") else value)
    if given.get("transmission_weight", 0) == 1:
        return _interface(float(given["specular_roughness"]) ** 2, float(given["specular_ior"]), "openpbr")
    values = {name: given[name] for name in OF_OPENPBR if name in given}
    if given.get("base_metalness", 0) == 1:
        values.pop("specular_ior", None)
    values = {"specular_color": np.ones(3), "base_diffuse_roughness": np.asarray(0.0)} | values
    if "coat_roughness" in given:
        values["coat_alpha"] = given["coat_roughness"] ** 2
    if "specular_roughness_anisotropy" in given:
        a = given["specular_roughness_anisotropy"]
        wide = given["specular_roughness"] ** 2 * np.sqrt(2 / (1 + (1 - a) ** 2))
        values["alpha_x"], values["alpha_y"] = ((1 - a) * wide, wide) if turned else (wide, (1 - a) * wide)
    else:
        values["alpha"] = given["specular_roughness"] ** 2
    thin = "subsurface_weight" in given
    if thin:  # its graph multiplies the colour twice
        values["through"] = given["subsurface_weight"] * given["subsurface_color"] ** 2
    return lambda pairs: openpbr.surface(values, pairs) if thin or not _behind(pairs) else _nothing(pairs)


def read_blender(path: pathlib.Path) -> F:
    """The sockets that a script sets: its constants are evaluated, its Blender part is not."""
    text, said = path.read_text(), dict[str, Any]()
    exec(text.split("import bpy", 1)[1].split("\ndef build", 1)[0], said)  # a script that gonio has just written
    sockets, through = said["SOCKETS"], said["TRANSLUCENT"]
    single = 'distribution = "GGX"' in text
    if sockets.get("Transmission Weight") == 1:
        return _interface(sockets["Roughness"] ** 2, sockets["IOR"], "one bounce" if single else "blender")
    values = {
        "alpha": sockets["Roughness"] ** 2, "base_color": sockets["Base Color"][:3], "metallic": sockets["Metallic"],
        "diffuse_roughness": sockets.get("Diffuse Roughness", 0.0), "ior": sockets.get("IOR", 1.5),
        "specular_tint": sockets.get("Specular Tint", [1, 1, 1, 1])[:3],
    }  # fmt: skip
    if "Anisotropic" in sockets:
        values["anisotropic"] = sockets["Anisotropic"]
    if "Coat Weight" in sockets:
        values |= {"coat_weight": sockets["Coat Weight"], "coat_alpha": sockets["Coat Roughness"] ** 2}
        values |= {"coat_ior": sockets["Coat IOR"]}
    values = {name: np.asarray(value) for name, value in values.items()}
    turned = "Anisotropic Rotation" in sockets
    behind = np.asarray(through[:3] if through else np.zeros(3)) / np.pi

    def f(pairs: Pairs) -> np.ndarray:
        return _nothing(pairs) + behind if _behind(pairs) else blender.surface(values, pairs, turned, single)

    return f


def read_pbrt(path: pathlib.Path) -> F:
    """The named materials of a scene, the last of which is used."""
    materials, last = dict[str, dict[str, Any]](), ""
    for line in path.read_text().splitlines():
        words = re.findall(r'"([^"]*)"', line)
        if line.startswith("MakeNamedMaterial"):
            current = materials[words[0]] = {"type": words[2]}
        elif line.startswith("NamedMaterial"):
            last = words[0]
        elif line.startswith("    ") and materials and not last:
            numbers = re.search(r"\[([^\]\"]*)\]", line)
            current[words[0]] = words[1:] if "string" in words[0] else np.array((numbers or [0, ""])[1].split(), float)
    return lambda pairs: _pbrt(materials, last, pairs)


def _pbrt(materials: dict[str, dict[str, Any]], name: str, pairs: Pairs) -> np.ndarray:
    m = materials[name]
    if m["type"] == "mix":
        one, other = (_pbrt(materials, part, pairs) for part in m["string materials"])
        return (1 - m["float amount"][0]) * one + m["float amount"][0] * other
    if m["type"] == "dielectric":
        return _interface(m["float uroughness"][0], m["float eta"][0], "pbrt")(pairs)
    if m["type"] == "diffusetransmission":
        return _nothing(pairs) + m["rgb transmittance" if _behind(pairs) else "rgb reflectance"] / np.pi
    if _behind(pairs):
        return _nothing(pairs)
    if m["type"] == "diffuse":
        return _nothing(pairs) + m["rgb reflectance"] / np.pi
    x, y = m["float uroughness"][0], m["float vroughness"][0]
    facets = ggx_facets(pairs, x, y)
    if m["type"] == "conductor":
        return facets * conductor(pairs.cos_d, m["rgb eta"], m["rgb k"])
    eta = m["float eta"][0]
    under = under_coat(pairs, m["rgb reflectance"], float(np.sqrt(x * y)), eta)
    return facets * dielectric(pairs.cos_d, eta) + under


READ: dict[str, tuple[Callable[[pathlib.Path], F], str]] = {
    "mitsuba": (read_mitsuba, ".xml"),
    "pbrt": (read_pbrt, ".pbrt"),
    "materialx": (read_materialx, ".mtlx"),
    "gltf": (read_gltf, ".gltf"),
    "blender": (read_blender, ".py"),
}
"""By the target: reads a file, and the file's ending."""

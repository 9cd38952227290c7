"""A Python script that builds the material in Blender, on a sphere."""

import json
import pprint
from typing import Any

from gonio.exports.about import About

SCRIPT = '''"""{comment}

Run it in Blender (Scripting > Run Script, or blender --python FILE): it makes the material {name!r} and puts it on the
selected meshes, or on a new sphere where none is selected.
"""

import bpy

NAME = {name!r}
SOCKETS = {sockets}
TRANSLUCENT = {translucent}  # light through the surface, spread evenly; the sum of both nodes is the surface


def build():
    material = bpy.data.materials.new(NAME)
    if material.node_tree is None:
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    node = nodes.new("ShaderNodeBsdfPrincipled")
    node.location = (-300, 0)
    node.distribution = "{distribution}"
    for name, value in SOCKETS.items():
        if name in node.inputs:  # Blender before 4.3 has no diffuse roughness
            node.inputs[name].default_value = value
    if "Anisotropic" in SOCKETS:
        tangent = nodes.new("ShaderNodeTangent")
        tangent.location = (-550, -200)  # along the parallels about z; direction_type = "UV_MAP" follows u
        links.new(tangent.outputs["Tangent"], node.inputs["Tangent"])
    surface = node.outputs["BSDF"]
    if TRANSLUCENT:
        behind, both = nodes.new("ShaderNodeBsdfTranslucent"), nodes.new("ShaderNodeAddShader")
        behind.inputs["Color"].default_value = TRANSLUCENT
        behind.location, both.location = (-300, 200), (-50, 100)
        links.new(surface, both.inputs[0])
        links.new(behind.outputs["BSDF"], both.inputs[1])
        surface = both.outputs["Shader"]
    links.new(surface, output.inputs["Surface"])
    for key, value in {facts}.items():
        material["gonio " + key] = value
    return material


def put_on(material):
    meshes = [o for o in bpy.context.selected_objects if o.type == "MESH"]
    if not meshes:
        bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32)
        bpy.ops.object.shade_smooth()
        meshes = [bpy.context.object]
    for mesh in meshes:
        mesh.data.materials.clear()
        mesh.data.materials.append(material)


if __name__ == "__main__":
    put_on(build())
'''


def blender_file(description: dict[str, Any], about: About, suffix: str) -> bytes:
    """The text of the script; what comes from a user's file stands in it as literals only."""
    comment = "\n".join(about.lines).replace("\\", "/").replace('"""', "'''").rstrip('"')
    facts = {k: v if isinstance(v, str) else json.dumps(v) for k, v in about.facts.items()}
    sockets = {k: v for k, v in description.items() if k != "distribution"}
    rounded = {k: [round(x, 8) for x in v] if isinstance(v, list) else round(v, 8) for k, v in sockets.items()}
    translucent = rounded.pop("Translucent", None)
    sockets = pprint.pformat(rounded, width=100, sort_dicts=False)
    texts = {"comment": comment, "name": about.name, "sockets": sockets, "translucent": translucent}
    texts["distribution"] = description.get("distribution", "MULTI_GGX")
    return SCRIPT.format(**texts, facts=repr(facts)).encode()

"""The files as their readers take them: MaterialX's validator, a reader of glTF, Blender's script, pbrt's syntax."""

import ast
import re
import types
from pathlib import Path

import MaterialX
import numpy as np
import pygltflib
import pytest

import gonio
from gonio.exports.about import about
from gonio.exports.forms import Form, appearance_of
from gonio.exports.nearest import nearest
from gonio.exports.reexpression import ReExpression, reexpression
from gonio.exports.renderers import blender, gltf, openpbr, pbrt
from gonio.exports.renderers.blender_file import blender_file
from gonio.exports.renderers.gltf_file import gltf_file
from gonio.exports.renderers.materialx_file import materialx_file
from gonio.exports.renderers.pbrt_file import pbrt_file
from gonio.exports.targets import TARGETS

HOSTILE = 'a -- b """ \' \\ --> ]]> & < {0} %s \x1b[31m\nnew line'
SOUGHT = (
    "0.3 * phong(n=40)",
    "ward(alpha_x=0.1, alpha_y=0.4)",
    "rough_dielectric(alpha=0.2, eta=1.5)",
    "thin_sheet(rho=0.3, tau=0.2)",
)


WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
DIRECTIVES = "Scale LookAt Camera Film Sampler Integrator WorldBegin LightSource MakeNamedMaterial NamedMaterial Shape"


def numbers_of(form: Form) -> dict[str, np.ndarray]:
    """Some numbers within the domains."""
    return {n.name: np.full((3,) if n.coloured else (), n.low + 0.4 * (min(n.high, 2.0) - n.low)) for n in form.numbers}


def every_file(module, file, suffix: str, name: str = "plain"):
    """(what a form says, its file) of each form of a renderer, for surfaces of several kinds."""
    for sought in SOUGHT:
        material = gonio.Material(name, gonio.material(sought).brdf, sought, gonio.material(sought).channels)
        error = ReExpression("a renderer", "a form", 0.1, 0.1, 1.0, 2.0, False, (name,))
        for form in module.forms(appearance_of(material)):
            described = form.describe(numbers_of(form))
            yield described, file(described, about(material, error), suffix)


def test_materialx_validates_every_form(tmp_path):
    library = MaterialX.createDocument()
    folders, search = MaterialX.getDefaultDataLibraryFolders(), MaterialX.getDefaultDataSearchPath()
    MaterialX.loadLibraries(folders, search, library)
    for name in ("plain", HOSTILE):
        for described, text in every_file(openpbr, materialx_file, ".mtlx", name):
            document = MaterialX.createDocument()
            MaterialX.readFromXmlString(document, text.decode())
            document.setDataLibrary(library)
            valid, message = document.validate()
            assert valid, message
            (material,) = document.getMaterialNodes()
            (shader,) = MaterialX.getShaderNodes(material)
            assert shader.getNodeDef().getName() == "ND_open_pbr_surface_surfaceshader"
            known = {i.getName() for i in shader.getNodeDef().getInputs()}
            assert {i.getName() for i in shader.getInputs()} <= known
            assert np.isclose(shader.getInputValue("specular_roughness"), described["specular_roughness"])


@pytest.mark.parametrize("suffix", [".gltf", ".glb"])
def test_a_reader_of_gltf_finds_the_material_on_a_sphere(tmp_path, suffix):
    path = tmp_path / f"sphere{suffix}"
    for described, content in every_file(gltf, gltf_file, suffix, HOSTILE):
        path.write_bytes(content)
        read = pygltflib.GLTF2().load(str(path))
        (material,) = read.materials
        rough = described["pbrMetallicRoughness"]
        assert material.pbrMetallicRoughness.baseColorFactor == rough["baseColorFactor"]
        assert material.pbrMetallicRoughness.roughnessFactor == rough["roughnessFactor"]
        assert material.extensions == described["extensions"]
        assert set(described["extensions"]) == set(read.extensionsUsed)
        assert material.extras["gonio"]["error of this expression"].startswith("rms 10 %")
    data = read.binary_blob() or read.get_data_from_buffer_uri(read.buffers[0].uri)
    points, normals, tangents, _, corners = (
        np.frombuffer(data, "<u2" if a.componentType == 5123 else "<f4", a.count * WIDTHS[a.type], v.byteOffset)
        for a, v in zip(read.accessors, read.bufferViews, strict=True)
    )  # fmt: skip
    points, normals, tangents = points.reshape(-1, 3), normals.reshape(-1, 3), tangents.reshape(-1, 4)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, rtol=1e-6)
    np.testing.assert_allclose(np.sum(normals * tangents[:, :3], axis=1), 0, atol=1e-6)
    a, b, c = (points[corners.reshape(-1, 3)[:, k]] for k in range(3))
    outwards = np.sum(np.cross(b - a, c - a) * (a + b + c), axis=1)
    assert np.all(outwards > -1e-9)


class Node(types.SimpleNamespace):
    """What the script does with a node of Blender's."""


def run_in_blender(script: str) -> dict:
    """The values of the sockets that a script sets, with a stand-in for Blender that has the sockets of 5.0."""
    sockets = [*blender.SOCKETS.values(), "Roughness", "Anisotropic Rotation", "Coat Roughness", "Tangent"]
    inputs = {name: Node(default_value=None) for name in (*sockets, "Transmission Weight")}
    made, properties = Node(inputs=inputs, outputs={"BSDF": 0}, location=None, distribution=None), {}
    tangent = Node(outputs={"Tangent": 0}, location=None)
    output = Node(inputs={"Surface": 0})
    behind = Node(inputs={"Color": Node(default_value=None)}, outputs={"BSDF": 0}, location=None)
    both = Node(inputs=[0, 1], outputs={"Shader": 0}, location=None)
    kinds = {"ShaderNodeBsdfPrincipled": made, "ShaderNodeTangent": tangent, "ShaderNodeOutputMaterial": output}
    kinds |= {"ShaderNodeBsdfTranslucent": behind, "ShaderNodeAddShader": both}

    class Material(dict):
        node_tree = Node(nodes=Node(clear=lambda: None, new=kinds.get), links=Node(new=lambda a, b: None))

    bpy = types.ModuleType("bpy")
    bpy.data = Node(materials=Node(new=lambda name: Material()))
    space = {"__name__": "script"}
    exec(compile(script.replace("import bpy\n", ""), "script", "exec"), space | {"bpy": bpy}, properties)
    scope = space | {"bpy": bpy} | properties
    material = types.FunctionType(properties["build"].__code__, scope)()
    assert material["gonio error of this expression"].startswith("rms 10 %")
    inputs = inputs | {blender.TRANSLUCENT: behind.inputs["Color"]}
    if made.distribution == "GGX":
        inputs[blender.DISTRIBUTION] = Node(default_value="GGX")
    return {name: i.default_value for name, i in inputs.items() if i.default_value is not None}


def test_blenders_script_sets_the_sockets_and_runs_no_text_of_a_file():
    for name in ("plain", HOSTILE):
        for described, script in every_file(blender, blender_file, ".py", name):
            text = script.decode()
            imported = [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Import | ast.ImportFrom)]
            assert [a.name for n in imported for a in n.names] == ["bpy"]
            expected = {k: v if isinstance(v, str) else pytest.approx(v) for k, v in described.items()}
            assert run_in_blender(text) == expected


PARAMETER = re.compile(r'"(rgb|float|integer|bool|string) ([a-z.]+)" (\[ [^\]]* \]|true|false|\d+|"[^"]*")')


def test_pbrt_scenes_have_pbrts_syntax():
    """Directives, and parameters of a type, a name and values; what follows # is no directive."""
    for described, content in every_file(pbrt, pbrt_file, ".pbrt", HOSTILE):
        text = content.decode()
        lines = [line for line in text.splitlines() if not line.startswith("#")]
        directives = [line.split()[0] for line in lines if line and not line.startswith(" ")]
        assert set(directives) <= set(DIRECTIVES.split())
        made = [line.split('"')[1] for line in lines if line.startswith("MakeNamedMaterial")]
        assert len(made) == len(described) and lines[-2].split('"')[1] == made[-1]
        inside = "\n".join(line for line in lines if line.startswith(" "))
        assert PARAMETER.sub("", inside).split() == []
        assert '"bool remaproughness" false' in inside or described[0]["type"].startswith("diffuse")


def test_nothing_is_written_beyond_the_tolerance_or_of_what_has_no_colour(tmp_path):
    for subject, options, message in (
        ("lambert(rho=0.2)", {"measured": True}, "takes no surface as data"),
        ("lambert(rho=0.2)", {"model": "lambert"}, "is a model already"),
        ("lambert(rho=[0.1, 0.2])", {}, "has no colour"),
        ("eon(rho=0.4, r=1)", {"tolerance": 0.01}, "beyond the tolerance"),
    ):
        with pytest.raises(gonio.GonioError, match=message):
            gonio.convert(subject, tmp_path / "x.gltf", **options)
    with pytest.raises(gonio.GonioError, match="no file for a renderer"):
        gonio.convert("lambert(rho=0.2)", tmp_path / "x.h5", tolerance=0.01)
    with pytest.raises(gonio.GonioError, match=r"ends in \.xml or \.json"):
        gonio.convert("lambert(rho=0.2)", tmp_path / "x.txt", to="Mitsuba")
    assert list(Path(tmp_path).iterdir()) == []


RHO, TAU = np.array([0.1, 0.3, 0.05]), np.array([0.2, 0.4, 0.02])


def shares_written(target: str, description) -> tuple[np.ndarray, np.ndarray]:
    """(reflected, transmitted) colours of a diffusing sheet, by what each format defines."""
    if target == "pbrt":
        (material,) = description
        return material["rgb reflectance"], material["rgb transmittance"]
    if target == "blender":
        return description["Base Color"][:3], description["Translucent"][:3]
    if target == "materialx":
        weight, colour = description["subsurface_weight"], np.array(description["subsurface_color"])
        assert description["geometry_thin_walled"] and description["subsurface_scatter_anisotropy"] == 1
        return (1 - weight) * np.array(description["base_color"]), weight * colour**2
    through = description["extensions"]["KHR_materials_diffuse_transmission"]
    base = np.array(description["pbrMetallicRoughness"]["baseColorFactor"][:3])
    assert description["doubleSided"]
    factor = through["diffuseTransmissionFactor"]
    return (1 - factor) * base, factor * np.array(through["diffuseTransmissionColorFactor"])


@pytest.mark.parametrize(
    "target", ["pbrt", "blender", *(pytest.param(name, marks=pytest.mark.thorough) for name in ("materialx", "gltf"))]
)
def test_a_sheet_reflects_and_transmits_its_colours(target):
    sought = appearance_of(gonio.material(f"thin_sheet(rho={RHO.tolist()}, tau={TAU.tolist()})"))
    expression = nearest(TARGETS[target].forms(sought), sought)
    error = reexpression(target, sought, expression)
    assert error.relative_rms < (6e-3 if target == "materialx" else 1e-5)  # whose index-1 interface is not quite none
    reflected, transmitted = shares_written(target, expression.form.describe(expression.values))
    np.testing.assert_allclose(reflected, RHO, rtol=0.03)
    np.testing.assert_allclose(transmitted, TAU, rtol=0.03)

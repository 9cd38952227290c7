"""A pbrt-v4 scene of a sphere."""

from typing import Any

from gonio.exports.about import LIGHT, SAMPLES, SIDE, SKY, About, number


def pbrt_file(description: list[dict[str, Any]], about: About, suffix: str) -> bytes:
    """The text of the file: the material's lines can be copied into any scene."""
    comment = "\n".join(f"# {line}" for line in about.lines)
    names = [f"{about.name}_{k}" for k in range(len(description) - 1)] + [about.name]
    materials = "\n".join(_material(name, m, names) for name, m in zip(names, description, strict=True))
    x, y, z = LIGHT
    text = f"""{comment}
Scale -1 1 1
LookAt 0 -4 0  0 0 0  0 0 1
Camera "orthographic" "float screenwindow" [ -1.15 1.15 -1.15 1.15 ]
Film "rgb" "string filename" "{about.name}.exr" "integer xresolution" {SIDE} "integer yresolution" {SIDE}
Sampler "zsobol" "integer pixelsamples" {SAMPLES}
Integrator "volpath"
WorldBegin
LightSource "distant" "point3 from" [ {x} {y} {z} ] "point3 to" [ 0 0 0 ] "float scale" 3.1415927
LightSource "infinite" "rgb L" [ {SKY} {SKY} {SKY} ]
{materials}
NamedMaterial "{about.name}"
Shape "sphere"
"""
    return text.encode()


def _material(name: str, description: dict[str, Any], names: list[str]) -> str:
    lines = [f'MakeNamedMaterial "{name}" "string type" "{description["type"]}"']
    for key, value in description.items():
        if key == "materials":
            mixed = " ".join(f'"{names[k]}"' for k in value)
            lines.append(f'"string materials" [ {mixed} ]')
        elif key != "type":
            lines.append(f'"{key}" {_value(value)}')
    return "\n    ".join(lines)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, int):
        return str(value)
    return f"[ {' '.join(number(x) for x in (value if isinstance(value, list) else [value]))} ]"

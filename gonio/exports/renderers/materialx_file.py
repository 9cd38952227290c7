"""A MaterialX document with one OpenPBR surface."""

from typing import Any

from gonio.exports.about import About, number

COLOURS = ("base_color", "specular_color", "subsurface_color")


def materialx_file(description: dict[str, Any], about: About, suffix: str) -> bytes:
    """The text of the file; colours are linear sRGB (lin_rec709)."""
    comment = "\n".join(f"  {line}" for line in about.lines)
    turned = description.get("turned", False)
    inputs = []
    for name, value in description.items():
        if name != "turned":
            kind = "color3" if name in COLOURS else "boolean" if isinstance(value, bool) else "float"
            inputs.append(f'    <input name="{name}" type="{kind}" value="{_text(value)}"/>')
    turning = ""
    if turned:
        inputs.append(f'    <input name="geometry_tangent" type="vector3" nodename="{about.name}_tangent"/>')
        turning = f"""  <bitangent name="{about.name}_tangent" type="vector3">
    <input name="space" type="string" value="world"/>
  </bitangent>
"""
    lines = "\n".join(inputs)
    text = f"""<?xml version="1.0" encoding="utf-8"?>
<!--
{comment}
-->
<materialx version="1.39" colorspace="lin_rec709">
{turning}  <open_pbr_surface name="{about.name}_surface" type="surfaceshader">
{lines}
  </open_pbr_surface>
  <surfacematerial name="{about.name}" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="{about.name}_surface"/>
  </surfacematerial>
</materialx>
"""
    return text.encode()


def _text(value: bool | float | list[float]) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return ", ".join(number(x) for x in value) if isinstance(value, list) else number(value)

"""A MaterialX document with one OpenPBR surface."""

from typing import Any

from gonio.exports.about import About, number

TYPES = {"base_color": "color3", "specular_color": "color3"}


def materialx_file(description: dict[str, Any], about: About, suffix: str) -> bytes:
    """The text of the file; colours are linear sRGB (lin_rec709)."""
    comment = "\n".join(f"  {line}" for line in about.lines)
    turned = description.get("turned", False)
    inputs = []
    for name, value in description.items():
        if name != "turned":
            text = ", ".join(number(x) for x in value) if isinstance(value, list) else number(value)
            inputs.append(f'    <input name="{name}" type="{TYPES.get(name, "float")}" value="{text}"/>')
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

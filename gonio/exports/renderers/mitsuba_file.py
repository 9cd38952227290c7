"""A Mitsuba scene of a sphere as XML, and the BSDF alone as JSON for `mitsuba.load_dict`."""

import json
from typing import Any
from xml.sax.saxutils import quoteattr

from gonio.exports.about import LIGHT, SAMPLES, SIDE, SKY, About, number


def mitsuba_file(description: dict[str, Any], about: About, suffix: str) -> bytes:
    """The text of the file, by its ending."""
    if suffix == ".json":
        return (json.dumps(description, indent=2) + "\n").encode()
    return scene(description, about).encode()


def scene(description: dict[str, Any], about: About, side: int = SIDE, samples: int = SAMPLES) -> str:
    """A sphere under a sun at the upper left and a dim sky; `mitsuba FILE` renders it."""
    comment = "\n".join(f"  {line}" for line in about.lines)
    x, y, z = LIGHT
    return f"""<?xml version="1.0" encoding="utf-8"?>
<!--
{comment}
-->
<scene version="3.0.0">
  <integrator type="path"/>
  <sensor type="orthographic">
    <transform name="to_world">
      <scale x="1.15" y="1.15"/>
      <lookat origin="0, -4, 0" target="0, 0, 0" up="0, 0, 1"/>
    </transform>
    <sampler type="independent"><integer name="sample_count" value="{samples}"/></sampler>
    <film type="hdrfilm">
      <integer name="width" value="{side}"/>
      <integer name="height" value="{side}"/>
      <rfilter type="gaussian"/>
    </film>
  </sensor>
  <emitter type="directional">
    <vector name="direction" value="{-x}, {-y}, {-z}"/>
    <rgb name="irradiance" value="3.1415927"/>
  </emitter>
  <emitter type="constant"><rgb name="radiance" value="{SKY}"/></emitter>
{_bsdf(description, about.name, 1)}
  <shape type="sphere"><ref id={quoteattr(about.name)}/></shape>
</scene>
"""


def _bsdf(plugin: dict[str, Any], name: str | None, depth: int) -> str:
    indent = "  " * depth
    identity = "" if name is None else f" id={quoteattr(name)}"
    lines = [f'{indent}<bsdf type="{plugin["type"]}"{identity}>']
    for key, value in plugin.items():
        if key == "type":
            continue
        if isinstance(value, dict) and value["type"] not in ("uniform", "rgb", "rawconstant"):
            lines.append(_bsdf(value, None, depth + 1))
        else:
            lines.append(f"{indent}  {_parameter(key, value)}")
    return "\n".join([*lines, f"{indent}</bsdf>"])


def _parameter(name: str, value: Any) -> str:
    if isinstance(value, str):
        return f'<string name="{name}" value={quoteattr(value)}/>'
    if not isinstance(value, dict):
        return f'<float name="{name}" value="{number(value)}"/>'
    if value["type"] == "uniform":
        return f'<spectrum name="{name}" value="{number(value["value"])}"/>'
    colour = ", ".join(number(x) for x in value["value"])
    if value["type"] == "rgb":
        return f'<rgb name="{name}" value="{colour}"/>'
    return f'<texture type="rawconstant" name="{name}"><vector name="value" value="{colour}"/></texture>'

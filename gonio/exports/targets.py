"""The renderers that a surface is written for: to add one, its forms, its file, and its entry in `TARGETS`."""

import dataclasses
import os
import pkgutil
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from gonio.data.channels import Channels
from gonio.data.formats import registry
from gonio.models.errors import GonioError, nearest

if TYPE_CHECKING:
    from gonio.exports.about import About
    from gonio.exports.forms import Appearance, Form


@dataclasses.dataclass(frozen=True)
class Target:
    """A renderer."""

    title: str
    suffixes: tuple[str, ...]
    forms: "Callable[[Appearance], tuple[Form, ...]]"
    file: "Callable[[Any, About, str], bytes]"
    """Of what a form says, with what is to be told of it, and the ending."""
    measured: Callable[[str, Channels], tuple[Any, tuple[str, ...]]] | None = None
    """What refers to the surface as data, in an RGL file of this name and channels, and what is to be told of it."""


def _measured_by_mitsuba(file: str, channels: Channels) -> tuple[dict[str, Any], tuple[str, ...]]:
    spectral = channels.wavelengths_nm is not None
    kind = "spectral variants alone" if spectral else "its RGB variants alone"
    return {"type": "measured", "filename": file}, (f"Mitsuba reads these samples in {kind}",)


def _measured_by_pbrt(file: str, channels: Channels) -> tuple[list[dict[str, Any]], tuple[str, ...]]:
    if channels.wavelengths_nm is None:
        raise GonioError("pbrt reads samples of wavelengths, and these channels have none; leave 'measured' out")
    return [{"type": "measured", "string filename": file}], ()


def _later(place: str) -> Callable[..., Any]:
    """A function of a renderer, whose module is loaded with its first call: JAX comes with it."""

    def call(*args: Any) -> Any:
        return pkgutil.resolve_name(f"gonio.exports.renderers.{place}")(*args)

    return call


TARGETS = {
    "mitsuba": Target(
        "Mitsuba 3", (".xml", ".json"), _later("mitsuba:forms"), _later("mitsuba_file:mitsuba_file"),
        _measured_by_mitsuba,
    ),
    "pbrt": Target(
        "pbrt-v4", (".pbrt",), _later("pbrt:forms"), _later("pbrt_file:pbrt_file"), _measured_by_pbrt
    ),
    "materialx": Target(
        "MaterialX's OpenPBR surface", (".mtlx",), _later("openpbr:forms"), _later("materialx_file:materialx_file")
    ),
    "gltf": Target("glTF 2.0", (".gltf", ".glb"), _later("gltf:forms"), _later("gltf_file:gltf_file")),
    "blender": Target(
        "Blender's Principled BSDF", (".py",), _later("blender:forms"), _later("blender_file:blender_file")
    ),
}  # fmt: skip
OTHER_NAMES = {"openpbr": "materialx", "radiance": "klems"}
"""Of renderers and formats, in small letters."""


def canonical(to: str | None) -> str | None:
    """The name of a renderer or a format by which it is listed."""
    return None if to is None else OTHER_NAMES.get(to.casefold(), to.casefold())


def target_of(path: str | os.PathLike[str], to: str | None = None) -> Target | None:
    """The renderer that is named, or whose ending alone this is; None for a format of tables.

    Raises GonioError for a name that is neither, and for an ending that is not the renderer's.
    """
    suffix = os.path.splitext(path)[1].lower()
    if to is None:
        of_tables = {s for known in registry.FORMATS for s in known.suffixes}
        exact = [t for t in TARGETS.values() if suffix in t.suffixes]
        return exact[0] if exact and suffix not in of_tables else None
    name = canonical(to) or ""
    target = TARGETS.get(name)
    if target is None:
        _require_known(name, [*TARGETS, "radiance", *registry.targets()])
    elif suffix not in target.suffixes:
        ending = f"ends in '{suffix}'" if suffix else "has no ending"
        raise GonioError(f"{path} {ending}; a file for {target.title} ends in {' or '.join(target.suffixes)}")
    return target


def _require_known(name: str, known: Iterable[str]) -> None:
    if name not in known:
        raise GonioError(f"nothing is written for {name[:80]!r}; {nearest(name[:80], known)}")

"""Material files: a model as TOML, with its name, channels and source."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gonio.data.channels import Channels
from gonio.data.files import TOML_FORMAT, new_file, read_toml
from gonio.data.serialise import toml_values
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.data.material import Material
    from gonio.models.brdf import AbstractBRDF

LARGEST = 4 << 20  # bytes: ten thousand wavelengths at full precision are a quarter of it
MOST_CHANNELS = 10_000
_KEYS = ("gonio_material", "name", "description", "model", "channels", "wavelengths_nm", "source", "fit")


def read_material(path: str | os.PathLike[str]) -> "Material":
    """A material file of format 1. Raises GonioError, in one sentence that names the file, for anything else."""
    path = Path(path)
    data = read_toml(path, "material", LARGEST, _KEYS)
    try:
        return _material(data, path.stem, str(path))
    except GonioError as error:
        raise GonioError(f"{path}: {error}") from None


def _material(data: dict, stem: str, file: str) -> "Material":
    # Models load JAX, and a table's file does without it.
    from gonio.data.material import Material
    from gonio.models.expression.builder import build

    expression = " ".join(_typed(data, "model", str, "a spelled model in quotes").split())
    brdf = build(expression)
    source = _typed(data, "source", dict, "a table [source] with a text", {})
    meta = {"file": file}
    if "fit" in data:
        meta["fit"] = _typed(data, "fit", dict, "a table")
    return Material(
        _typed(data, "name", str, "a text", stem),
        brdf,
        expression,
        _declared_channels(data, brdf),
        _typed(data, "description", str, "a text", ""),
        _typed(source, "text", str, "a text", ""),
        meta,
    )


_NO_DEFAULT = object()


def _typed(data: dict, key: str, kind: type, expected: str, default: Any = _NO_DEFAULT) -> Any:
    value = data.get(key, default)
    if value is _NO_DEFAULT:
        raise GonioError(f"it has no {key}; expected {expected}")
    if not isinstance(value, kind):
        raise GonioError(f"{key} is {type(value).__name__}; expected {expected}")
    return value


def _declared_channels(data: dict, brdf: "AbstractBRDF") -> Channels:
    from gonio.data.material import channels_of

    if "channels" in data and "wavelengths_nm" in data:
        raise GonioError("it has both channels and wavelengths_nm; give one of them")
    if "channels" in data:
        names = _typed(data, "channels", list, "a list of names")
        if not names or not all(isinstance(n, str) for n in names):
            raise GonioError("channels holds something that is not a name; expected a list of texts")
        channels = Channels(tuple(names[:MOST_CHANNELS]))
    elif "wavelengths_nm" in data:
        channels = Channels.of_wavelengths(_wavelengths(data))
    else:
        return channels_of(brdf)
    count = len(channels_of(brdf))
    if len(channels) != count:
        raise GonioError(
            f"{len(channels)} channels are named, but the model has {count}; name as many as its lists hold"
        )
    return channels


def _wavelengths(data: dict) -> list[float]:
    values = _typed(data, "wavelengths_nm", list, "a list of numbers, nm")
    for v in values[:MOST_CHANNELS]:
        if isinstance(v, bool) or not isinstance(v, int | float) or not 1 <= v <= 1e6:
            raise GonioError(f"wavelengths_nm holds {v!r}; expected wavelengths from 1 to 1e6 nm")
    if not values:
        raise GonioError("wavelengths_nm is empty; leave it out for a grey material")
    return [float(v) for v in values[:MOST_CHANNELS]]


def material_text(material: "Material") -> str:
    """The material file of a material, as text. Raises GonioError where its model has no expression."""
    import tomli_w

    from gonio.models.evaluation import channel_count
    from gonio.models.expression.builder import to_expression

    data: dict[str, Any] = {
        "gonio_material": TOML_FORMAT,
        "name": material.name,
        "description": material.description,
        "model": material.expression or to_expression(material.brdf),
    }
    if material.channels.wavelengths_nm is not None:
        data["wavelengths_nm"] = [float(w) for w in material.channels.wavelengths_nm]
    elif channel_count(material.brdf) is not None:
        data["channels"] = list(material.channels.names)
    data["source"] = {"text": material.source}
    if material.meta.get("fit"):
        data["fit"] = toml_values(material.meta["fit"])
    return tomli_w.dumps(data)


def write_material(path: str | os.PathLike[str], material: "Material", force: bool = False) -> Path:
    """Writes a material file, whole or not at all, and returns its path.

    Raises GonioError where `path` exists (unless `force`), cannot be written, or the model has no expression.
    """
    text = material_text(material)
    with new_file(path, force) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)

"""Material files: a model as TOML, with its name, channels and source."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gonio.data.channels import Channels
from gonio.data.files import TOML_FORMAT, new_file, read_toml, stem
from gonio.data.serialise import NUMBER, require_kind, toml_values
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.data.material import Material
    from gonio.models.brdf import AbstractBRDF

LARGEST = 4 << 20  # bytes: ten thousand wavelengths at full precision are a quarter of it
KEYS = {
    "name": (str, "a text"), "description": (str, "a text"), "model": (str, "a spelled model in quotes"),
    "channels": (list, "a list of names"), "wavelengths_nm": (list, "a list of numbers, nm"),
    "source": (dict, "a table [source] with a text"), "fit": (dict, "a table"),
}  # fmt: skip

FIT_KEYS: dict[str, Any] = {
    "converged": bool, "reason": str, "table": str, "asked": str, "loss": str, "weight": str, "robust": str,
    "samples": int, "starts": int, "starts_agreed": int, "metrics": {"": NUMBER}, "free_names": [str],
    "parameters": [
        {"name": str, "status": str, "value": NUMBER, "standard_uncertainty": NUMBER, "interval95": [NUMBER]}
    ],
    "residuals": {"sentences": [str], "worst_region": str, "noisiness": {"verdict": str}},
    "bootstrap": {"numbers": [{"name": str, "standard_uncertainty": NUMBER}]},
    "colour_difference": {"name": str, "mean": NUMBER, "p95": NUMBER}, "correlation": [[NUMBER]],
    "correlated": [{"a": str, "b": str, "correlation": NUMBER}], "alternatives": [{"model": str}],
    "undetermined": [str], "notes": [str], "active_bounds": [str],
    "common_errors": [{"name": str, "meaning": str, "number": str, "equal": NUMBER, "stated": NUMBER, "fitted": bool}],
}  # fmt: skip
"""The kinds of what other modules take out of [fit], where it is there; "" stands for every other key."""


def read_material(path: str | os.PathLike[str]) -> "Material":
    """A material file of format 1. Raises GonioError, in one sentence that names the file, for anything else."""
    return read_toml(path, "material", LARGEST, KEYS, lambda data: _material(data, Path(path)))


def _material(data: dict[str, Any], path: Path) -> "Material":
    # Models load JAX, and a table's file does without it.
    from gonio.data.material import Material
    from gonio.models.expression.builder import build, terms_to_expression
    from gonio.models.expression.parser import parse, parse_bssrdf
    from gonio.models.expression.wavelengths import with_wavelengths

    if "model" not in data:
        raise GonioError("it has no model; expected a spelled model in quotes")
    expression = " ".join(data["model"].split())
    wavelengths = _wavelengths(data)
    if parse_bssrdf(expression) is None:  # light below the surface has a number for each wavelength already
        terms = parse(expression)
        complete = with_wavelengths(terms, wavelengths)
        expression = expression if complete == terms else terms_to_expression(complete)
    brdf = build(expression)
    source = data.get("source", {}).get("text", "")
    if not isinstance(source, str):
        raise GonioError(f"source.text is {type(source).__name__}; expected a text")
    require_kind(data.get("fit", {}), FIT_KEYS, "fit")
    meta = {"file": str(path)} | ({"fit": data["fit"]} if "fit" in data else {})
    name, description = data.get("name", stem(path)), data.get("description", "")
    return Material(name, brdf, expression, _declared_channels(data, brdf), description, source, meta)


def _wavelengths(data: dict[str, Any]) -> list[float] | None:
    wavelengths = data.get("wavelengths_nm")
    if wavelengths is None:
        return None
    for v in wavelengths:
        if isinstance(v, bool) or not isinstance(v, int | float) or not 1 <= v <= 1e6:
            raise GonioError(f"wavelengths_nm holds {v!r}; expected wavelengths from 1 to 1e6 nm")
    if not wavelengths:
        raise GonioError("wavelengths_nm is empty; leave it out for a grey material")
    return [float(v) for v in wavelengths]


def _declared_channels(data: dict[str, Any], brdf: "AbstractBRDF") -> Channels:
    from gonio.data.material import channels_of

    names, wavelengths = data.get("channels"), data.get("wavelengths_nm")
    if names is not None and wavelengths is not None:
        raise GonioError("it has both channels and wavelengths_nm; give one of them")
    if names is None and wavelengths is None:
        return channels_of(brdf)
    count = len(channels_of(brdf))
    if names is not None:
        if not names or not all(isinstance(n, str) for n in names):
            raise GonioError("channels holds something that is not a name; expected a list of texts")
        channels = Channels(tuple(names))
    else:
        channels = Channels.of_wavelengths(_wavelengths(data) or ())
    if len(channels) != count:
        raise GonioError(
            f"{len(channels)} channels are named, but the model has {count}; name as many as its lists hold"
        )
    return channels


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

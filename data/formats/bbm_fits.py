"""Published parameter sets of measured materials, one a line: ``name = Aggregate(Lambertian(...), Model(...))``.

The form in which the BSDF benchmark (https://github.com/bsdfbenchmark/bbm) collected the fits of Ngan et al. 2005, Löw
et al. 2012 and Bagher et al. 2012. Each becomes an expression of ours with the factors that the fit was made with.
"""

import dataclasses
import math
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from gonio.data.files import input_size
from gonio.data.formats.base import Format
from gonio.models.errors import GonioError, nearest

if TYPE_CHECKING:
    from gonio.data.material import Material

LARGEST = 4 << 20
SUFFIX = ".fit"
_TOKEN = re.compile(
    r"\s*(?:(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*)|(?P<sign>[()\[\],=]))"
)


@dataclasses.dataclass(frozen=True)
class Said:
    """A model of a published set: its name there, its parameters, and the models inside it."""

    name: str
    values: dict[str, object]
    parts: tuple["Said", ...]


class _Reader:
    def __init__(self, text: str):
        self.tokens, at = [], 0
        while at < len(text.rstrip()):
            match = _TOKEN.match(text, at)
            if match is None:
                raise GonioError(f"the character {text[at:].strip()[:1]!r} has no meaning in a published fit")
            self.tokens.append((match.lastgroup, match.group(match.lastgroup)))
            at = match.end()
        self.at = 0

    def take(self, sign: str | None = None) -> tuple[str, str]:
        kind, text = self.tokens[self.at] if self.at < len(self.tokens) else ("end", "the end")
        if sign is not None and text != sign:
            raise GonioError(f"'{sign}' expected where {text!r} came")
        self.at += 1
        return kind, text

    def next_is(self, sign: str) -> bool:
        return self.at < len(self.tokens) and self.tokens[self.at] == ("sign", sign)

    def model(self, depth: int = 0) -> Said:
        kind, name = self.take()
        if kind != "name" or depth > 4:
            raise GonioError(f"a model's name expected where {name!r} came")
        values, parts = {}, []
        self.take("(")
        while not self.next_is(")"):
            if self.at + 1 < len(self.tokens) and self.tokens[self.at + 1] == ("sign", "="):
                key = self.take()[1]
                self.take("=")
                values[key] = self.value()
            else:
                parts.append(self.model(depth + 1))
            if not self.next_is(")"):
                self.take(",")
        self.take(")")
        return Said(name, values, tuple(parts))

    def value(self, depth: int = 0):
        if not self.next_is("["):
            kind, text = self.take()
            if kind != "number" or not math.isfinite(float(text)):
                raise GonioError(f"a number expected where {text!r} came")
            return float(text)
        if depth > 1:
            raise GonioError("lists of lists of lists have no meaning in a published fit")
        self.take("[")
        found = []
        while not self.next_is("]"):
            found.append(self.value(depth + 1))
            if not self.next_is("]"):
                self.take(",")
        self.take("]")
        return found


def published_names(path: str | os.PathLike[str]) -> list[str]:
    """The materials of a file of published fits, in its order. Raises GonioError as `published_spelling` does."""
    return list(_lines(path))


def published_spelling(path: str | os.PathLike[str], name: str) -> str:
    """The expression of one material of a file of published fits.

    Raises GonioError, in one sentence, for a file that is none, a name that it has not, and a fit that cannot be
    spelled: an unknown model, or a number outside of its domain.
    """
    lines = _lines(path)
    if name not in lines:
        raise GonioError(f"{path} has no material '{name[:80]}'; {nearest(name[:80], lines)}")
    try:
        reader = _Reader(lines[name])
        said = reader.model()
        if reader.at != len(reader.tokens):
            raise GonioError(f"nothing more was expected where {reader.take()[1]!r} came")
        return " + ".join(_spelled(part) for part in (said.parts if said.name == "Aggregate" else (said,)))
    except GonioError as error:
        raise GonioError(f"{path}, {name}: {error}") from None


def read_published(path: str | os.PathLike[str], entry: str | None = None) -> "Material":
    """One material of a file of published fits. Raises GonioError, naming some, where no `entry` is given."""
    from gonio.data.material import Material, channels_of
    from gonio.models.expression.builder import build

    if entry is None:
        first = published_names(path)[0]
        raise GonioError(f"{path} holds published fits; name one of them, as in '{path}:{first}' (see gonio info)")
    expression = published_spelling(path, entry)
    try:
        brdf = build(expression)
    except GonioError as error:
        raise GonioError(f"{path}, {entry}: {error}") from None
    source = f"published fit of {entry} in {Path(path).name}"
    meta = {"file": os.fspath(path), "entry": entry}
    return Material(entry, brdf, expression, channels_of(brdf), source, source, meta)


def _lines(path: str | os.PathLike[str]) -> dict[str, str]:
    if input_size(path) > LARGEST:
        raise GonioError(f"{path} has more than {LARGEST} bytes; a file of published fits is smaller")
    try:
        text = Path(path).read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise GonioError(f"{path} is not a text; expected published fits, 'name = Model(...)' a line") from None
    found = {}
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        name, sign, rest = line.partition("=")
        if not sign or "(" in name:
            raise GonioError(f"{path}, line {number}: expected 'name = Model(...)'")
        found[name.strip()] = rest
    if not found:
        raise GonioError(f"{path} has no fits; expected 'name = Model(...)' a line")
    return found


# For each published model: ours, the factor on its scale, our name of each parameter, and our options.
_MODELS = {
    "NganWard": ("ward", 1.0, {"roughness": "alpha"}, {}),
    "NganWardDuer": ("ward_duer", 1.0, {"roughness": "alpha"}, {}),
    "NganBlinnPhong": ("phong", 1.0, {"sharpness": "n"}, {}),
    "NganLafortune": ("lafortune", 1.0, {"Cxy": ("c_x", "c_y"), "Cz": "c_z", "sharpness": "n"}, {"norm": "ngan"}),
    # The fits were made with 1/π where the model has 1/4.
    "NganCookTorrance": ("cook_torrance", 4 / math.pi, {"roughness": "alpha", "eta": "f0"}, {}),
    "NganAshikhminShirley": ("ashikhmin_shirley", 1.0, {"sharpness": "n", "fresnelReflectance": "f0"}, {}),
    "NganHe": (
        "he_torrance", 1.0, {"roughness": "sigma", "autocorrelation": "tau", "eta": "eta"}, {"form": "westin"}
    ),
    "LowAshikhminShirley": ("ashikhmin_shirley", 1.0, {"sharpness": "n", "fresnelReflectance": "eta"}, {}),
    "LowCookTorrance": ("cook_torrance_1982", 1.0, {"roughness": "alpha", "eta": "eta"}, {}),
    "LowMicrofacetFit": ("abc_microfacet", 1 / math.pi, {"B": "b", "C": "c", "eta": "eta"}, {}),
    "LowSmooth": ("abc_smooth", 1.0, {"B": "b", "C": "c", "eta": "eta"}, {}),
    "Bagher": (
        "sgd", 1.0,
        {"alpha": "alpha", "p": "p", "K": "kappa", "eta": ("f0", "f1"), "Lambda": "lam", "c": "c", "k": "k",
         "theta0": "theta_0"},
        {},
    ),
}  # fmt: skip
_SCALES = ("albedo", "A")
WAVELENGTHS = [0.645, 0.526, 0.444]
"""µm, of R, G and B: those with which the collection reads He's fits."""


def _spelled(said: Said) -> str:
    if said.name == "Lambertian":
        return f"lambert(rho={_text(said.values.get('albedo'))})"
    if said.name not in _MODELS:
        raise GonioError(f"unknown model '{said.name}'; {nearest(said.name, [*_MODELS, 'Lambertian'])}")
    ours, factor, names, options = _MODELS[said.name]
    missing = [n for n in names if n not in said.values]
    scale = next((said.values[s] for s in _SCALES if s in said.values), None)
    if missing or scale is None:
        raise GonioError(f"{said.name} has no {', '.join(missing) or 'albedo'}")
    given = {}
    for theirs, name in names.items():
        value = said.values[theirs]
        if theirs == "eta" and isinstance(name, tuple):
            if not (isinstance(value, list) and len(value) == 2):
                raise GonioError(f"{said.name}'s eta has {value!r}; expected the two lists of its Fresnel term")
            given.update(zip(name, value, strict=True))
        else:
            given.update(dict.fromkeys((name,) if isinstance(name, str) else name, value))
    if ours == "he_torrance":
        given["wavelength"] = WAVELENGTHS
    inside = [f"{n}={_text(v)}" for n, v in given.items()] + [f'{o}="{c}"' for o, c in options.items()]
    return f"{_text(_times(scale, factor))} * {ours}({', '.join(inside)})"


def _times(value, factor: float):
    return [v * factor for v in value] if isinstance(value, list) else value * factor


def _text(value) -> str:
    if isinstance(value, list) and all(isinstance(v, float) for v in value) and value:
        return f"[{', '.join(repr(v) for v in value)}]"
    if isinstance(value, float):
        return repr(value)
    raise GonioError(f"{value!r} came where a number or a list of them was expected")


FORMAT = Format(
    "published fits", "published fits (.fit)", "model", lambda head: head.suffix == SUFFIX, read_published,
    options=("entry",), suffixes=(SUFFIX,), entries=published_names,
)  # fmt: skip

"""Published parameter sets of measured materials, one a line: ``name = Aggregate(Lambertian(...), Model(...))``.

The form in which the BSDF benchmark (https://github.com/bsdfbenchmark/bbm) collected the fits of Ngan et al. 2005, Löw
et al. 2012 and Bagher et al. 2012. Each becomes an expression of ours with the factors that the fit was made with.
"""

import dataclasses
import math
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gonio.data.files import input_size
from gonio.models.errors import GonioError, nearest

if TYPE_CHECKING:
    from gonio.data.material import Material

LARGEST = 4 << 20
_TOKEN = re.compile(
    r"\s*(?:(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*)|(?P<sign>[()\[\],=]))"
)


@dataclasses.dataclass(frozen=True)
class PublishedModel:
    """A model of a published set: its name there, its parameters, and the models inside it."""

    name: str
    values: dict[str, Any]
    models: tuple["PublishedModel", ...]


class _Parser:
    def __init__(self, text: str) -> None:
        self.tokens: list[tuple[str, str]] = []
        position = 0
        while position < len(text.rstrip()):
            match = _TOKEN.match(text, position)
            if match is None or match.lastgroup is None:
                raise GonioError(f"the character {text[position:].strip()[:1]!r} has no meaning in a published fit")
            self.tokens.append((match.lastgroup, match.group(match.lastgroup)))
            position = match.end()
        self.position = 0

    def take(self, sign: str | None = None) -> tuple[str, str]:
        kind, text = self.tokens[self.position] if self.position < len(self.tokens) else ("end", "the end")
        if sign is not None and text != sign:
            raise GonioError(f"'{sign}' expected where {text!r} came")
        self.position += 1
        return kind, text

    def next_is(self, sign: str, ahead: int = 0) -> bool:
        return self.tokens[self.position + ahead : self.position + ahead + 1] == [("sign", sign)]

    def items(self, close: str) -> Iterator[None]:
        """One step for each item of a list with commas, up to the closing sign."""
        while not self.next_is(close):
            yield
            if not self.next_is(close):
                self.take(",")
        self.take(close)

    def model(self, depth: int = 0) -> PublishedModel:
        kind, name = self.take()
        if kind != "name" or depth > 4:
            raise GonioError(f"a model's name expected where {name!r} came")
        values, models = {}, []
        self.take("(")
        for _ in self.items(")"):
            if self.next_is("=", ahead=1):
                key = self.take()[1]
                self.take("=")
                values[key] = self.value()
            else:
                models.append(self.model(depth + 1))
        return PublishedModel(name, values, tuple(models))

    def value(self, depth: int = 0) -> float | list:
        if not self.next_is("["):
            kind, text = self.take()
            if kind != "number" or not math.isfinite(float(text)):
                raise GonioError(f"a number expected where {text!r} came")
            return float(text)
        if depth > 1:
            raise GonioError("lists of lists of lists have no meaning in a published fit")
        self.take("[")
        return [self.value(depth + 1) for _ in self.items("]")]


def published_names(path: str | os.PathLike[str]) -> list[str]:
    """The materials of a file of published fits, in its order. Raises GonioError as `published_expression` does."""
    return list(_lines(path))


def published_expression(path: str | os.PathLike[str], name: str) -> str:
    """The expression of one material of a file of published fits.

    Raises GonioError, in one sentence, for a file that is none, a name that it has not, and a fit that cannot be
    spelled: an unknown model, or a number outside of its domain.
    """
    lines = _lines(path)
    if name not in lines:
        raise GonioError(f"{path} has no material '{name[:80]}'; {nearest(name[:80], lines)}")
    try:
        parser = _Parser(lines[name])
        model = parser.model()
        if parser.position != len(parser.tokens):
            raise GonioError(f"nothing more was expected where {parser.take()[1]!r} came")
        return " + ".join(_term(m) for m in (model.models if model.name == "Aggregate" else (model,)))
    except GonioError as error:
        raise GonioError(f"{path}, {name}: {error}") from None


def read_published(path: str | os.PathLike[str], entry: str | None = None) -> "Material":
    """One material of a file of published fits. Raises GonioError, naming some, where no `entry` is given."""
    from gonio.data.material import Material, channels_of
    from gonio.models.expression.builder import build

    if entry is None:
        first = published_names(path)[0]
        raise GonioError(f"{path} holds published fits; name one of them, as in '{path}:{first}' (see gonio info)")
    expression = published_expression(path, entry)
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
    fits = {}
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        name, sign, rest = line.partition("=")
        if not sign or "(" in name:
            raise GonioError(f"{path}, line {number}: expected 'name = Model(...)'")
        fits[name.strip()] = rest
    if not fits:
        raise GonioError(f"{path} has no fits; expected 'name = Model(...)' a line")
    return fits


# For each published model: its name here, the factor on its scale, the name of each parameter here, and options.
_MODELS: dict[str, tuple[str, float, dict[str, str | tuple[str, ...]], dict[str, str]]] = {
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


def _term(model: PublishedModel) -> str:
    if model.name == "Lambertian":
        return f"lambert(rho={_text(model.values.get('albedo'))})"
    if model.name not in _MODELS:
        raise GonioError(f"unknown model '{model.name}'; {nearest(model.name, [*_MODELS, 'Lambertian'])}")
    name, factor, parameters, options = _MODELS[model.name]
    missing = [n for n in parameters if n not in model.values]
    scale = next((model.values[s] for s in _SCALES if s in model.values), None)
    if missing or scale is None:
        raise GonioError(f"{model.name} has no {', '.join(missing) or 'albedo'}")
    values = {}
    for theirs, ours in parameters.items():
        value = model.values[theirs]
        if theirs == "eta" and isinstance(ours, tuple):
            if not (isinstance(value, list) and len(value) == 2):
                raise GonioError(f"{model.name}'s eta has {value!r}; expected the two lists of its Fresnel term")
            values.update(zip(ours, value, strict=True))
        else:
            values.update(dict.fromkeys((ours,) if isinstance(ours, str) else ours, value))
    if name == "he_torrance":
        values["wavelength"] = WAVELENGTHS
    inside = [f"{n}={_text(v)}" for n, v in values.items()] + [f'{o}="{c}"' for o, c in options.items()]
    scaled = [v * factor for v in scale] if isinstance(scale, list) else scale * factor
    return f"{_text(scaled)} * {name}({', '.join(inside)})"


def _text(value: object) -> str:
    if isinstance(value, list) and all(isinstance(v, float) for v in value) and value:
        return f"[{', '.join(repr(v) for v in value)}]"
    if isinstance(value, float):
        return repr(value)
    raise GonioError(f"{value!r} came where a number or a list of them was expected")

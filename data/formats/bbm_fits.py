"""Published parameter sets of measured materials, one a line: ``name = Aggregate(Lambertian(...), Model(...))``.

The form in which the BSDF benchmark (https://github.com/bsdfbenchmark/bbm) collected the fits of Ngan et al. 2005, Löw
et al. 2012 and Bagher et al. 2012. Each becomes an expression of ours with the factors that the fit was made with.
"""

import ast
import contextlib
import dataclasses
import math
import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gonio.data.files import input_size
from gonio.models.errors import GonioError, nearest

if TYPE_CHECKING:
    from gonio.data.material import Material

LARGEST = 4 << 20


@dataclasses.dataclass(frozen=True)
class PublishedModel:
    """A model of a published set: its name there, its parameters, and the models inside it."""

    name: str
    values: dict[str, Any]
    models: tuple["PublishedModel", ...]


def _model(node: ast.expr, depth: int = 0) -> PublishedModel:
    if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)) or depth > 4:
        raise GonioError(f"a model's name expected where '{ast.unparse(node)[:80]}' came")
    values = {keyword.arg or "**": _value(keyword.value) for keyword in node.keywords}
    return PublishedModel(node.func.id, values, tuple(_model(inner, depth + 1) for inner in node.args))


def _value(node: ast.expr, depth: int = 0) -> float | list:
    if isinstance(node, ast.List):
        if depth > 1:
            raise GonioError("lists of lists of lists have no meaning in a published fit")
        return [_value(item, depth + 1) for item in node.elts]
    with contextlib.suppress(ValueError, OverflowError):
        value = ast.literal_eval(node)
        if type(value) in (int, float) and math.isfinite(value):
            return float(value)
    raise GonioError(f"a number expected where '{ast.unparse(node)[:80]}' came")


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
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SyntaxWarning)  # Python's remarks on its own spelling are not for users
            model = _model(ast.parse(lines[name].strip(), mode="eval").body)  # the form is that of a call in Python
        return " + ".join(_term(m) for m in (model.models if model.name == "Aggregate" else (model,)))
    except GonioError as error:
        raise GonioError(f"{path}, {name}: {error}") from None
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise GonioError(f"{path}, {name}: this is no Model(number = ..., ...)") from None


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
    _text(scale)  # refuses lists of lists
    scaled = [v * factor for v in scale] if isinstance(scale, list) else scale * factor
    return f"{_text(scaled)} * {name}({', '.join(inside)})"


def _text(value: object) -> str:
    if isinstance(value, list) and all(isinstance(v, float) for v in value) and value:
        return f"[{', '.join(repr(v) for v in value)}]"
    if isinstance(value, float):
        return repr(value)
    raise GonioError(f"{value!r} came where a number or a list of them was expected")

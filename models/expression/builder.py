"""From an expression to a model, and back; names for people of the numbers of a model."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from gonio.models.arrays import Channels
from gonio.models.brdf import AbstractBRDF, Scaled, Sum, terms
from gonio.models.catalog import MODELS, name_of
from gonio.models.errors import GonioError
from gonio.models.expression.parser import (
    FACTOR,
    Call,
    Term,
    Value,
    calls,
    needed,
    numbers,
    options_of,
    parse,
    parse_bssrdf,
    submodels_of,
)
from gonio.models.parameters import parameters_of
from gonio.models.subsurface.base import AbstractBSSRDF
from gonio.models.subsurface.catalog import BSSRDFS
from gonio.models.subsurface.wide_spots import WideSpots


def build(
    expression: str | tuple[Term, ...], converted: Callable[[float | tuple[float, ...]], Any] | None = None
) -> AbstractBRDF:
    """The model that an expression means; GonioError where it cannot be read or leaves a parameter without a value.

    Light below the surface (``dipole(...)``) is the BRDF that wide spots see of it. `converted`: what makes arrays of
    numbers, by default `as_array`; NumPy's is many times as fast, for models that are only asked what they are.
    """
    converted = converted or as_array
    if isinstance(expression, str) and (below := parse_bssrdf(expression)) is not None:
        return WideSpots(build_bssrdf(below))
    spelled = parse(expression) if isinstance(expression, str) else expression
    for call in calls(spelled):
        missing = [n for n in needed(call) if call.values.get(n, Value()).number is None]
        unsaid = [n for n, v in call.values.items() if v.number is None and n not in missing]
        if missing or unsaid:
            what = ", ".join([*missing, *unsaid])
            raise GonioError(f"{call.name} has no value for {what}; give one, as in {example(call.name)}.")
    for n in (n for term in spelled for n in numbers(term)):
        if n.value.number is None:
            raise GonioError(f"{n.call.name} has no value for a scale; give one, as in 0.5 * {n.call.name}(...).")
    return together(
        [
            assemble(frame(t), {n.path: converted(n.value.number) for n in numbers(t) if n.value.number is not None})
            for t in spelled
        ]
    )


def build_bssrdf(call: Call) -> AbstractBSSRDF:
    """The model of light below the surface that is spelled; GonioError where it leaves a number without a value."""
    if free := [name for name, value in call.values.items() if value.number is None]:
        raise GonioError(f"{call.name} has no value for {', '.join(free)}; give one, as in {example(call.name)}.")
    numbers = {name: as_array(v.number) for name, v in call.values.items() if v.number is not None}
    return BSSRDFS[call.name](**numbers)


class Frame(NamedTuple):
    """A spelled model without its numbers: hashable, so that one compiled program serves all of them."""

    name: str
    options: tuple[tuple[str, str], ...]
    inside: "tuple[tuple[str, tuple[Frame, ...]], ...]"


def frame(term: Term) -> Frame:
    """What is left of a term when its numbers are taken out."""
    inside = tuple((field, tuple(frame(part) for part in parts)) for field, parts in term.call.models.items())
    return Frame(term.call.name, tuple(sorted(term.call.options.items())), inside)


def prepared(of: Frame) -> bool:
    """Whether the model, or one inside it, is `AbstractBRDF.prepared`."""
    return MODELS[of.name].prepared or any(prepared(part) for _, parts in of.inside for part in parts)


def assemble(of: Frame, values: dict[str, jnp.ndarray]) -> AbstractBRDF:
    """One term of the given numbers by their paths, ``alpha`` or ``base.0.alpha`` inside; JAX may trace them."""
    fields: dict[str, Any] = {n: v for n, v in values.items() if "." not in n and n != FACTOR}
    for field, parts in of.inside:
        starts = [f"{field}.{index}." for index in range(len(parts))]
        within = [{n.removeprefix(start): v for n, v in values.items() if n.startswith(start)} for start in starts]
        fields[field] = together([assemble(part, v) for part, v in zip(parts, within, strict=True)])
    model = MODELS[of.name](**fields, **dict(of.options))
    return Scaled(values[FACTOR], model) if FACTOR in values else model


def together(parts: list[AbstractBRDF]) -> AbstractBRDF:
    """The sum of some models; the model itself where there is one."""
    return parts[0] if len(parts) == 1 else Sum(tuple(parts))


def as_array(number: float | tuple[float, ...]) -> jnp.ndarray:
    """A spelled number, or list of them, in the caller's precision."""
    # By way of NumPy: JAX would compile the conversion.
    return jnp.asarray(in_double(number).astype(jnp.result_type(float)))


def in_double(number: float | tuple[float, ...] | None) -> np.ndarray:
    """A number or a list of them in double precision, NaN for none; GonioError where JAX's precision cannot hold it."""
    values, kind = np.asarray(number, float), jnp.result_type(float)
    beyond = np.abs(values) > jnp.finfo(kind).max
    if beyond.any() and np.isfinite(values[beyond]).all():
        raise GonioError(
            f"{values[beyond].flat[0]:g} is more than single precision holds ({jnp.finfo(kind).max:.3g}); switch on "
            'double precision first: jax.config.update("jax_enable_x64", True)'
        )
    return values


def example(name: str) -> str:
    """A complete expression of one model, at its starting values."""
    if name in BSSRDFS:
        known = parameters_of(BSSRDFS[name])
        return f"'{name}({', '.join(f'{n}={known[n].start:g}' for n in ('sigma_a', 'sigma_s', 'eta'))})'"
    known = parameters_of(MODELS[name])
    texts = [f"{inside}=lambert(rho=0.5)" for inside in submodels_of(MODELS[name])]
    texts += [f"{n}={known[n].start:g}" for n in needed(Call(name, {}, {}))]
    return f"'{name}({', '.join(texts)})'"


def _number_text(value: Channels) -> str:
    a = np.asarray(value)
    # The shortest decimal that reads back as the same number of the array's own precision.
    texts = [np.format_float_positional(x, trim="-") if 1e-5 <= abs(x) < 1e6 else repr(x.item()) for x in a.reshape(-1)]
    return texts[0] if a.ndim == 0 else f"[{', '.join(texts)}]"


def to_expression(brdf: AbstractBRDF) -> str:
    """The expression of a model, which `build` reads back to the same values; GonioError for what has none."""
    return " + ".join(_spell_term(t) for t in terms(brdf))


def _spell_term(brdf: AbstractBRDF) -> str:
    if isinstance(brdf, Scaled):
        return f"{_number_text(brdf.scale)} * {_spell_term(brdf.base)}"
    if isinstance(brdf, WideSpots):
        return bssrdf_expression(brdf.bssrdf)
    if name_of(type(brdf)) is None:
        raise GonioError(
            f"A {type(brdf).__name__} has no expression; only the models that 'gonio models' lists have one."
        )
    values = [f"{field}={to_expression(getattr(brdf, field))}" for field in submodels_of(type(brdf))]
    values += [
        f"{n}={_number_text(getattr(brdf, n))}" for n in parameters_of(type(brdf)) if getattr(brdf, n) is not None
    ]
    defaults = {f.name: f.default for f in dataclasses.fields(type(brdf))}
    options = [f'{o}="{getattr(brdf, o)}"' for o in options_of(type(brdf)) if getattr(brdf, o) != defaults[o]]
    return f"{name_of(type(brdf))}({', '.join([*values, *options])})"


def bssrdf_expression(bssrdf: AbstractBSSRDF) -> str:
    """The expression of a model of light below the surface."""
    kind = type(bssrdf)
    name = next((n for n, known in BSSRDFS.items() if known is kind), None)
    if name is None:
        raise GonioError(f"A {kind.__name__} has no expression; only {', '.join(BSSRDFS)} have one.")
    values = {n: getattr(bssrdf, n) for n in parameters_of(kind)}
    return f"{name}({', '.join(f'{n}={_number_text(jnp.asarray(v))}' for n, v in values.items() if v is not None)})"


def terms_to_expression(spelled: tuple[Term, ...]) -> str:
    """The text of parsed terms, with what is free in them."""

    def value_text(v: Value, sign: str = "=") -> str:
        if v.number is None:
            return sign + ("?" if v.each is None else "each" if v.each else "shared")
        return f"{'~' if v.free else sign}{_number_text(as_array(v.number))}"

    texts = []
    for t in spelled:
        inside = [f"{field}={terms_to_expression(parts)}" for field, parts in t.call.models.items()]
        inside += [f"{n}{value_text(v)}" for n, v in t.call.values.items()]
        inside += [f'{n}="{v}"' for n, v in t.call.options.items()]
        factor = "" if t.scale is None else value_text(t.scale, "") + " * "
        texts.append(f"{factor}{t.call.name}({', '.join(inside)})")
    return " + ".join(texts)


def model_names(frames: tuple[Frame, ...]) -> list[str]:
    """A name for each model of a sum: its own, numbered where a model comes more than once."""
    names = [f.name for f in frames]
    return [n if names.count(n) == 1 else f"{n}{names[: i + 1].count(n)}" for i, n in enumerate(names)]


def number_label(frames: tuple[Frame, ...], term: int, path: str) -> str:
    """The name of the number at a path of a term: 'ggx.alpha', or 'coat.base.lambert.rho' inside another model."""
    words, steps = [model_names(frames)[term]], path.split(".")
    inside = frames[term]
    while len(steps) > 1:
        field, index, *steps = steps
        frames = dict(inside.inside)[field]
        inside = frames[int(index)]
        words += [field, model_names(frames)[int(index)]]
    return ".".join([*words, *steps])

"""The wavelengths that models of waves take, from a table's channels and for them."""

import dataclasses
from collections.abc import Iterator, Sequence

import equinox as eqx
import numpy as np

from gonio.models.brdf import AbstractBRDF
from gonio.models.catalog import MODELS
from gonio.models.expression.parser import Call, Term, Value
from gonio.models.parameters import parameters_of


def _wavelength_names(model_class: type) -> list[str]:
    return [name for name, info in parameters_of(model_class).items() if info.role == "wavelength"]


def with_wavelengths(terms: tuple[Term, ...], wavelengths_nm: Sequence[float] | None) -> tuple[Term, ...]:
    """The terms with the channels' wavelengths for each parameter that is one and was not mentioned, in µm.

    `wavelengths_nm` None (channels without wavelengths): the terms as they are.
    """
    if wavelengths_nm is None:
        return terms
    numbers = [_micrometres(w) for w in wavelengths_nm]
    value = Value(tuple(numbers) if len(numbers) > 1 else numbers[0])
    return tuple(_completed(term, value) for term in terms)


def _completed(term: Term, value: Value) -> Term:
    known = _wavelength_names(MODELS[term.call.name])
    values = {**dict.fromkeys(known, value), **term.call.values}
    inside = {field: tuple(_completed(t, value) for t in parts) for field, parts in term.call.models.items()}
    return dataclasses.replace(term, call=Call(term.call.name, values, term.call.options, inside))


def _micrometres(wavelength_nm: float) -> float:
    return float(f"{wavelength_nm / 1000:.12g}")


def wavelengths_of(brdf: AbstractBRDF) -> tuple[float, ...] | None:
    """The wavelengths, nm, that all parts of a model agree on, one for each channel; None where they name none."""
    known = [np.atleast_1d(np.asarray(a, float)) for a in _values(brdf)]
    if not known or any(not np.array_equal(a, known[0]) for a in known):
        return None
    return tuple(float(f"{1000 * w:.12g}") for w in known[0])


def _values(model: object) -> Iterator[object]:
    if isinstance(model, tuple):
        for part in model:
            yield from _values(part)
    elif isinstance(model, eqx.Module):
        names = _wavelength_names(type(model))
        for field in dataclasses.fields(model):
            value = getattr(model, field.name)
            yield from (value,) if field.name in names else _values(value)

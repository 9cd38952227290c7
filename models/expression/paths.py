"""The numbers of a spelled term by their paths: ``alpha``, ``scale``, and inside another model ``base.0.rho``."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from gonio.models.brdf import SCALE
from gonio.models.catalog import MODELS
from gonio.models.expression.parser import Call, Term, Value
from gonio.models.parameters import ParameterInfo, parameters_of

FACTOR = "scale"


class ParameterRef(NamedTuple):
    """A number that an expression says: where it stands, what was said, what it is, and the model it belongs to."""

    path: str
    value: Value
    info: ParameterInfo
    call: Call


def last(path: str) -> str:
    """The parameter's own name at the end of a path."""
    return path.rsplit(".", 1)[-1]


def numbers(term: Term, prefix: str = "") -> Iterator[ParameterRef]:
    """The numbers of a term: its parameters, its scale, then those of the models inside it."""
    known = parameters_of(MODELS[term.call.name])
    for name, value in term.call.values.items():
        yield ParameterRef(prefix + name, value, known[name], term.call)
    if term.scale is not None:
        yield ParameterRef(prefix + FACTOR, term.scale, SCALE, term.call)
    for field, inside in term.call.models.items():
        for index, part in enumerate(inside):
            yield from numbers(part, f"{prefix}{field}.{index}.")


def changed(term: Term, change: Callable[[str, Value], Value], prefix: str = "") -> Term:
    """The term with every number replaced by what `change(path, value)` answers."""
    values = {n: change(prefix + n, v) for n, v in term.call.values.items()}
    scale = None if term.scale is None else change(prefix + FACTOR, term.scale)
    inside = {
        field: tuple(changed(part, change, f"{prefix}{field}.{index}.") for index, part in enumerate(parts))
        for field, parts in term.call.models.items()
    }
    return Term(scale, Call(term.call.name, values, term.call.options, inside))


def calls(terms: tuple[Term, ...]) -> Iterator[Call]:
    """Every model that is spelled, those inside others too."""
    for term in terms:
        yield term.call
        for inside in term.call.models.values():
            yield from calls(inside)

"""What is free in a spelled model, as data: which numbers a fit moves, what they are called, where they may be."""

import dataclasses

import numpy as np

from gonio.fitting.problem.domains import Domains, domain_kind
from gonio.models.catalog import MODELS
from gonio.models.expression.builder import Frame, frame
from gonio.models.expression.parser import Call, Term, Value, needed
from gonio.models.expression.paths import Number, last, numbers
from gonio.models.parameters import ParameterInfo, parameters_of


@dataclasses.dataclass(frozen=True)
class Group:
    """A free parameter of one term: a single number shared by the channels, or one number for each of them."""

    term: int
    name: str
    per_channel: bool
    linear: bool
    info: ParameterInfo
    first: int  # index of its first number in the vector of free numbers


@dataclasses.dataclass(frozen=True)
class Structure:
    """A model with its free numbers taken out; hashable, so that one compiled program serves all tables."""

    frames: tuple[Frame, ...]
    groups: tuple[Group, ...]
    channels: int
    size: int

    def columns(self, channel: int) -> np.ndarray:
        """The index, in the vector of free numbers, that each group has in one channel."""
        return np.array([g.first + (channel if g.per_channel else 0) for g in self.groups], dtype=int)


def with_defaults(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    """The terms with everything said that the expression's rules imply of a fit: omitted shapes and scales are free."""
    said = []
    for t in terms:
        values = dict(t.call.values)
        for name in needed(t.call):
            values.setdefault(name, Value(None, free=True))
        scale = t.scale
        if scale is None and MODELS[t.call.name].lobe:
            scale = Value(None, free=True)
        order = [n for n in parameters_of(MODELS[t.call.name]) if n in values]
        inside = {field: with_defaults(parts) for field, parts in t.call.models.items()}
        said.append(Term(scale, Call(t.call.name, {n: values[n] for n in order}, t.call.options, inside)))
    return tuple(said)


def _domain(n: Number) -> ParameterInfo:
    # A dielectric seen from outside has an index of at least 1; below, 1/eta gives nearly the same data.
    info = n.info
    if last(n.path) == "eta" and "k" not in n.call.values:
        info = dataclasses.replace(info, low=max(info.low, 1.0))
    # What stands inside another model is not what f is proportional to.
    return dataclasses.replace(info, linear=False) if "." in n.path else info


def structure_of(terms: tuple[Term, ...], channels: int) -> tuple[Structure, tuple[dict, ...], np.ndarray]:
    """(structure, fixed values of each term, start of the free numbers (P,); NaN where nothing was said).

    `terms` as `with_defaults` gives them. Values in lists have one number for each of the channels.
    """
    groups, fixed, start, size = [], [], [], 0
    for index, term in enumerate(terms):
        held: dict[str, np.ndarray] = {}
        for n in numbers(term):
            name, value, info = n.path, n.value, _domain(n)
            if not value.free:
                held[name] = np.asarray(value.number, float)
                continue
            listed = isinstance(value.number, tuple)
            usual = info.per_channel if value.each is None else value.each
            per_channel = channels > 1 and (usual or listed)
            groups.append(Group(index, name, per_channel, info.linear, info, size))
            count = channels if per_channel else 1
            number = np.nan if value.number is None else value.number
            start.append(np.broadcast_to(np.asarray(number, float), (count,)))
            size += count
        fixed.append(held)
    flat = np.concatenate(start) if start else np.empty(0)
    return Structure(tuple(frame(t) for t in terms), tuple(groups), channels, size), tuple(fixed), flat


def domains_of(s: Structure) -> Domains:
    """The closed domains of the free numbers, in their order."""
    per_number = [
        (domain_kind(g.info.low, g.info.log), g.info.low, g.info.high) for g in s.groups for _ in range(count(s, g))
    ]
    kind, low, high = (np.array(c) for c in zip(*per_number, strict=True)) if per_number else (np.empty(0),) * 3
    return Domains(kind.astype(int), low.astype(float), high.astype(float))


def count(s: Structure, g: Group) -> int:
    """How many free numbers a group has."""
    return s.channels if g.per_channel else 1


def _numbered(frames: tuple[Frame, ...]) -> list[str]:
    # A name for each model of a sum: its own, numbered where a model comes more than once.
    names = [f.name for f in frames]
    return [n if names.count(n) == 1 else f"{n}{names[: i + 1].count(n)}" for i, n in enumerate(names)]


def label(s: Structure, term: int, path: str) -> str:
    """A number's name for people: 'ggx.alpha', or 'coat.base.lambert.rho' inside another model."""
    frames, said, parts = s.frames, [_numbered(s.frames)[term]], path.split(".")
    inside = frames[term]
    while len(parts) > 1:
        field, index, *parts = parts
        frames = dict(inside.inside)[field]
        inside = frames[int(index)]
        said += [field, _numbered(frames)[int(index)]]
    return ".".join([*said, *parts])


def labels(s: Structure) -> list[tuple[str, int | None]]:
    """(name such as 'ggx.alpha', channel or None) of each free number, in their order."""
    return [(label(s, g.term, g.name), c if g.per_channel else None) for g in s.groups for c in range(count(s, g))]

"""Models spelled in words, for people and files alike: ``lambert(rho=0.3) + 0.5 * ggx(alpha=0.2, f0=0.04)``.

    sum    := term ("+" term)*
    term   := [value "*"] (name ["(" [arguments] ")"] | "(" sum ")")
    argument := parameter "=" value | parameter "~" number-or-list | parameter "=" "?" | option "=" string
                | model "=" sum
    value  := number | "[" number ("," number)* "]" | "?" | "shared" | "each"

A list means channels. `name=?` is free in a fit, `name~v` free from that start, and an omitted shape parameter is free
too; `name=shared` is one free number for all channels, `name=each` one for each. To evaluate a model every parameter
must have a value. Some models stand over others, which are spelled inside:
``coat(base=lambert(rho=0.5), alpha=0.1, eta=1.5)``. The text is parsed here, never evaluated as code.
"""

import dataclasses
import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from gonio.models.brdf import SCALE
from gonio.models.catalog import MODELS
from gonio.models.errors import GonioError, nearest
from gonio.models.parameters import ParameterInfo, parameters_of
from gonio.models.subsurface.catalog import BSSRDFS

LONGEST = 200_000  # characters: a thousand wavelengths at full precision are a tenth of it
DEEPEST = 20
MOST_MODELS = 32  # each is compiled by itself: of 200 lobes it takes minutes
MOST_CHANNELS = 4096  # the check of 20,000 takes 5 GB
MOST_NESTED = 4  # models over models: compiling doubles with each
EXTENTS = ("shared", "each")  # free numbers: one for all channels, or one for each
SPELLED_SCALE = dataclasses.replace(SCALE, high=1e12)  # published fits have factors of 1e9; ours look up to 1e6

_TOKEN = re.compile(
    r"\s*(?:(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<string>\"[^\"]*\"|'[^']*')|(?P<sign>[-+*()=,~?\[\]]))"
)


@dataclasses.dataclass(frozen=True)
class Value:
    """What is said of a parameter: a number or one for each channel (None: not said), and whether a fit may move it.

    `each`: a free number for each channel (True), one for all (False), or what is usual for the parameter (None).
    """

    number: float | tuple[float, ...] | None = None
    free: bool = False
    each: bool | None = None


@dataclasses.dataclass(frozen=True)
class Call:
    """One model by its name, with what was said of its parameters, its options (such as `smith`), and models inside."""

    name: str
    values: dict[str, Value]
    options: dict[str, str]
    models: "dict[str, tuple[Term, ...]]" = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Term:
    """A scaled model. `scale` is None where the expression has no factor."""

    scale: Value | None
    call: Call


BRDF_FORM = "lambert(rho=0.3) + 0.5 * ggx(alpha=0.2)"
BSSRDF_FORM = "dipole(sigma_a=0.01, sigma_s=1, eta=1.3)"


class _Parser:
    def __init__(self, text: str, models: Mapping[str, type] = MODELS, form: str = BRDF_FORM) -> None:
        self.models, self.form = models, form
        if len(text) > LONGEST:
            raise GonioError(f"A model expression of {len(text)} characters came; at most {LONGEST} are read.")
        self.text, self.tokens, self.next_token, self.nested = text, [], 0, 0
        position, end = 0, len(text.rstrip())
        while position < end:
            match = _TOKEN.match(text, position)
            if match is None:
                bad = text[position:].strip()[:1]
                raise self.error(f"the character {bad!r} has no meaning in it")
            kind = str(match.lastgroup)
            self.tokens.append((kind, match[kind]))
            position = match.end()

    def error(self, what: str) -> GonioError:
        text = self.text if len(self.text) <= 80 else self.text[:77] + "..."
        return GonioError(f"Cannot read the model '{text}': {what}. Expected a form like '{self.form}'.")

    def peek(self) -> tuple[str, str]:
        return self.tokens[self.next_token] if self.next_token < len(self.tokens) else ("end", "the end")

    def take(self) -> tuple[str, str]:
        token = self.peek()
        self.next_token += 1
        return token

    def accept(self, sign: str) -> bool:
        if self.peek() == ("sign", sign):
            self.next_token += 1
            return True
        return False

    def expect(self, sign: str) -> None:
        if not self.accept(sign):
            raise self.error(f"'{sign}' expected where {self.peek()[1]!r} came")

    def sum(self, depth: int = 0) -> list[Term]:
        if depth > DEEPEST:
            raise self.error(f"more than {DEEPEST} brackets inside one another")
        terms = self.term(depth)
        while True:
            kind, text = self.peek()
            if kind == "number" and text[0] == "+":  # "a +2 * b": the sign belongs to the sum
                self.tokens[self.next_token] = (kind, text[1:])
            elif not self.accept("+"):
                return terms
            terms += self.term(depth)

    def term(self, depth: int) -> list[Term]:
        scale = None
        if self.peek()[0] == "number" or self.peek()[1] in ("[", "?", "~", *EXTENTS):
            free = self.accept("~")
            scale = self.value(SPELLED_SCALE, "a scale")
            scale = dataclasses.replace(scale, free=free or scale.free)
            self.expect("*")
        if self.accept("("):
            inner = self.sum(depth + 1)
            self.expect(")")
            return inner if scale is None else [Term(self.product(scale, t.scale), t.call) for t in inner]
        return [Term(scale, self.call(depth))]

    def product(self, a: Value, b: Value | None) -> Value:
        if b is None:
            return a
        if a.number is None or b.number is None:
            raise self.error("a free scale around a scaled term has no single meaning; give one scale a term")
        counts = [len(v.number) for v in (a, b) if isinstance(v.number, tuple)]
        if len(set(counts)) > 1:
            raise self.error(f"scales of {counts[0]} and {counts[1]} channels multiply each other")
        number = (np.asarray(a.number) * np.asarray(b.number)).tolist()
        return Value(tuple(number) if counts else number, a.free or b.free)

    def call(self, depth: int) -> Call:
        kind, name = self.take()
        if kind != "name":
            raise self.error(f"a model's name expected where {name!r} came")
        if name not in self.models:
            if name in BSSRDFS:
                raise GonioError(
                    f"{name} is light below the surface, a BSSRDF and no term of a BRDF: it stands alone, and is "
                    "fitted to a profile (gonio measure MATERIAL --scan offsets)"
                )
            raise GonioError(f"Unknown model '{name}'; {nearest(name, self.models)}")
        known, options = parameters_of(self.models[name]), options_of(self.models[name])
        values: dict[str, Value] = {}
        chosen: dict[str, str] = {}
        inside: dict[str, tuple[Term, ...]] = {}
        if not self.accept("("):  # a bare name: nothing is said of its parameters
            return self.whole(Call(name, values, chosen, inside))
        while not self.accept(")"):
            kind, key = self.take()
            if kind != "name":
                raise self.error(f"a parameter's name expected where {key!r} came")
            if key in values or key in chosen or key in inside:
                raise self.error(f"{key} is given twice")
            if key in options:
                self.expect("=")
                chosen[key] = self.option(name, key, options[key])
            elif key in submodels_of(self.models[name]):
                self.expect("=")
                inside[key] = self.over(depth)
            elif key in known:
                free = self.accept("~")
                if not free:
                    self.expect("=")
                value = self.value(known[key], f"{name}'s {key}")
                values[key] = dataclasses.replace(value, free=free or value.free)
            else:
                names = [*known, *options, *submodels_of(self.models[name])]
                raise GonioError(f"{name} has no parameter '{key}'; {nearest(key, names) if names else 'it has none.'}")
            if self.peek() != ("sign", ")"):
                self.expect(",")
        return self.whole(Call(name, values, chosen, inside))

    def over(self, depth: int) -> tuple[Term, ...]:
        self.nested += 1
        if self.nested > MOST_NESTED:
            raise self.error(f"more than {MOST_NESTED} models stand over one another")
        terms = tuple(self.sum(depth + 1))
        self.nested -= 1
        return terms

    def whole(self, call: Call) -> Call:
        for name in submodels_of(self.models[call.name]):
            if name not in call.models:
                raise self.error(f"{call.name} stands over another model; say which, as in {name}=lambert(rho=0.5)")
        if self.models is MODELS:
            require_one_fresnel(call)
            require_its_options(call)
        return call

    def option(self, model: str, key: str, choices: tuple[str, ...]) -> str:
        kind, text = self.take()
        text = text.strip("\"'")
        if kind not in ("string", "name", "number") or (choices and text not in choices):
            raise GonioError(
                f"{model}'s {key} is '{text}'; {nearest(text, choices) if choices else 'give a text in quotes.'}"
            )
        return text

    def number(self, info: ParameterInfo, what: str) -> float:
        kind, text = self.take()
        following = self.peek()
        # A number may bring a sign of its own: two are none.
        if kind == "sign" and text in "+-" and following[0] == "number" and following[1][0] not in "+-":
            text += self.take()[1]
        elif kind != "number":
            raise self.error(f"{what} is a number or a list of them, not {text!r}")
        number = float(text)
        if not info.low <= number <= info.high:
            raise GonioError(
                f"{what} is {text}, outside of its domain [{info.low:g}, {info.high:g}]; give a value inside it."
            )
        return number

    def value(self, info: ParameterInfo, what: str) -> Value:
        if self.accept("?"):
            return Value(None, free=True)
        if self.peek()[1] in EXTENTS:
            return Value(None, free=True, each=self.take()[1] == "each")
        if not self.accept("["):
            return Value(self.number(info, what))
        numbers = [self.number(info, what)]
        while self.accept(","):
            numbers.append(self.number(info, what))
        self.expect("]")
        return Value(tuple(numbers))


def options_of(model_class: type) -> dict[str, tuple[str, ...]]:
    """The options of a model class (such as `smith`) with the choices of each; none where any text may be one."""
    fields = dataclasses.fields(model_class)
    return {f.name: f.metadata["choices"] for f in fields if "choices" in f.metadata}


def submodels_of(model_class: type) -> tuple[str, ...]:
    """The names of the models that a model class stands over."""
    return tuple(f.name for f in dataclasses.fields(model_class) if "model" in f.metadata)


def _values_of(terms: list[Term] | tuple[Term, ...]) -> Iterator[Value]:
    for t in terms:
        yield from t.call.values.values()
        if t.scale is not None:
            yield t.scale
        for inside in t.call.models.values():
            yield from _values_of(inside)


def parse(text: str) -> tuple[Term, ...]:
    """The terms of a spelled model; GonioError, in one sentence, for anything that is not one."""
    parser = _Parser(text)
    terms = parser.sum()
    if parser.peek()[0] != "end":
        raise parser.error(f"nothing more was expected where {parser.peek()[1]!r} came")
    if (count := sum(1 for _ in calls(tuple(terms)))) > MOST_MODELS:
        raise parser.error(f"it has {count} models; give at most {MOST_MODELS}")
    _require_one_length(terms, parser)
    return tuple(terms)


def _require_one_length(terms: list[Term], parser: _Parser) -> None:
    lists = {len(v.number) for v in _values_of(terms) if isinstance(v.number, tuple)}
    if max(lists, default=0) > MOST_CHANNELS:
        raise parser.error(f"a list has {max(lists)} values, one a channel; give at most {MOST_CHANNELS}")
    if len(lists) > 1:
        raise parser.error(
            f"its lists have {' and '.join(map(str, sorted(lists)))} values; all lists are one value a channel"
        )


def parse_bssrdf(text: str) -> Call | None:
    """The model of light below the surface that a text spells; None where it begins with the name of none."""
    name = re.match(r"\s*(\w+)\s*(\(|$)", text)
    if name is None or name[1] not in BSSRDFS:
        return None
    parser = _Parser(text, BSSRDFS, BSSRDF_FORM)
    call = parser.call(0)
    if parser.peek()[0] != "end":
        raise parser.error(f"light below the surface stands alone, and {parser.peek()[1]!r} came behind it")
    _require_one_length([Term(None, call)], parser)
    return call


def require_one_fresnel(call: Call) -> None:
    """GonioError where a microfacet's parameters contradict each other."""
    given, known = call.values, parameters_of(MODELS[call.name])
    if "f0" in given and "eta" in given:
        raise GonioError(f"{call.name} has both f0 and eta; give f0 (Schlick) or eta (exact), not both.")
    if "k" in given and "eta" in known and "eta" not in given:
        raise GonioError(f"{call.name} has k without eta; give both for a conductor.")
    for name in ("alpha", "n"):
        along = (f"{name}_x" in given, f"{name}_y" in given)
        if name in given and any(along):
            raise GonioError(f"{call.name} has {name} and {name}_x or {name}_y; give {name}, or both of the others.")
        if along[0] != along[1]:
            raise GonioError(f"{call.name} has one of {name}_x and {name}_y; give both, or {name}.")


def chosen_option(call: Call, option: str) -> str:
    """The choice of an option: what was said, or the model's default."""
    defaults = {f.name: str(f.default) for f in dataclasses.fields(MODELS[call.name])}
    return call.options.get(option, defaults[option])


def require_its_options(call: Call) -> None:
    """GonioError for a parameter that goes with another choice of an option."""
    known = parameters_of(MODELS[call.name])
    for name in call.values:
        if (only := known[name].only) and chosen_option(call, only[0]) != only[1]:
            raise GonioError(
                f"{call.name}'s {name} goes with {only[0]}={only[1]}; here {only[0]} is {chosen_option(call, only[0])}."
            )


def needed(call: Call) -> tuple[str, ...]:
    """The parameters that a model cannot do without, in its order: those without a default, of its options, its width.

    A model with widths along x and y has `alpha` (or `n`) or both of the others.
    """
    fields = {f.name: f for f in dataclasses.fields(MODELS[call.name]) if "parameter" in f.metadata}
    for name in ("alpha", "n"):
        if f"{name}_x" in fields:
            widths = (f"{name}_x", f"{name}_y") if f"{name}_x" in call.values else (name,)
            break
    else:
        widths = ()

    def needs(field: dataclasses.Field) -> bool:
        only = field.metadata["parameter"].only
        return field.default is dataclasses.MISSING or (only is not None and chosen_option(call, only[0]) == only[1])

    return tuple(n for n, f in fields.items() if n in widths or needs(f))


FACTOR = "scale"


class ParameterRef(NamedTuple):
    """A number of an expression: its path, its own name, its value, what it is, and the model it belongs to."""

    path: str
    name: str
    value: Value
    info: ParameterInfo
    call: Call


def numbers(term: Term, prefix: str = "") -> Iterator[ParameterRef]:
    """The numbers of a term: its parameters, its scale, then those of the models inside it."""
    known = parameters_of(MODELS[term.call.name])
    for name, value in term.call.values.items():
        yield ParameterRef(prefix + name, name, value, known[name], term.call)
    if term.scale is not None:
        yield ParameterRef(prefix + FACTOR, FACTOR, term.scale, SCALE, term.call)
    for field, inside in term.call.models.items():
        for index, part in enumerate(inside):
            yield from numbers(part, f"{prefix}{field}.{index}.")


def changed(term: Term, values_of: Mapping[str, Value], prefix: str = "") -> Term:
    """The term with the numbers at some paths replaced."""
    values = {n: values_of.get(prefix + n, v) for n, v in term.call.values.items()}
    scale = None if term.scale is None else values_of.get(prefix + FACTOR, term.scale)
    inside = {
        field: tuple(changed(part, values_of, f"{prefix}{field}.{index}.") for index, part in enumerate(parts))
        for field, parts in term.call.models.items()
    }
    return Term(scale, Call(term.call.name, values, term.call.options, inside))


def calls(terms: tuple[Term, ...]) -> Iterator[Call]:
    """Every model that is spelled, those inside others too."""
    for term in terms:
        yield term.call
        for inside in term.call.models.values():
            yield from calls(inside)


def with_defaults(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    """The terms with what an expression implies written out: omitted shapes and scales are free."""
    complete = []
    for t in terms:
        values = dict(t.call.values)
        for name in needed(t.call):
            values.setdefault(name, Value(None, free=True))
        scale = t.scale
        if scale is None and MODELS[t.call.name].lobe:
            scale = Value(None, free=True)
        order = [n for n in parameters_of(MODELS[t.call.name]) if n in values]
        inside = {field: with_defaults(inner) for field, inner in t.call.models.items()}
        complete.append(Term(scale, Call(t.call.name, {n: values[n] for n in order}, t.call.options, inside)))
    return tuple(complete)

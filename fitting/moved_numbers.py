"""A fitted model with one of its numbers changed, in one channel or in several."""

from collections.abc import Mapping, Sequence

from gonio.models.brdf import AbstractBRDF
from gonio.models.expression.builder import build, frame, number_label
from gonio.models.expression.parser import Value, changed, numbers, parse


def with_number(
    expression: str, channels: Sequence[str], name: str, values: Mapping[str | None, float]
) -> AbstractBRDF:
    """The model of a complete expression with other values of one number.

    Args:
        expression: with all numbers given.
        channels: names of the channels, in the order of numbers that have a value for each.
        name: of the number, such as "ggx.alpha".
        values: by channel, or by None for all of them; channels that are not among them keep theirs.
    """
    terms = parse(expression)
    frames = tuple(frame(t) for t in terms)

    def value_at(v: Value) -> Value:
        if None in values or not isinstance(v.number, tuple):
            return Value(next(iter(values.values())))
        return Value(tuple(map(values.get, channels, v.number)))

    moved = (
        changed(t, {n.path: value_at(n.value) for n in numbers(t) if number_label(frames, k, n.path) == name})
        for k, t in enumerate(terms)
    )
    return build(tuple(moved))

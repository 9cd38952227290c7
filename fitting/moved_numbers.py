"""A fitted model with one of its numbers changed, in one channel or in several."""

import dataclasses
from collections.abc import Mapping, Sequence

from gonio.models.brdf import AbstractBRDF
from gonio.models.expression.builder import build, build_bssrdf, frame, number_label
from gonio.models.expression.parser import Value, changed, numbers, parse, parse_bssrdf
from gonio.models.subsurface.wide_spots import WideSpots


def with_number(
    expression: str, channels: Sequence[str], name: str, values: Mapping[str | None, float]
) -> AbstractBRDF:
    """The model of a complete expression with other values of one number.

    Args:
        expression: with all numbers given; of light below a surface too.
        channels: names of the channels, in the order of numbers that have a value for each.
        name: of the number, such as "ggx.alpha".
        values: by channel, or by None for all of them; channels that are not among them keep theirs.
    """

    def value_at(v: Value) -> Value:
        if None in values or (len(channels) == 1 and not isinstance(v.number, tuple)):
            return Value(next(iter(values.values())))
        before = v.number if isinstance(v.number, tuple) else (v.number or 0.0,) * len(channels)
        return Value(tuple(map(values.get, channels, before)))

    if (below := parse_bssrdf(expression)) is not None:
        moved = {n: value_at(v) if f"{below.name}.{n}" == name else v for n, v in below.values.items()}
        return WideSpots(build_bssrdf(dataclasses.replace(below, values=moved)))
    terms = parse(expression)
    frames = tuple(frame(t) for t in terms)

    terms = tuple(
        changed(t, {n.path: value_at(n.value) for n in numbers(t) if number_label(frames, k, n.path) == name})
        for k, t in enumerate(terms)
    )
    return build(terms)

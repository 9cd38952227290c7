"""The form, and its numbers, for which a renderer's surface is nearest to a given one.

Each form is fitted from several starts, roughly at few directions, and the best of them to convergence at more. What
was fitted is judged by the error that is told of an export, at other and more directions still.
"""

import dataclasses

import numpy as np

from gonio.exports.comparison import SHOWN, Comparison, comparison
from gonio.exports.forms import Appearance, Form, Number, Values
from gonio.exports.search import Search, least_width, start_widths

ROUGH, FINE, JUDGED = (6, 20, 8), (10, 32, 8), (16, 64, 16)
"""Lights, tilts and azimuths of the half vectors: for starts, to converge, and to compare forms."""
TRIED, MOST = 8, 60
"""Steps of each start, and of the best one."""
PRECISION, LOOSE = 1e-9, 1e-4
ALIKE, LITTLE = 4 / 3, 0.01
"""Of the least relative rms, and more than it: up to which forms are judged by what they show elsewhere too."""
NEARER = 0.9
"""Share of an error of a simpler form at which another one is worth its numbers."""
GAIN, MOST_GAIN, FURTHER = 0.02, 0.1, 1.5
"""Light made, of all of it, up to which a form is as good as another; up to which it is taken where the others are so
many times as far; and that factor."""
UNRESOLVED = 0.05
"""Relative difference of the albedo by two grids of directions at which they are too coarse for the surface."""
SAME = 1e-7
"""Relative rms at which nothing is nearer."""
NEAR = 1e-5
"""Of a bound, in units of the range."""


@dataclasses.dataclass(frozen=True)
class Nearest:
    """A form with its numbers.

    `relative_rms`: of f, cosine-weighted; `shown`: of cube roots of what is seen; `light_made`: share that is reflected
    beyond all; `others`: the other forms, the nearest first; `resolved`: whether the directions resolve the surface.
    """

    form: Form
    values: Values
    relative_rms: float
    shown: float = 0.0
    light_made: float = 0.0
    others: tuple["Nearest", ...] = ()
    resolved: bool = True


def nearest(forms: tuple[Form, ...], sought: Appearance) -> Nearest:
    """The form with the least cosine-weighted rms of f, after a search of each.

    Of forms that come about as near, the one is taken that is nearest elsewhere than in highlights too, or that has
    fewer numbers; none that is further than the simplest one.
    """
    rough, fine, judged = (comparison(sought, grid) for grid in (ROUGH, FINE, JUDGED))
    widths = start_widths(sought, rough)
    narrowest = least_width(sought, rough)
    fitted: list[Nearest] = []
    for form in forms:
        search = Search(form, sought.colours, narrowest)
        begins = search.starts(widths, [dict(n.values) for n in sorted(fitted, key=lambda n: n.relative_rms)[:2]])
        solutions = [search.solved(x, rough, TRIED, LOOSE) for x in begins]
        _, x = search.solved(min(solutions, key=lambda t: t[0])[1], fine, MOST, PRECISION)
        fitted.append(_judged(form, search.values(x), judged))
        if fitted[-1].relative_rms < SAME:
            break
    chosen = _chosen(fitted, sought)
    others = sorted((n for n in fitted if n is not chosen), key=lambda n: n.relative_rms)
    resolved = abs(fine.scattered - judged.scattered) <= UNRESOLVED * judged.scattered
    return dataclasses.replace(chosen, others=tuple(others), resolved=resolved)


def _judged(form: Form, values: Values, judged: Comparison) -> Nearest:
    rounded = {n.name: _rounded(n, values[n.name]) for n in form.numbers}
    f = judged.values(form, rounded)
    return Nearest(form, rounded, judged.relative_rms(f), judged.shown(f), judged.light_made(f))


def _chosen(fitted: list[Nearest], sought: Appearance) -> Nearest:
    fitted = [n for n in fitted if n.light_made <= MOST_GAIN] or fitted
    keeping = [n for n in fitted if n.light_made <= GAIN]
    if keeping and min(map(_distance, keeping)) <= FURTHER * min(map(_distance, fitted)):
        fitted = keeping
    by_size = sorted(fitted, key=lambda n: sum(sought.colours if k.coloured else 1 for k in n.form.numbers))
    least = min(n.relative_rms for n in fitted)
    bound = min(max(ALIKE * least, least + LITTLE), by_size[0].relative_rms)
    best, *others = (n for n in by_size if n.relative_rms <= bound)
    for other in others:
        clearly = other.shown < NEARER * best.shown or other.relative_rms < NEARER * best.relative_rms
        if clearly and _distance(other) < _distance(best):
            best = other
    return best


def _distance(n: Nearest) -> float:
    return float(np.hypot(n.relative_rms, SHOWN * n.shown))


def _rounded(n: Number, value: np.ndarray) -> np.ndarray:
    """To the digits that a search and a renderer have, and onto a bound that is as near."""
    near = NEAR * (n.high - n.low)
    value = np.where(np.abs(value - n.low) < near, n.low, np.where(np.abs(value - n.high) < near, n.high, value))
    return np.array([float(f"{v:.6g}") for v in value]) if n.coloured else np.asarray(float(f"{float(value):.6g}"))

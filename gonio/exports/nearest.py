"""The numbers for which a renderer's form of a surface is nearest to a given one, by least squares.

Compared are cube roots of π f cosθi, as a fit of a table does, over directions of which half are spread as a diffuser
reflects and half as the surface itself does, and cube roots of the albedo of each incidence.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, cast

import numpy as np
from scipy.optimize import least_squares

from gonio.exports.forms import Appearance, Form, Number, Values
from gonio.exports.pairs import Pairs

DARK = 1e-4
"""Of π f cosθi: what is darker counts by its difference."""
LIGHTS, TILTS, AZIMUTHS = 10, 28, 8
WIDTHS = (0.03, 0.12, 0.4)
"""At which lobes begin, where the surface does not say them."""
NARROWER, NARROWEST = 0.25, 0.05
"""Width of a lobe, at least: in units of the surface's narrowest, and where that is not known."""
TRIED, MOST, POLISHED = 6, 100, 2
"""Steps of each start, and of the best ones; how many are best."""
NEARER = 0.9
"""Share of the distance of a simpler form at which a later one is worth its numbers."""
STEP = 1e-7
"""Of a number's range, for slopes."""

NEAR = 1e-5
"""Of a bound, in units of the range."""

Compare = Callable[[np.ndarray], np.ndarray]


@dataclasses.dataclass(frozen=True)
class Nearest:
    """The numbers of a form, and the root of the mean squared difference of what was compared."""

    form: Form
    values: Values
    distance: float


def nearest(forms: tuple[Form, ...], sought: Appearance) -> Nearest:
    """The form, and its numbers, nearest to a surface; a later form must be clearly nearer than an earlier one."""
    pairs = sought.pairs(LIGHTS, TILTS, AZIMUTHS)
    compare = _comparison(pairs, sought.f(pairs.wi, pairs.wo))
    # A spike that lights nothing costs nothing here, but is seen
    narrowest = NARROWER * sought.widths[0] if sought.widths else NARROWEST
    screened = [
        (_Search(form, compare, pairs, sought.colours, narrowest), start)
        for form in forms
        for start in starts(form, sought)
    ]
    steps = [search.solved(x, TRIED) for search, x in screened]
    order = np.argsort([cost for cost, _ in steps])
    polished = [(screened[k][0], *screened[k][0].solved(steps[k][1], MOST)) for k in sorted(order[:POLISHED])]
    best = polished[0]
    for other in polished[1:]:
        same, factor = best[0].form is other[0].form, NEARER
        simpler = other[0].size < best[0].size
        if other[1] < best[1] * (1.0 if same else 1 / factor**2 if simpler else factor**2):
            best = other
    search, cost, x = best
    values = {n.name: _rounded(n, search.values(x)[n.name]) for n in search.form.numbers}
    return Nearest(search.form, values, float(np.sqrt(2 * cost / sought.colours)))


def _rounded(n: Number, value: np.ndarray) -> np.ndarray:
    """To the digits that a search and a renderer have, and onto a bound that is as near."""
    near = NEAR * (n.high - n.low)
    value = np.where(np.abs(value - n.low) < near, n.low, np.where(np.abs(value - n.high) < near, n.high, value))
    return np.array([float(f"{v:.6g}") for v in value]) if n.coloured else np.asarray(float(f"{float(value):.6g}"))


def _comparison(pairs: Pairs, wanted: np.ndarray) -> Compare:
    """Residuals (n + lights, C) of values (n, C)."""
    mean = np.maximum(wanted.mean(axis=1), 0.0)
    reflected = pairs.albedo(mean[:, None])[:, 0]
    share = pairs.flux / np.pi + pairs.flux * mean / np.maximum(reflected, 1e-30)[pairs.incidence]
    weight = np.sqrt(0.5 * pairs.share[pairs.incidence] * share)[:, None]
    exposure, of_light = np.pi * pairs.wi.z[:, None], np.sqrt(pairs.share)[:, None]

    def root(v: np.ndarray) -> np.ndarray:
        return np.cbrt(np.maximum(v, 0.0) + DARK)

    points, albedos = root(wanted * exposure), root(pairs.albedo(wanted))

    def compare(f: np.ndarray) -> np.ndarray:
        f = np.broadcast_to(f, wanted.shape)
        return np.concatenate([weight * (root(f * exposure) - points), of_light * (root(pairs.albedo(f)) - albedos)])

    return compare


class _Search:
    """Least squares over the numbers of one form."""

    def __init__(self, form: Form, compare: Compare, pairs: Pairs, colours: int, narrowest: float) -> None:
        self.form, self.compare, self.pairs, self.colours = form, compare, pairs, colours
        each = [n for n in form.numbers for _ in range(colours if n.coloured else 1)]
        self.size = len(each)
        self.low, self.high = (np.array([_inner(n, getattr(n, end)) for n in each]) for end in ("low", "high"))
        widths = np.array([n.width for n in each], bool)
        self.low = np.where(widths, np.maximum(self.low, np.log(narrowest)), self.low)

    def values(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """The numbers by their names."""
        values, position = {}, 0
        for n in self.form.numbers:
            size = self.colours if n.coloured else 1
            v = np.exp(x[position : position + size]) if n.log else x[position : position + size]
            values[n.name] = v if n.coloured else v[0]
            position += size
        return values

    def _residuals(self, x: np.ndarray) -> np.ndarray:
        return self.compare(self.form.f(self.values(x), self.pairs))

    def _slopes(self, x: np.ndarray) -> np.ndarray:
        """By forward differences; a colour moves its own channel alone, so all three move at once."""
        base, position = self._residuals(x), 0
        slopes = np.zeros((*base.shape, x.size))
        step = STEP * (self.high - self.low) * np.where(x > 0.5 * (self.low + self.high), -1.0, 1.0)
        for n in self.form.numbers:
            size = self.colours if n.coloured else 1
            together = n.coloured and not self.form.colours_mix
            for moved in (
                [slice(position, position + size)]
                if together
                else [slice(k, k + 1) for k in range(position, position + size)]
            ):
                y = x.copy()
                y[moved] += step[moved]
                change = self._residuals(y) - base
                for c, k in enumerate(range(moved.start, moved.stop)):
                    channel = slice(c, c + 1) if together else slice(None)
                    slopes[:, channel, k] = change[:, channel] / step[k]
            position += size
        return slopes.reshape(-1, x.size)

    def solved(self, x: np.ndarray, most: int) -> tuple[float, np.ndarray]:
        """(½ Σ of squares, numbers) after some steps from a start."""
        if x.size == 0:
            return 0.5 * float(np.sum(self._residuals(x) ** 2)), x
        margin = 1e-6 * (self.high - self.low)
        inside, slopes = np.clip(x, self.low + margin, self.high - margin), cast(Any, self._slopes)
        solution = least_squares(
            lambda y: self._residuals(y).ravel(), inside, slopes, bounds=(self.low, self.high),
            x_scale=self.high - self.low, max_nfev=most, ftol=1e-10, xtol=1e-10, gtol=1e-12,
        )  # fmt: skip
        return float(solution.cost), solution.x


def starts(form: Form, sought: Appearance) -> list[np.ndarray]:
    """Where a search begins: at the widths of the surface's lobes where they are known, else at some."""
    lobes = [n.name for n in form.numbers if n.width]
    known = sought.widths
    if not lobes:
        choices = [()]
    elif known:
        choices = [tuple(known[min(k, len(known) - 1)] for k in range(len(lobes)))]
        choices += [choices[0][::-1]] * (len(set(choices[0])) > 1)
    else:
        choices = [tuple(WIDTHS[(k + j) % len(WIDTHS)] for k in range(len(lobes))) for j in range(len(WIDTHS))]
    begins = []
    for widths in choices:
        of = dict(zip(lobes, widths, strict=True))
        values = [(n, _inner(n, float(np.clip(of.get(n.name, n.start), n.low, n.high)))) for n in form.numbers]
        begins.append(np.array([v for n, v in values for _ in range(sought.colours if n.coloured else 1)]))
    return begins


def _inner(n: Number, value: float) -> float:
    return float(np.log(value)) if n.log else value

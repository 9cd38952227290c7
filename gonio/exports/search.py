"""Least squares over the numbers of one form, from several starts."""

import itertools
from collections.abc import Iterable
from typing import Any, cast

import numpy as np
from scipy.optimize import least_squares

from gonio.exports.comparison import Comparison
from gonio.exports.forms import Appearance, Form, Number

WIDTHS = (0.03, 0.12, 0.4)
"""At which lobes begin, where the surface does not say them."""
MOST_WIDTHS, MOST_STARTS, RANDOM = 3, 6, 1
"""Widths of the surface from which starts are built, starts by widths, and starts of random numbers."""
NARROWER = 0.25
"""Width of a lobe, at least: in units of the surface's narrowest."""
STEP = 1e-7
"""Of a number's range, for slopes."""


class Search:
    """Least squares over the numbers of one form."""

    def __init__(self, form: Form, colours: int, narrowest: float) -> None:
        self.form, self.colours = form, colours
        each = [n for n in form.numbers for _ in range(colours if n.coloured else 1)]
        self.size = len(each)
        self.low, self.high = (np.array([inner(n, getattr(n, end)) for n in each]) for end in ("low", "high"))
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

    def residuals(self, x: np.ndarray, compared: Comparison) -> np.ndarray:
        return compared.residuals(compared.values(self.form, self.values(x)))

    def _slopes(self, x: np.ndarray, compared: Comparison) -> np.ndarray:
        """By forward differences; a colour moves its own channel alone, so all three move at once."""
        base, position = self.residuals(x, compared), 0
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
                change = self.residuals(y, compared) - base
                for c, k in enumerate(range(moved.start, moved.stop)):
                    channel = slice(c, c + 1) if together else slice(None)
                    slopes[:, channel, k] = change[:, channel] / step[k]
            position += size
        return slopes.reshape(-1, x.size)

    def solved(self, x: np.ndarray, compared: Comparison, most: int, precision: float) -> tuple[float, np.ndarray]:
        """(½ Σ of squares, numbers) after at most so many steps from a start."""
        if x.size == 0:
            return 0.5 * float(np.sum(self.residuals(x, compared) ** 2)), x
        margin = 1e-6 * (self.high - self.low)
        inside = np.clip(x, self.low + margin, self.high - margin)
        solution = least_squares(
            lambda y: self.residuals(y, compared).ravel(), inside, cast(Any, lambda y: self._slopes(y, compared)),
            bounds=(self.low, self.high), x_scale=self.high - self.low, max_nfev=most, ftol=precision, xtol=precision,
            gtol=1e-12,
        )  # fmt: skip
        return float(solution.cost), solution.x

    def starts(self, widths: Iterable[float], others: Iterable[dict[str, np.ndarray]]) -> list[np.ndarray]:
        """Where to begin: with lobes of each of the widths, at what other forms ended with, and at random numbers."""
        lobes = [n.name for n in self.form.numbers if n.width]
        alphas = list(widths)[:MOST_STARTS]
        mixed = [c for c in itertools.product(alphas, repeat=len(lobes)) if len({*c}) == min(len(c), len(alphas))]
        begins = [self._at(dict(zip(lobes, c, strict=True))) for c in mixed[:MOST_STARTS]]
        names = {n.name for n in self.form.numbers}
        begins += [self._at(other) for other in others if len(names & other.keys()) > 1]
        rng = np.random.default_rng(len(self.form.numbers))
        for _ in range(RANDOM if self.size else 0):
            begins.append(self.low + (self.high - self.low) * rng.uniform(0.1, 0.9, self.size))
        return begins

    def _at(self, known: dict[str, Any]) -> np.ndarray:
        values = []
        for n in self.form.numbers:
            size, v = self.colours if n.coloured else 1, np.atleast_1d(known.get(n.name, n.start))
            v = np.clip(np.broadcast_to(v if v.size in (1, size) else v.mean(), (size,)), n.low, n.high)
            values.append(np.log(v) if n.log else v)
        return np.concatenate(values) if values else np.zeros(0)


def inner(n: Number, value: float) -> float:
    """A number as it is sought."""
    return float(np.log(value)) if n.log else value


def start_widths(sought: Appearance, compared: Comparison) -> list[float]:
    """Widths at which lobes begin: the surface's own, that of its highlight where not all are known, and some."""
    known = sought.widths
    if known and (sought.widths_known or len(known) >= MOST_WIDTHS):
        return [known[k] for k in sorted({round(j) for j in np.linspace(0, len(known) - 1, MOST_WIDTHS)})]
    return [*known, highlight_width(compared), *WIDTHS][:MOST_WIDTHS]


def least_width(sought: Appearance, compared: Comparison) -> float:
    """Down to which lobes are sought: below the surface's own, a spike between the directions would cost nothing."""
    known = sought.widths[:1] or [WIDTHS[0]]
    return NARROWER * min(known[0], highlight_width(compared))


def highlight_width(compared: Comparison) -> float:
    """Tangent of the tilt of half vectors at which f, of the steepest light, has fallen to a quarter, as GGX's does."""
    pairs = compared.sides[0]
    steep = pairs.incidence == int(np.argmax(np.bincount(pairs.incidence)))
    z, f = pairs.h.z[steep], compared.wanted[: steep.size][steep].mean(axis=1)
    order = np.argsort(-z)
    bright = z[order][f[order] >= 0.25 * f.max()]
    tilt = float(np.arccos(bright.min())) if bright.size else 0.2
    return float(np.clip(np.tan(min(tilt, 1.2)), 1e-3, 0.8))

"""Where descents begin: from what was said, from the data, and at random.

Shapes are guessed; what the model is proportional to (albedos, scales) then follows from the data by non-negative
least squares, so that no descent begins with a lobe of the wrong strength.
"""

import itertools
from collections.abc import Sequence

import numpy as np

from gonio.fitting.problem.blocks import LANES, Samples
from gonio.fitting.problem.domains import LINEAR, LOG, Domains, mapped
from gonio.fitting.problem.losses import transform, uses_cosine
from gonio.fitting.problem.normal_equations import sums
from gonio.fitting.problem.parameterisation import Structure, count
from gonio.fitting.problem.readings import Readings, in_blocks
from gonio.models.expression.paths import last

WIDTHS = (0.02, 0.06, 0.15, 0.35, 0.7)
NARROWEST = 0.01  # of the widths drawn at random: a narrower lobe is found from there, a hidden one from nowhere
MOST_GUESSES = 12
GUESS_SAMPLES = 2048


def _is_width(name: str) -> bool:
    return last(name).startswith("alpha")


def guesses(s: Structure, said: np.ndarray) -> list[np.ndarray]:
    """Vectors (P,) of free numbers with shapes on a small grid of widths; linear numbers are still NaN."""
    widths = [g for g in s.groups if _is_width(g.name) and np.isnan(said[g.first])]
    terms = sorted({g.term for g in widths})
    choices = list(itertools.product(WIDTHS, repeat=len(terms)))
    if len(terms) > 1:
        # Lobes of one kind are interchangeable: only rising widths, and never two equal ones.
        choices = [c for c in choices if all(a < b for a, b in itertools.pairwise(c))] or choices
    step = max(1, -(-len(choices) // MOST_GUESSES))
    found = []
    for choice in choices[::step]:
        p = said.copy()
        for g in s.groups:
            block = slice(g.first, g.first + count(s, g))
            if g in widths:
                # Widths along x and y begin apart: at equal ones the two directions of brushing look alike.
                p[block] = choice[terms.index(g.term)] * {"alpha_x": 0.8, "alpha_y": 1.25}.get(last(g.name), 1.0)
            elif not g.linear:
                p[block] = np.where(np.isnan(p[block]), g.info.start, p[block])
        found.append(np.where(np.isnan(p), p, np.clip(p, *_inside(s))))
    return found


def _inside(s: Structure) -> tuple[np.ndarray, np.ndarray]:
    low, high = (np.array([getattr(g.info, b) for g in s.groups for _ in range(count(s, g))]) for b in ("low", "high"))
    return low, high


def random_shapes(s: Structure, d: Domains, said: np.ndarray, number: int, seed: int) -> list[np.ndarray]:
    """Vectors (P,) with every shape drawn at random in its domain, evenly in the coordinate of its map."""
    rng = np.random.default_rng(seed)
    low = np.array(
        [max(g.info.low, NARROWEST) if _is_width(g.name) else g.info.low for g in s.groups for _ in range(count(s, g))]
    )
    high = d.high
    u_low, u_high = (mapped(d.kind, b) for b in (low, high))
    linear = np.array([g.linear for g in s.groups for _ in range(count(s, g))], dtype=bool)
    found = []
    for _ in range(number):
        u = u_low + (u_high - u_low) * rng.random(s.size)
        p = np.where(
            d.kind == LINEAR,
            u,
            np.where(
                d.kind == LOG, np.exp(np.where(d.kind == LINEAR, 0.0, u)), np.expm1(np.where(d.kind == LINEAR, 0.0, u))
            ),
        )
        found.append(np.where(linear, said, p))
    return found


class LinearSolver:
    """Non-negative least squares for the linear numbers of a model, at given shapes, on the samples of first descents.

    In the measure of the loss, made linear at the readings.
    """

    def __init__(self, s: Structure, fixed, part: Readings, data: Samples, loss: str, weight: np.ndarray):
        self.s, self.fixed, self.loss = s, fixed, loss
        cosine = np.asarray(part.wi.z)[:, None] if uses_cosine(loss) else 1.0
        with np.errstate(all="ignore"):
            weight = weight * transform(loss, part.f * cosine, float(data.floor), np)[1] * cosine
        self.reach = np.sqrt(np.sum((weight * part.f) ** 2, axis=0))
        target, weight = (in_blocks(a, data.weight.shape) for a in (part.f, weight))
        self.data = data._replace(target=target, weight=weight)

    def __call__(self, shapes: Sequence[np.ndarray]) -> list[tuple[np.ndarray, float]]:
        """(p with its unsaid linear numbers solved, weighted sum of squares) of each; ∞ where it is not finite."""
        found = []
        for first in range(0, len(shapes), LANES):
            found += self._solved(np.stack(shapes[first : first + LANES]))
        return found

    def _solved(self, shapes: np.ndarray) -> list[tuple[np.ndarray, float]]:
        s = self.s
        unsaid = [g for g in s.groups if g.linear and np.isnan(shapes[0][g.first])]
        if all(count(s, g) == s.channels for g in unsaid):  # channel by channel
            at = np.array([[g.first + c for g in unsaid] for c in range(s.channels)], int)
        else:
            at = np.array([[g.first + c for g in unsaid for c in range(count(s, g))]], int)
        p = np.where(np.isnan(shapes), 1.0, shapes)
        total, _ = sums(s, self.loss, p, self.fixed, self.data, plain=True)
        finite = np.isfinite(total.cost) & np.isfinite(total.gradient).all(1) & np.isfinite(total.matrix).all((1, 2))
        matrix = np.where(finite[:, None, None], total.matrix, 0.0)[:, at[:, :, None], at[:, None, :]]
        gradient, now = np.where(finite[:, None], total.gradient, 0.0)[:, at], p[:, at]
        amount = _non_negative(matrix, np.einsum("sckl,scl->sck", matrix, now) - gradient)
        change = amount - now
        gain = np.sum(change * (gradient + 0.5 * np.einsum("sckl,scl->sck", matrix, change)), axis=(1, 2))
        # Not at the bound itself: there a start would see no slope.
        size = np.sqrt(np.diagonal(matrix, axis1=-2, axis2=-1))
        amount = np.maximum(amount, 1e-3 * self._reach()[at] / np.where(size > 0, size, np.inf))
        low, high = _inside(s)
        p[:, at] = np.clip(amount, low[at], high[at])
        cost = np.where(finite, total.cost + gain, np.inf)
        return list(zip(p, (2.0 * cost).tolist(), strict=True))

    def _reach(self) -> np.ndarray:
        """Size of the weighted readings that each free number acts on, (P,)."""
        every = float(np.sqrt(np.sum(self.reach**2)))
        return np.array(
            [self.reach[c] if g.per_channel else every for g in self.s.groups for c in range(count(self.s, g))]
        )


def _non_negative(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Least squares with x ≥ 0 of normal equations (..., K, K) and (..., K): the most negative is dropped in turn."""
    size, shape = vector.shape[-1], vector.shape
    if not size:
        return vector
    matrix, vector = matrix.reshape(-1, size, size), vector.reshape(-1, size)
    length2 = np.diagonal(matrix, axis1=1, axis2=2)
    kept, x = length2 > 0, np.zeros_like(vector)
    for _ in range(size):
        held = np.where(kept[:, :, None] & kept[:, None, :], matrix, 0.0)
        # A unit where nothing is asked; else a little more than nothing, for lobes that are the same.
        held[:, range(size), range(size)] += np.where(kept, 1e-12 * length2, 1.0)
        x = np.linalg.solve(held, np.where(kept, vector, 0.0)[..., None])[..., 0]
        negative = x.min(axis=1) < 0
        if not negative.any():
            break
        kept[negative, x.argmin(axis=1)[negative]] = False
    return np.maximum(x, 0.0).reshape(shape)

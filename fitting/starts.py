"""Where descents begin: from what was said, from the data, and at random.

Shapes are guessed; what the model is proportional to (albedos, scales) then follows from the data by non-negative
least squares, so that no descent begins with a lobe of the wrong strength.
"""

import itertools
from collections.abc import Sequence

import numpy as np

from gonio.fitting.domains import LINEAR, LOG, Domains, mapped
from gonio.fitting.equations import Samples, lobes
from gonio.fitting.losses import transform, uses_cosine
from gonio.fitting.samples import Readings
from gonio.fitting.structure import Structure, count
from gonio.models.paths import last

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
        self.s, self.fixed, self.data = s, fixed, data
        cosine = np.asarray(part.wi.z)[:, None] if uses_cosine(loss) else 1.0
        self.f = part.f.T
        self.weight = (weight * transform(loss, part.f * cosine, float(data.floor), np)[1] * cosine).T

    def __call__(self, shapes: Sequence[np.ndarray]) -> list[tuple[np.ndarray, float]]:
        """(p with its unsaid linear numbers solved, weighted sum of squares) of each; ∞ where it is not finite."""
        s, n = self.s, self.f.shape[1]
        linear = [(k, g) for k, g in enumerate(s.groups) if g.linear]
        unsaid = [k for k, g in linear if np.isnan(shapes[0][g.first])]
        p = [np.where(np.isnan(each), 1.0, each) for each in shapes]
        bases, rests = [], []
        for each in p:
            pages, strengths, factors = zip(*lobes(s, each, self.fixed, self.data), strict=True)
            found = np.concatenate([np.moveaxis(a, 0, 2) for a in pages], axis=2)
            found = found.reshape(*found.shape[:2], -1)[..., :n]  # (T, C or 1, n)
            strengths, factors = strengths[0][:, :, None], factors[0][:, :, None]
            basis = np.stack([found[s.groups[k].term] * factors[k] for k in unsaid]) if unsaid else found[:0] * self.f
            with np.errstate(invalid="ignore", over="ignore"):
                bases.append(basis * self.weight)
                rests.append((self.f - np.sum(found * strengths, 0) + np.sum(basis, 0)) * self.weight)
        basis, rest = np.stack(bases), np.stack(rests)  # (S, K, C, n), (S, C, n)
        finite = np.isfinite(rest).all((1, 2)) & np.isfinite(basis).all((1, 2, 3))
        basis, rest = (np.where(finite.reshape(-1, *[1] * (a.ndim - 1)), a, 0.0) for a in (basis, rest))
        amount = _non_negative(np.einsum("skcn,slcn->sckl", basis, basis), np.einsum("skcn,scn->sck", basis, rest))
        cost = np.sum((rest - np.einsum("skcn,sck->scn", basis, amount)) ** 2, axis=(1, 2))
        size = np.sqrt(np.einsum("skcn,skcn->sck", basis, basis))
        reach = np.where(size > 0, np.sqrt(np.sum(rest**2, -1))[..., None] / np.where(size > 0, size, 1.0), 0.0)
        # Not at the bound itself: there a start would see no slope.
        amount = np.maximum(amount, 1e-3 * reach)
        for k, at in enumerate(unsaid):
            g = s.groups[at]
            for each, found in zip(p, amount[..., k], strict=True):
                each[g.first : g.first + count(s, g)] = np.clip(
                    found if g.per_channel else found.mean(), g.info.low, g.info.high
                )
        return [(each, c if good else np.inf) for each, c, good in zip(p, cost.tolist(), finite, strict=True)]


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

"""Where descents begin: from what was said, from the data, and at random.

Shapes are guessed; what the model is proportional to (albedos, scales) then follows from the data by non-negative
least squares, so that no descent begins with a lobe of the wrong strength.
"""

import itertools

import jax.numpy as jnp
import numpy as np

from gonio.fitting.domains import LINEAR, LOG, Domains
from gonio.fitting.equations import lobes_at
from gonio.fitting.losses import transform, uses_cosine
from gonio.fitting.samples import Readings
from gonio.fitting.structure import Structure, count
from gonio.models.geometry import Direction
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
    u_low, u_high = (
        np.where(d.kind == LINEAR, b, np.where(d.kind == LOG, np.log(np.maximum(b, 1e-300)), np.log1p(b)))
        for b in (low, high)
    )
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
    """Non-negative least squares for the linear numbers of a model, at given shapes, on a few samples."""

    def __init__(self, s: Structure, fixed, readings: Readings, loss: str, weight: np.ndarray, floor: float, seed: int):
        n = readings.f.shape[0]
        cells = (
            np.arange(n) if n <= GUESS_SAMPLES else np.random.default_rng(seed).choice(n, GUESS_SAMPLES, replace=False)
        )
        part = readings.part(np.resize(cells, GUESS_SAMPLES))  # repeated if few, so that one program serves
        self.s, self.fixed = s, fixed
        self.wi, self.wo = (Direction(*(jnp.asarray(c, float) for c in w)) for w in (part.wi, part.wo))
        self.f = part.f
        cosine = np.asarray(part.wi.z)[:, None] if uses_cosine(loss) else 1.0
        slope = transform(loss, part.f * cosine, floor, np)[1]
        self.weight = weight[np.resize(cells, GUESS_SAMPLES)] * slope * cosine

    def __call__(self, p: np.ndarray) -> tuple[np.ndarray, float]:
        """(p with its unsaid linear numbers solved, weighted sum of squares)."""
        s, p = self.s, p.copy()
        unsaid = [k for k, g in enumerate(s.groups) if g.linear and np.isnan(p[g.first])]
        p = np.where(np.isnan(p), 1.0, p)
        f, rows = (np.asarray(a) for a in lobes_at(s, jnp.asarray(p), self.fixed, self.wi, self.wo))
        total = 0.0
        for c in range(s.channels):
            w, basis = self.weight[:, c], rows[:, unsaid, c]
            rest = self.f[:, c] - (f[:, c] - basis.sum(1))
            amount = _non_negative(basis * w[:, None], rest * w) if unsaid else np.empty(0)
            total += float(np.sum((w * (basis @ amount - rest)) ** 2))
            for k, a in zip(unsaid, amount, strict=True):
                g = s.groups[k]
                if g.per_channel or s.channels == 1:
                    p[g.first + (c if g.per_channel else 0)] = np.clip(a, g.info.low, g.info.high)
        return p, total


def _non_negative(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Least squares with x ≥ 0: the most negative column is dropped until none is; at least 1e-3 of the largest."""
    kept = list(range(a.shape[1]))
    x = np.zeros(a.shape[1])
    while kept:
        part = np.linalg.lstsq(a[:, kept], b, rcond=None)[0]
        if part.min() >= 0:
            x[kept] = part
            break
        kept.pop(int(np.argmin(part)))
    size = np.linalg.norm(a, axis=0)
    reach = np.where(size > 0, np.linalg.norm(b) / np.where(size > 0, size, 1.0), 0.0)
    return np.maximum(x, 1e-3 * reach)

"""Where a sketch begins that has grown out of another: its numbers carried over, what is new guessed from the data."""

import numpy as np

from gonio.fitting.problem.losses import transform
from gonio.fitting.selection.candidate_model import Number, Part, Scenery, descend, numbers_of, to_p, to_x, values
from gonio.models.expression.paths import FACTOR

WIDTHS = (0.02, 0.06, 0.15, 0.35, 0.7)
NEW = {"f0": 0.1, "gamma": 2.2, "r": 0.3, "rho": 0.3, FACTOR: 0.1, "alpha": 0.3, "alpha_x": 0.25, "alpha_y": 0.4}
APART = {"alpha_x": 0.8, "alpha_y": 1.25}  # widths along x and y begin apart: equal ones look alike from either side
REFINED = 2


def carried(old: tuple[Part, ...], p: np.ndarray, new: tuple[Part, ...], channels: int) -> np.ndarray:
    """Numbers (P,) for the parts `new` out of the numbers p of the parts `old`, in their order; NaN where none is."""
    before: dict[tuple, list[float]] = {}
    for u, value in zip(numbers_of(old, channels), p, strict=True):
        before.setdefault((u.part, u.name), []).append(float(value))
        before.setdefault((u.part, u.name, u.channel), []).append(float(value))

    def value(u: Number) -> float:
        for key in ((u.part, u.name, u.channel), (u.part, u.name)):
            if key in before:
                return float(np.mean(before[key]))
        if u.name in APART and (u.part, "alpha") in before:
            return APART[u.name] * float(np.mean(before[u.part, "alpha"]))
        if u.name == "alpha" and (u.part, "alpha_x") in before:
            return float(np.sqrt(np.mean(before[u.part, "alpha_x"]) * np.mean(before[u.part, "alpha_y"])))
        return float("nan") if u.part >= len(old) else NEW[u.name]

    return np.array([value(u) for u in numbers_of(new, channels)])


def solved(parts: tuple[Part, ...], p: np.ndarray, s: Scenery) -> tuple[np.ndarray, float]:
    """(p with its albedos and scales from the data at given shapes, Σr² of it): least squares, made non-negative.

    The loss is taken as linear about the readings. A number that all channels share stays as it is.
    """
    channels = s.target.shape[1]
    of = numbers_of(parts, channels)
    f, rows = values(parts, to_x(of, p), s)
    slope = s.weight * transform(s.loss, s.f * s.cosine, s.floor, np)[1] * s.cosine
    p, total = p.copy(), 0.0
    for c in range(channels):
        at = [j for j, u in enumerate(of) if u.name in (FACTOR, "rho") and (u.channel == c or channels == 1)]
        w, basis = slope[:, c], rows[:, c, at]
        rest = s.f[:, c] - (f[:, c] - basis @ p[at])
        amount = np.linalg.lstsq(basis * w[:, None], rest * w, rcond=None)[0] if at else np.empty(0)
        least = 1e-3 * np.max(np.abs(amount), initial=1e-6)
        amount = np.clip(amount, np.minimum(least, [of[j].high for j in at]), [of[j].high for j in at])
        p[at] = amount
        total += float(np.sum((w * (basis @ amount - rest)) ** 2))
    return p, total


def fitted(parts: tuple[Part, ...], p: np.ndarray, s: Scenery) -> tuple[np.ndarray, float]:
    """(numbers (P,), Σr²) of a sketch from the numbers p; a new lobe (NaN) begins at the likeliest of some widths."""
    of = numbers_of(parts, s.target.shape[1])
    missing = np.isnan(p)
    if not missing.any():
        starts = [p]
    else:
        guessed = []
        for width in WIDTHS if any(of[j].name.startswith("alpha") for j in np.flatnonzero(missing)) else (0.3,):
            new = [width * APART.get(u.name, 1.0) if u.name.startswith("alpha") else NEW[u.name] for u in of]
            guessed.append(solved(parts, np.where(missing, new, p), s))
        starts = [q for q, _ in sorted(guessed, key=lambda found: found[1])[:REFINED]]
    ends = [descend(parts, to_x(of, q), s) for q in starts]
    x, cost = min(ends, key=lambda end: end[1] if np.isfinite(end[1]) else np.inf)
    return to_p(of, x), cost

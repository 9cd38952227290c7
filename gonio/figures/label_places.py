"""Places for the labels of points, so that none hides another or a point: the nearest free one, tied by a thin line."""

import math
from collections.abc import Sequence

import numpy as np

ANGLES = [math.radians(a) for a in (20, -20, 160, -160, 60, -60, 120, -120, 0, 180, 90, -90)]
DISTANCES = (3, 7, 13, 21, 34, 46, 60, 78, 100, 130, 165, 205, 250, 300)
SLACK = 1.0
"""Free space around a label, in the units of the coordinates."""


def places(
    points: np.ndarray,
    sizes: np.ndarray,
    inside: tuple[float, float, float, float],
    radii: np.ndarray,
    others: Sequence[tuple[float, float, float, float]] = (),
) -> list[tuple[float, float] | None]:
    """The lower left corner of each label; None for one that found no room.

    `points` (n, 2) and `sizes` (n, 2: width, height) in one unit, such as pixels; `inside`: left, lower, right, upper
    edge of where labels may stand; `radii` (n,) of the points' marks. Labels are placed in the order they come in.
    `others`: boxes (left, lower, right, upper) that no label may cover either.
    """
    marks = [(x - r, y - r, x + r, y + r) for (x, y), r in zip(points, radii, strict=True)]
    taken = list(others)
    found: list[tuple[float, float] | None] = []
    for (x, y), (w, h), r in zip(points, sizes, radii, strict=True):
        free = (b for b in _candidates(x, y, w, h, r) if _within(b, inside) and not _any_overlap(b, [*taken, *marks]))
        best = next(free, None)
        found.append(best[:2] if best else None)
        if best:
            taken.append((best[0] - SLACK, best[1] - SLACK, best[2] + SLACK, best[3] + SLACK))
    return found


def _candidates(x, y, w, h, r):
    for distance in DISTANCES:
        for angle in ANGLES:
            # The side of the label that looks at the mark is so far from it.
            cx = x + math.cos(angle) * (r + distance + w / 2)
            cy = y + math.sin(angle) * (r + distance + h / 2)
            yield cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2


def _within(box, inside) -> bool:
    return box[0] >= inside[0] and box[1] >= inside[1] and box[2] <= inside[2] and box[3] <= inside[3]


def _any_overlap(box, others: Sequence) -> bool:
    return any(box[0] < o[2] and o[0] < box[2] and box[1] < o[3] and o[1] < box[3] for o in others)


def nearest_of(corner: tuple[float, float], size: Sequence[float], point: Sequence[float]) -> tuple[float, float]:
    """The place on a label's box that is nearest to its point: where the line between them ends."""
    return tuple(min(max(p, c), c + s) for p, c, s in zip(point, corner, size, strict=True))

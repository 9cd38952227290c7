"""Places for the labels of points, so that none hides another or a point: the nearest free one, tied by a thin line."""

from collections.abc import Sequence

import numpy as np

ANGLES = np.radians([20, -20, 160, -160, 60, -60, 120, -120, 0, 180, 90, -90])
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
    points, sizes = np.asarray(points, float), np.asarray(sizes, float)
    marks = np.concatenate([points - radii[:, None], points + radii[:, None]], axis=1)
    taken = np.concatenate([marks, np.asarray(others, float).reshape(-1, 4)])
    found: list[tuple[float, float] | None] = []
    for point, size, radius in zip(points, sizes, radii, strict=True):
        boxes = _candidates(point, size, radius)
        free = (boxes[:, :2] >= inside[:2]).all(1) & (boxes[:, 2:] <= inside[2:]).all(1)
        low, high = boxes[:, None, :2], boxes[:, None, 2:]
        free &= ~((low < taken[:, 2:]) & (taken[:, :2] < high)).all(-1).any(1)
        if not free.any():
            found.append(None)
            continue
        best = boxes[np.argmax(free)]
        found.append((float(best[0]), float(best[1])))
        taken = np.concatenate([taken, [best + SLACK * np.array([-1, -1, 1, 1])]])
    return found


def _candidates(point, size, radius) -> np.ndarray:
    # Boxes (k, 4), the nearest first. The side of the label that looks at the mark is `distance` from it.
    along = np.stack([np.cos(ANGLES), np.sin(ANGLES)], -1)
    away = (radius + np.array(DISTANCES))[:, None, None] + size / 2
    corners = (point + along * away - size / 2).reshape(-1, 2)
    return np.concatenate([corners, corners + size], axis=1)


def nearest_of(corner: tuple[float, float], size: Sequence[float], point: Sequence[float]) -> tuple[float, float]:
    """The place on a label's box that is nearest to its point: where the line between them ends."""
    return tuple(min(max(p, c), c + s) for p, c, s in zip(point, corner, size, strict=True))

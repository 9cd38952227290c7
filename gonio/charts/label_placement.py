"""Places for the labels of points where none covers another or a point: the nearest free one."""

from collections.abc import Sequence

import numpy as np

ANGLES = np.radians([20, -20, 160, -160, 60, -60, 120, -120, 0, 180, 90, -90])
DISTANCES = (3, 7, 13, 21, 34, 46, 60, 78, 100, 130, 165, 205, 250, 300)
SLACK = np.array([-1.0, -1.0, 1.0, 1.0])
"""Free space around a label, in the units of the coordinates."""

Box = tuple[float, float, float, float]
"""Left, lower, right and upper edge."""


def places(
    points: np.ndarray, sizes: np.ndarray, inside: Box, radii: np.ndarray, others: Sequence[Box] = ()
) -> list[tuple[float, float] | None]:
    """The lower left corner of each label, placed in the order they come in; None for one without room.

    Args:
        points: positions (n, 2), in one unit such as pixels.
        sizes: width and height (n, 2) of the labels.
        inside: where labels may stand.
        radii: of the points' marks, (n,).
        others: boxes that no label may cover either.
    """
    points, sizes = np.asarray(points, float), np.asarray(sizes, float)
    marks = np.concatenate([points - radii[:, None], points + radii[:, None]], axis=1)
    taken = np.concatenate([marks, np.asarray(others, float).reshape(-1, 4)])
    corners: list[tuple[float, float] | None] = []
    for point, size, radius in zip(points, sizes, radii, strict=True):
        boxes = _candidates(point, size, radius)
        free = (boxes[:, :2] >= inside[:2]).all(1) & (boxes[:, 2:] <= inside[2:]).all(1)
        low, high = boxes[:, None, :2], boxes[:, None, 2:]
        free &= ~((low < taken[:, 2:]) & (taken[:, :2] < high)).all(axis=-1).any(axis=-1)
        if not free.any():
            corners.append(None)
            continue
        best = boxes[np.argmax(free)]
        corners.append((float(best[0]), float(best[1])))
        taken = np.concatenate([taken, [best + SLACK]])
    return corners


def _candidates(point: np.ndarray, size: np.ndarray, radius: float) -> np.ndarray:
    # Boxes (k, 4), the nearest first. The side of the label that faces the mark is `distance` from it.
    along = np.stack([np.cos(ANGLES), np.sin(ANGLES)], -1)
    away = (radius + np.array(DISTANCES))[:, None, None] + size / 2
    corners = (point + along * away - size / 2).reshape(-1, 2)
    return np.concatenate([corners, corners + size], axis=1)


def nearest_of(corner: Sequence[float], size: Sequence[float], point: Sequence[float]) -> list[float]:
    """The position on a label's box that is nearest to its point: where the line between them ends."""
    return [min(max(p, c), c + s) for p, c, s in zip(point, corner, size, strict=True)]

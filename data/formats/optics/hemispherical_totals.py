"""∫ f cosθo dωo of values on a grid of polar angles and azimuths about some direction, bilinear between the nodes."""

import numpy as np

POINTS, FINE_POINTS = 4, 2
"""Gauss-Legendre points between two nodes; and those of a grid that is fine by itself."""
FINE = 1 << 14
"""Nodes from which on it is."""
CHUNK = 1 << 20
"""Values that are held beside those of the grid."""


def grid_totals(
    polar: np.ndarray, azimuth: np.ndarray, f: np.ndarray, centre: np.ndarray, mirrored: bool
) -> np.ndarray:
    """Integrals over the directions within the nodes, of f that is bilinear between them: (n, channels).

    Args:
        polar: angles from the centre, radians, (P,), increasing.
        azimuth: about the centre, radians, (A,), increasing from 0 up to below 2π; 0 is towards the normal.
        f: (n, P, A, channels), 1/sr; NaN where there is none: the weights of the others are scaled up.
        centre: angle of the centre from the normal, radians, (n,).
        mirrored: whether the azimuths are those of one side, the other being its mirror image.
    """
    valid = np.isfinite(f)
    f = np.where(valid, f, 0.0)
    count = FINE_POINTS if polar.size * azimuth.size > FINE else POINTS
    theta, w_theta, rows = _between(polar, count)
    ring, w_phi, columns = _round(azimuth, mirrored, count)
    total = np.zeros((f.shape[0], f.shape[3]))
    step = max(1, CHUNK // (ring.size * f.shape[3]))
    for n in range(f.shape[0]):
        for start in range(0, theta.size, step):
            part = slice(start, start + step)
            (low, w_low), (high, w_high) = rows
            cut = ((low[part], w_low[part]), (high[part], w_high[part]))
            values, known = (_bilinear(a, cut, columns) for a in (f[n], valid[n].astype(float)))
            m = theta[part, None]
            cosine = np.cos(centre[n]) * np.cos(m) + np.sin(centre[n]) * np.sin(m) * np.cos(ring)
            weight = w_theta[part, None] * np.sin(m) * w_phi * np.maximum(cosine, 0.0)
            total[n] += np.sum(weight[..., None] * values / np.where(known > 0, known, 1.0), axis=(0, 1))
    return total


Weights = tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Numbers of the lower nodes with their weights, and those of the upper ones."""


def _bilinear(values: np.ndarray, rows: Weights, columns: Weights) -> np.ndarray:
    (low, w_low), (high, w_high) = rows
    along = values[low] * w_low[:, None, None] + values[high] * w_high[:, None, None]
    (low, w_low), (high, w_high) = columns
    return along[:, low] * w_low[:, None] + along[:, high] * w_high[:, None]


def _between(nodes: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, Weights]:
    """(points, so many between two nodes, their weights, the nodes that they lie between), from 0 to the last."""
    low = np.arange(nodes.size - 1)
    start, stop, high = nodes[:-1], nodes[1:], low + 1
    if nodes[0] > 0:
        start, stop = np.r_[0.0, start], np.r_[nodes[0], stop]
        low, high = np.r_[0, low], np.r_[0, high]
    return _points((start, stop), (low, high), count)


def _round(nodes: np.ndarray, mirrored: bool, count: int) -> tuple[np.ndarray, np.ndarray, Weights]:
    """The same once round, or half round and taken twice."""
    low, end = np.arange(nodes.size), np.pi if mirrored else nodes[0] + 2 * np.pi
    high = np.minimum(low + 1, nodes.size - 1) if mirrored else (low + 1) % nodes.size
    start, stop = nodes, np.r_[nodes[1:], end]
    if mirrored:
        start, stop, low, high = np.r_[0.0, start], np.r_[nodes[0], stop], np.r_[0, low], np.r_[0, high]
    points, weights, between = _points((start, stop), (low, high), count)
    return points, weights * (2 if mirrored else 1), between


def _points(
    ends: tuple[np.ndarray, np.ndarray], nodes: tuple[np.ndarray, np.ndarray], count: int
) -> tuple[np.ndarray, np.ndarray, Weights]:
    x, w = np.polynomial.legendre.leggauss(count)
    (start, stop), share = ends, (x + 1) / 2
    width = (stop - start)[:, None]
    points, weights = (start[:, None] + width * share).ravel(), (width * w / 2).ravel()
    upper = np.tile(share, start.size)
    lower, upper_node = (np.repeat(k, count) for k in nodes)
    return points, weights, ((lower, 1 - upper), (upper_node, upper))

"""What a grid may have missed between its nodes: the error of predicting each node from its neighbours, in log f.

A node is predicted from its two neighbours along an axis, log-linearly over twice the grid's step. For a function that
the grid resolves, that prediction errs by four times as much as the interpolation between the nodes does; for one that
it does not resolve the error is a whole number of e-folds, and so is the bound that comes of it.
"""

import functools
import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

LARGEST = 40.0
"""Prediction error, in e-folds, beyond which it no longer matters."""

RESOLVED = 1.0
"""A Gaussian lobe whose nodes are predicted this badly is summed to 1e-4, and by every second node to 17 %."""

CANCELLED = 0.05


def log_values(f: np.ndarray, floor: np.ndarray | float) -> np.ndarray:
    """log of f, not below a floor: what is smaller carries no energy, and negative readings have no logarithm."""
    return np.log(np.maximum(f, floor))


def prediction_error(logs: np.ndarray, nodes: np.ndarray, axis: int, period: float | None = None) -> np.ndarray:
    """|log f − its value by the neighbours along an axis|, of the shape of `logs`.

    `nodes` increase along that axis; with a `period` the axis closes on itself. A node at an end takes the error of
    the one beside it. Axes of fewer than three nodes tell nothing: 0.
    """
    logs = np.moveaxis(logs, axis, 0)
    if logs.shape[0] < 3:
        return np.zeros(np.moveaxis(logs, 0, axis).shape)
    if period is not None:
        # One more node at either end.
        nodes = np.concatenate([nodes[-1:] - period, nodes, nodes[:1] + period])
        logs = np.concatenate([logs[-1:], logs, logs[:1]])
    t = ((nodes[1:-1] - nodes[:-2]) / (nodes[2:] - nodes[:-2])).reshape(-1, *[1] * (logs.ndim - 1))
    error = np.abs(logs[1:-1] - (1 - t) * logs[:-2] - t * logs[2:])
    if period is None:
        error = np.concatenate([error[:1], error, error[-1:]])
    return np.moveaxis(np.minimum(error, LARGEST), 0, axis)


def prediction_error_across_pole(logs: np.ndarray, theta: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """The prediction error along theta of log f on (theta, azimuth, ...), azimuths once around the normal.

    On the other side of the normal the azimuths are turned by π: the innermost nodes have neighbours there.
    """
    opposite = _opposite(azimuth.tobytes())
    first = 1 if theta[0] < 1e-9 else 0
    longer = np.concatenate([logs[first : first + 1][:, opposite], logs])
    return prediction_error(longer, np.append(-theta[first], theta), 0)[1:]


@functools.lru_cache(maxsize=8)
def _opposite(azimuths: bytes) -> np.ndarray:
    """Number of the azimuth nearest to half a turn from each of some, float64."""
    azimuth = np.frombuffer(azimuths)
    return np.argmin(np.abs(np.mod(azimuth[None] - azimuth[:, None], 2 * np.pi) - np.pi), axis=1)


class Rim(NamedTuple):
    """Where f ends between a node and a dark neighbour along an axis: the errors there, and which nodes those are."""

    error: np.ndarray
    """As of `prediction_error`, but of nodes at the rim by the two nodes on their lit side alone."""
    inside: np.ndarray


def with_rim(
    error: np.ndarray, logs: np.ndarray, nodes: np.ndarray, dark: np.ndarray, axis: int, period: float | None = None
) -> Rim:
    """Prediction errors of log f along an axis where f may end between two nodes, as refracted light does.

    To such an end centred prediction gives the whole of a logarithm to the floor, as to a peak. A lobe between the two
    nodes that is smooth in log f shows on its lit side as well; else the end itself leaves half a step open.

    Args:
        error: of `prediction_error`, of the shape of `logs`.
        logs: log f.
        nodes: as of `prediction_error`; with a `period` the axis closes on itself.
        dark: which nodes are not above the floor.
        axis: along which the nodes increase.
        period: of the axis.
    """
    error, logs, dark = (np.moveaxis(a, axis, 0) for a in (error, logs, dark))
    n, error, inside = len(nodes), error.copy(), np.zeros(error.shape, bool)
    if period is not None:
        nodes = np.concatenate([nodes - period, nodes, nodes + period])
        logs, dark = (np.concatenate([a, a, a]) for a in (logs, dark))
    first = 0 if period is None else n
    for k, s in itertools.product(range(first, first + n), (1, -1)):
        if min(k + s, k - 2 * s) < 0 or max(k + s, k - 2 * s) >= len(nodes):
            continue
        t = (nodes[k] - nodes[k - s]) / (nodes[k - s] - nodes[k - 2 * s])
        off = np.abs(logs[k] - logs[k - s] - t * (logs[k - s] - logs[k - 2 * s]))
        ends = dark[k + s] & ~dark[k] & ~dark[k - s] & ~dark[k - 2 * s]
        here, there = k - first, (k + s - first) % n
        error[here] = np.where(ends, off, error[here])
        error[there] = np.where(ends, 0.0, error[there])
        inside[here] |= ends
    return Rim(np.moveaxis(np.minimum(error, LARGEST), 0, axis), np.moveaxis(inside, 0, axis))


def excess(
    f: np.ndarray,
    floor: np.ndarray,
    errors: list[np.ndarray],
    noise: np.ndarray | float = 0.0,
    remains: float = CANCELLED,
) -> np.ndarray:
    """What f may be off by near each node, 1/sr: f grown by its prediction errors along all axes, and the floor.

    Where they are together below `RESOLVED` e-folds the errors between the nodes have both signs and cancel in a sum
    to far less: `remains` of it is taken, and the sums over every second node account for the rest.
    `noise` is the relative standard uncertainty of f: errors of up to twice what it makes are no structure.
    """
    total = sum((np.maximum(e - 2 * 1.22 * noise, 0.0) for e in errors), np.zeros(f.shape))
    grown = np.maximum(f, floor) * np.expm1(np.minimum(total, LARGEST))
    return np.where(total <= RESOLVED, remains * grown, grown) + np.where(f < floor, floor, 0.0)


def hat_weights(nodes: np.ndarray, low: float, high: float, density: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """∫ over [low, high] of each node's hat function times a density: exact for what is linear between the nodes.

    Beyond the outermost nodes the hat is 1. By Gauss–Legendre between each two nodes.
    """
    x, w = np.polynomial.legendre.leggauss(8)
    edges = np.unique(np.concatenate([[low], nodes[(nodes > low) & (nodes < high)], [high]]))
    half = np.diff(edges)[:, None] / 2
    points = (edges[:-1, None] + half * (1 + x)).ravel()
    mass = (half * w).ravel() * density(points)
    if nodes.size == 1:
        return np.array([mass.sum()])
    k = np.clip(np.searchsorted(nodes, points) - 1, 0, nodes.size - 2)
    t = np.clip((points - nodes[k]) / (nodes[k + 1] - nodes[k]), 0, 1)
    return np.bincount(k, mass * (1 - t), nodes.size) + np.bincount(k + 1, mass * t, nodes.size)


def periodic_weights(nodes: np.ndarray) -> np.ndarray:
    """Half of the gaps on either side of each node of an axis that closes after a full turn."""
    gaps = np.diff(np.append(nodes, nodes[0] + 2 * np.pi))
    return (gaps + np.roll(gaps, 1)) / 2


def hemisphere_weights(theta: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Projected solid angles, sr, (theta, azimuth, 1), of nodes: exact for what is linear between them."""
    w_theta = hat_weights(theta, 0.0, np.pi / 2, lambda t: np.sin(t) * np.cos(t))
    return w_theta[:, None, None] * periodic_weights(azimuth)[None, :, None]

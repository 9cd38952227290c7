"""What a grid may have missed between its nodes: the surprise of each node against its neighbours, in logarithms.

A node is predicted from its two neighbours along an axis, log-linearly over twice the grid's step. For a function that
the grid resolves, that prediction errs by four times as much as the interpolation between the nodes does; for one that
it does not resolve the surprise is a whole number of e-folds, and so is the bound that comes of it.
"""

import numpy as np

LARGEST = 40.0
"""Surprise, in e-folds, beyond which it no longer matters."""

RESOLVED = 1.0
"""A Gaussian lobe whose nodes surprise by this much is summed to 1e-4, and by every second node to 17 %."""

CANCELLED = 0.05


def log_values(f: np.ndarray, floor: np.ndarray | float) -> np.ndarray:
    """log of f, not below a floor: what is smaller carries no energy, and negative readings have no logarithm."""
    return np.log(np.maximum(f, floor))


def surprise(logs: np.ndarray, nodes: np.ndarray, axis: int, period: float | None = None) -> np.ndarray:
    """|log f − its value by the neighbours along an axis|, of the shape of `logs`.

    `nodes` increase along that axis; with a `period` the axis closes on itself. A node at an end takes the surprise of
    the one beside it. Axes of fewer than three nodes say nothing: 0.
    """
    logs = np.moveaxis(logs, axis, 0)
    n = logs.shape[0]
    if n < 3:
        return np.zeros(np.moveaxis(logs, 0, axis).shape)
    if period is None:
        before, here, after = nodes[:-2], nodes[1:-1], nodes[2:]
        left, middle, right = logs[:-2], logs[1:-1], logs[2:]
    else:
        before, here, after = np.roll(nodes, 1), nodes, np.roll(nodes, -1)
        before = np.where(before > here, before - period, before)
        after = np.where(after < here, after + period, after)
        left, middle, right = np.roll(logs, 1, 0), logs, np.roll(logs, -1, 0)
    t = ((here - before) / (after - before)).reshape(-1, *[1] * (logs.ndim - 1))
    found = np.abs(middle - (1 - t) * left - t * right)
    if period is None:
        found = np.concatenate([found[:1], found, found[-1:]])
    return np.moveaxis(np.minimum(found, LARGEST), 0, axis)


def excess(f: np.ndarray, floor, surprises: list[np.ndarray], noise: np.ndarray | float = 0.0) -> np.ndarray:
    """What f may be off by near each node, 1/sr: f grown by its surprises along all axes, and the floor.

    Where the surprises together are below `RESOLVED` e-folds the errors between the nodes have both signs and cancel
    in a sum to far less: `CANCELLED` of it is taken, and the sums over every second node say the rest.
    `noise` is the relative standard uncertainty of f: surprises of up to twice what it makes are no structure.
    """
    total = sum(np.maximum(s - 2 * 1.22 * noise, 0.0) for s in surprises)
    grown = np.maximum(f, floor) * np.expm1(np.minimum(total, LARGEST))
    return np.where(total <= RESOLVED, CANCELLED * grown, grown) + np.where(f < floor, floor, 0.0)


def hat_weights(nodes: np.ndarray, low: float, high: float, density) -> np.ndarray:
    """∫ over [low, high] of each node's hat function times a density: exact for what is linear between the nodes.

    Beyond the outermost nodes the hat is 1. By Gauss–Legendre between each two nodes.
    """
    x, w = np.polynomial.legendre.leggauss(8)
    edges = np.unique(np.concatenate([[low], nodes[(nodes > low) & (nodes < high)], [high]]))
    half = np.diff(edges)[:, None] / 2
    at = (edges[:-1, None] + half * (1 + x)).ravel()
    mass = (half * w).ravel() * density(at)
    weights = np.zeros(nodes.size)
    k = np.clip(np.searchsorted(nodes, at) - 1, 0, max(nodes.size - 2, 0))
    if nodes.size == 1:
        return np.array([mass.sum()])
    t = np.clip((at - nodes[k]) / (nodes[k + 1] - nodes[k]), 0, 1)
    np.add.at(weights, k, mass * (1 - t))
    np.add.at(weights, k + 1, mass * t)
    return weights


def periodic_weights(nodes: np.ndarray, period: float = 2 * np.pi) -> np.ndarray:
    """Half of the gaps on either side of each node of a closed axis."""
    gaps = np.diff(np.append(nodes, nodes[0] + period))
    return (gaps + np.roll(gaps, 1)) / 2

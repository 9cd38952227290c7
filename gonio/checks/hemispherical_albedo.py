"""The share reflected under uniform light, from directional albedos at the incidences that there are."""

import numpy as np
from scipy.interpolate import PchipInterpolator


def hemispherical(theta: np.ndarray, value: np.ndarray, bound: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(albedo, bound), each (channels,): ∫ E d(sin²θ) over the incidences, and how far it may be off.

    `theta` (n,), radians, `value` and `bound` (n, channels), finite; incidences given several times (azimuths) are
    averaged. Monotone cubics between the incidences [Fritsch & Carlson 1980]; the error is that of every second one.
    Below the first incidence and beyond the last E is held constant, and may there be anything from 0 to 1, or to
    itself where it is larger. Raises nothing: fewer than four incidences have an infinite bound.
    """
    nodes, at = np.unique(np.round(theta, 9), return_inverse=True)
    count = np.bincount(at)[:, None]
    e, b = (np.stack([np.bincount(at, c) for c in v.T], -1) / count for v in (value, bound))
    if nodes.size < 4:
        return e.mean(axis=0), np.full(e.shape[1], np.inf)
    t = np.sin(nodes) ** 2
    beyond = t[0] + 1 - t[-1]
    total = _between(t, e) + t[0] * e[0] + (1 - t[-1]) * e[-1]
    rough = np.unique(np.append(np.arange(0, t.size, 2), t.size - 1))
    missed = np.abs(_between(t, e) - _between(t[rough], e[rough]))
    # Of a monotone cubic through twice as many nodes a quarter is left, at the least.
    edge = t[0] * np.maximum(np.abs(e[0]), 1) + (1 - t[-1]) * np.maximum(np.abs(e[-1]), 1)
    inner = np.sum((b[1:] + b[:-1]) / 2 * np.diff(t)[:, None], axis=0) + beyond * b.max(axis=0)
    return total, missed / 2 + edge + inner


def _between(t, e):
    return PchipInterpolator(t, e, axis=0).integrate(t[0], t[-1])

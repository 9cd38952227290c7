"""Integrals over rectangles by Gauss–Kronrod cells, halved across the side along which the rules disagree most."""

from collections.abc import Callable

import numpy as np

from gonio.checks.model.cubature import W_G, W_K, X

MOST = 6000
"""Cells at which the rest of the error is left as it is: a million evaluations."""
AT_ONCE = 400
"""Cells that are halved in one round."""
A_CALL = 128
"""Cells evaluated together, always as many: one compiled program."""


def integrate(
    integrand: Callable, cells: np.ndarray, bins: np.ndarray, enough: float, most: int = MOST
) -> tuple[np.ndarray, float]:
    """(integral over the cells of each bin, sum of the errors of all) by at most so many cells.

    `integrand(a, b)` takes and gives arrays of shape (n, 15, 15); `cells`: rows (a0, b0, a1, b1); `bins`: the bin of
    each. A cell's error is that of QUADPACK's rules [Piessens et al. 1983], and no less than a tenth of what the two
    rules differ by.
    """
    count = int(bins.max()) + 1
    value, error, along = _rules(integrand, cells)
    while error.sum() > enough and len(cells) < most:
        order = np.argsort(error)[::-1]
        worst = order[: 1 + np.searchsorted(np.cumsum(error[order]), 0.9 * error.sum())][:AT_ONCE]
        halves = _halved(cells[worst], along[worst])
        done = np.ones(len(cells), bool)
        done[worst] = False
        new = (*_rules(integrand, halves), halves, np.concatenate([bins[worst]] * 2))
        old = (value, error, along, cells, bins)
        value, error, along, cells, bins = (np.concatenate([a[done], b]) for a, b in zip(old, new, strict=True))
    return np.bincount(bins, value, count), float(error.sum())


def _rules(integrand, cells) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    # Kronrod's sum of each cell, its error, and the side (0 or 1) along which Gauss's rule disagrees most.
    found = [_rules_of_call(integrand, cells[k : k + A_CALL]) for k in range(0, len(cells), A_CALL)]
    return tuple(np.concatenate(part) for part in zip(*found, strict=True))


def _rules_of_call(integrand, cells):
    full = np.concatenate([cells, np.broadcast_to(cells[-1], (A_CALL - len(cells), 4))])
    low, high = full[:, :2, None], full[:, 2:, None]
    a, b = np.moveaxis(low + (high - low) * (X + 1) / 2, 1, 0)
    at = np.broadcast_arrays(a[:, :, None], b[:, None, :])
    f = integrand(*at)[: len(cells)]
    area = np.prod(cells[:, 2:] - cells[:, :2], axis=1) / 4
    both, size, first, second, neither = (
        np.einsum("nij,i,j->n", g, p, q) * area
        for g, p, q in (
            (f, W_K, W_K), (np.abs(f), W_K, W_K), (f, W_G, W_K), (f, W_K, W_G), (f, W_G, W_G),
        )
    )  # fmt: skip
    apart = np.abs(both - neither)
    share = np.minimum(1.0, 200 * apart / np.where(size > 0, size, 1.0))
    error = np.maximum(np.minimum(apart, size * share**1.5), 0.1 * apart)
    return both, error, (np.abs(both - second) > np.abs(both - first)).astype(int)


def _halved(cells, along) -> np.ndarray:
    rows = np.arange(len(cells))
    middle = (cells[rows, along] + cells[rows, along + 2]) / 2
    lower, upper = cells.copy(), cells.copy()
    lower[rows, along + 2] = upper[rows, along] = middle
    return np.concatenate([lower, upper])

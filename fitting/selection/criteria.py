"""Criteria of model selection: noise from neighbours, design effect, and cross-validation by directions.

Readings of a goniometer are not independent: what a model misses is missed alike by neighbours. Counting each as one
makes Schwarz's criterion greedy, so it is given the effective number of readings.
"""

import dataclasses

import numpy as np

from gonio.models.geometry.directions import Direction
from gonio.models.special.scipy_parts import parts

BINS = 10
LEAF = 8  # readings of one cluster; what farther ones share, cross-validation judges
ROUNDING = 1e-6  # of the data: below this a difference is not noise to be modelled
MAX_GROUPS = 24
TIED = 6
"""Readings that are looked at for the nearest ones, itself among them: as many are equally near on usual grids."""
SAME = 1e-9
"""Relative difference of distances, and of sizes, that are the same but for rounding."""
FEW_GROUPS, CLUSTERS = 6, 10  # fewer incidences than these are no sample of directions: clusters of pairs are


@dataclasses.dataclass(frozen=True)
class Neighbourhood:
    """Pairs of neighbouring readings (m, 2), clusters of a few near readings, and groups for cross-validation."""

    pairs: np.ndarray
    leaf: np.ndarray  # (n,) number of the cluster
    groups: np.ndarray  # (n,) number of the incident direction, of the band of them, or of the cluster of pairs


def neighbourhood(wi: Direction, wo: Direction) -> Neighbourhood:
    """Neighbours by the angle between the pairs of directions; groups of one incident direction, or bands of them.

    Where there are few incident directions the groups are clusters of neighbouring pairs.
    """
    points = np.stack([np.asarray(c, float) for c in (*wi, *wo)], axis=1)
    n = points.shape[0]
    if n < 3:
        return Neighbourhood(np.empty((0, 2), int), np.zeros(n, int), np.arange(n))
    (tree,) = parts("scipy.spatial", "_ckdtree", "cKDTree")
    distance, near = (np.asarray(a) for a in tree(points, leafsize=16).query(points, k=min(n, TIED)))
    # On a grid several are equally near: all of them count, lest the order of the readings choose. Of those in one
    # place, as on a pole, one does: they would outnumber the others.
    equal = distance <= (1 + SAME) * distance[:, 1:2]
    equal[:, 2:] &= distance[:, 1:2] > SAME
    one, which = np.nonzero(equal)
    pairs = np.stack([one, near[one, which]], axis=1)
    # A cell on the pole has many cells at one place: it may be its own neighbour.
    pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    groups = _groups(wi)
    if groups.max() + 1 < FEW_GROUPS:
        groups = _leaves(points, max(1, n // CLUSTERS))
    return Neighbourhood(pairs, _leaves(points, LEAF), groups)


def _leaves(points: np.ndarray, size: int) -> np.ndarray:
    # Halved along the longest side until small: cells of one leaf are near each other.
    leaf, stack, number = np.zeros(points.shape[0], int), [np.arange(points.shape[0])], 0
    while stack:
        cells = stack.pop()
        if cells.size <= size:
            leaf[cells] = number
            number += 1
            continue
        order = np.argsort(points[cells, np.argmax(np.ptp(points[cells], axis=0))], kind="stable")
        stack += [cells[order[: cells.size // 2]], cells[order[cells.size // 2 :]]]
    return leaf


def _groups(wi: Direction) -> np.ndarray:
    theta = np.arctan2(np.hypot(wi.x, wi.y), wi.z)
    phi = np.where(theta < 1e-6, 0.0, np.arctan2(wi.y, wi.x))
    groups = np.unique(np.round(np.stack([theta, phi], axis=1), 5), axis=0, return_inverse=True)[1].ravel()
    if groups.max() >= MAX_GROUPS:
        # Too many incident directions to leave out one by one: bands of equal number.
        groups[np.lexsort((phi, np.round(theta, 5)))] = np.arange(theta.size) * MAX_GROUPS // theta.size
    return groups


def noise_deviation(residual: np.ndarray, size: np.ndarray, used: np.ndarray, near: Neighbourhood) -> np.ndarray:
    """Standard deviation of the noise of each residual (n, C), from differences of neighbours [Rice 1984].

    It is taken as a function of the `size` of the reading (n, C), in bins of equal number; what a model misses smoothly
    cancels in the differences. Never below rounding.
    """
    a, b = near.pairs.T
    both = used[a] & used[b]
    step2 = 0.5 * (residual[a] - residual[b])[both] ** 2
    mean_size = 0.5 * (size[a] + size[b])[both]
    least = ROUNDING * np.abs(size) + 1e-2 * ROUNDING * float(np.sqrt(np.mean(size[used] ** 2)))
    if step2.size < 4:
        return np.maximum(np.std(residual[used]), least)
    order = np.argsort(mean_size, kind="stable")
    bins = [k for k in np.array_split(order, min(BINS, step2.size // 4)) if k.size]
    # Bins of one size are one bin: a perfect diffuser has no others.
    centre = np.array([np.mean(mean_size[k]) for k in bins])
    first = np.append(True, np.diff(centre) > SAME * centre[1:])
    centre, same = centre[first], np.cumsum(first) - 1
    level = np.sqrt(np.bincount(same, [np.sum(step2[k]) for k in bins]) / np.bincount(same, [k.size for k in bins]))
    return np.maximum(np.interp(size, centre, level), least)


def design_effect(residual: np.ndarray, used: np.ndarray, near: Neighbourhood) -> float:
    """Design effect [Kish 1965]: variance inflation from correlated residuals, at least 1, which means independent.

    Σ over clusters of (Σ r)² over Σ r², channels together; at most the readings of a cluster.
    """
    r = np.where(used, residual, 0.0)
    total = float(np.sum(r * r))
    if total == 0:
        return 1.0
    sums = np.bincount(near.leaf, weights=r.sum(axis=1))
    # What independent residuals show by chance is no correlation: three standard deviations of it are free.
    chance = 3.0 * np.sqrt(2.0 / max(np.count_nonzero(sums), 1))
    return max(1.0, float(np.sum(sums**2)) / total / (1.0 + chance))


def holdout_chi2(residual: np.ndarray, jacobian: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Σr² of each group's readings (G,) as predicted by a fit without the group.

    Without a second fit: r_g + J_g (JᵀJ − J_gᵀJ_g)⁻¹ J_gᵀ r_g, exact for what the model is linear in [Allen 1974;
    Pregibon 1981, one step]. `residual` (n, C), `jacobian` (n, C, P) by the free numbers that are not at a bound.
    """
    lengths = np.sqrt(np.einsum("ncp,ncp->p", jacobian, jacobian))
    rows = jacobian / np.where(lengths > 0, lengths, 1.0)
    whole = np.einsum("ncp,ncq->pq", rows, rows)
    # A trace of damping: a number that only one group tells of has no value without it.
    damping = 1e-9 * np.eye(whole.shape[0])
    chi2 = np.empty(int(groups.max()) + 1)
    for g in range(chi2.size):
        r = residual[groups == g].ravel()
        j = rows[groups == g].reshape(r.size, whole.shape[0])
        chi2[g] = np.sum((r + j @ np.linalg.solve(whole - j.T @ j + damping, j.T @ r)) ** 2)
    return chi2


def improves_holdout(small: np.ndarray, large: np.ndarray) -> bool:
    """Whether Σr² by hold-out group (G,) falls from a small to a large model, by more than chance.

    By more than one standard error of the sum, or in more groups than half of them and one standard error: where one
    group holds most of the sum, its standard error is as large as itself.
    """
    d = small - large
    if d.size < 2 or not d.sum() > 0:
        return False
    return bool(d.sum() > np.sqrt(d.size) * np.std(d, ddof=1) or np.sum(d > 0) > 0.5 * (d.size + np.sqrt(d.size)))

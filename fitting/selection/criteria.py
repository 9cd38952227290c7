"""When a larger model is worth its numbers: noise, correlation along directions, BIC and held-out directions.

Readings of a goniometer are not independent: what a model misses is missed alike by neighbours. Counting each as one
makes Schwarz's criterion greedy, so it is given the number of readings that are worth an independent one.
"""

import dataclasses

import numpy as np

from gonio.models.geometry.directions import Direction

BINS = 10
LEAF = 8  # readings that are near enough to be compared; what farther ones share, held-out directions judge
ROUNDING = 1e-6  # of the data: below this a difference is not noise to be modelled
MOST_GROUPS = 24


@dataclasses.dataclass(frozen=True)
class Neighbourhood:
    """Which readings lie beside each other: pairs of neighbours (m, 2), and leaves of a few near cells."""

    pairs: np.ndarray
    leaf: np.ndarray  # (n,) number of the leaf
    groups: np.ndarray  # (n,) number of the incident direction, or of the band of them


def neighbourhood(wi: Direction, wo: Direction) -> Neighbourhood:
    """Neighbours by the angle between the pairs of directions; groups of one incident direction, or bands of them."""
    from scipy.spatial import cKDTree

    points = np.stack([np.asarray(c, float) for c in (*wi, *wo)], axis=1)
    n = points.shape[0]
    if n < 3:
        return Neighbourhood(np.empty((0, 2), int), np.zeros(n, int), np.arange(n))
    near = cKDTree(points).query(points, k=2)[1][:, 1]
    pairs = np.stack([np.arange(n), near], axis=1)
    # A cell on the pole has many cells at one place: it may be told to be its own neighbour.
    pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    return Neighbourhood(pairs, _leaves(points, LEAF), _groups(wi))


def _leaves(points: np.ndarray, size: int) -> np.ndarray:
    # Halved along the longest side until small: cells of one leaf are near each other.
    number, found = 0, np.zeros(points.shape[0], int)
    stack = [np.arange(points.shape[0])]
    while stack:
        cells = stack.pop()
        if cells.size <= size:
            found[cells] = number
            number += 1
            continue
        part = points[cells]
        order = np.argsort(part[:, np.argmax(np.ptp(part, axis=0))], kind="stable")
        stack += [cells[order[: cells.size // 2]], cells[order[cells.size // 2 :]]]
    return found


def _groups(wi: Direction) -> np.ndarray:
    theta = np.arctan2(np.hypot(wi.x, wi.y), wi.z)
    phi = np.where(theta < 1e-6, 0.0, np.arctan2(wi.y, wi.x))
    whole = np.unique(np.round(np.stack([theta, phi], axis=1), 5), axis=0, return_inverse=True)[1].ravel()
    if whole.max() < MOST_GROUPS:
        return whole
    # Too many incident directions to leave out one by one: bands of equal number.
    order = np.lexsort((phi, np.round(theta, 5)))
    found = np.empty(theta.size, int)
    found[order] = np.arange(theta.size) * MOST_GROUPS // theta.size
    return found


def noise_deviation(residual: np.ndarray, size: np.ndarray, used: np.ndarray, near: Neighbourhood) -> np.ndarray:
    """Standard deviation of the noise of each residual (n, C), from differences of neighbours [Rice 1984].

    It is taken as a function of the `size` of the reading (n, C), in bins of equal number; what a model misses smoothly
    cancels in the differences. Never below rounding.
    """
    a, b = near.pairs.T
    both = used[a] & used[b]
    step2 = 0.5 * (residual[a] - residual[b])[both] ** 2
    at = 0.5 * (size[a] + size[b])[both]
    least = ROUNDING * np.abs(size) + 1e-2 * ROUNDING * float(np.sqrt(np.mean(size[used] ** 2)))
    if step2.size < 4:
        return np.maximum(np.std(residual[used]), least)
    order = np.argsort(at, kind="stable")
    parts = [p for p in np.array_split(order, min(BINS, step2.size // 4)) if p.size]
    centre = np.array([np.mean(at[p]) for p in parts])
    level = np.sqrt([np.mean(step2[p]) for p in parts])
    return np.maximum(np.interp(size, centre, level), least)


def worth_of_one(residual: np.ndarray, used: np.ndarray, near: Neighbourhood) -> float:
    """How many readings are worth one independent reading: the design effect of their correlation [Kish 1965].

    Σ over leaves of (Σ r)² over Σ r², channels together: 1 for residuals that are noise, at most a leaf's readings.
    """
    r = np.where(used, residual, 0.0)
    total = float(np.sum(r * r))
    if total == 0:
        return 1.0
    sums = np.bincount(near.leaf, weights=r.sum(axis=1))
    # What independent residuals would show by chance is no correlation: three standard deviations of it are free.
    chance = 3.0 * np.sqrt(2.0 / max(np.count_nonzero(sums), 1))
    return max(1.0, float(np.sum(sums**2)) / total / (1.0 + chance))


def held_out(residual: np.ndarray, rows: np.ndarray, open_numbers: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Σr² of each group's readings (G,) as a fit without the group predicts them.

    Without a second fit: r_g + J_g (JᵀJ − J_gᵀJ_g)⁻¹ J_gᵀ r_g, exact for what the model is linear in [Allen 1974;
    Pregibon 1981, one step]. `residual` (n, C), `rows` (n, C, P); numbers on a bound stay there.
    """
    count = int(groups.max()) + 1
    rows = rows[:, :, open_numbers]
    lengths = np.sqrt(np.einsum("ncp,ncp->p", rows, rows))
    rows = rows / np.where(lengths > 0, lengths, 1.0)
    whole = np.einsum("ncp,ncq->pq", rows, rows)
    found = np.empty(count)
    for g in range(count):
        at = groups == g
        r = residual[at].ravel()
        j = rows[at].reshape(r.size, rows.shape[2])
        left = whole - j.T @ j
        # A trace of damping: a number that only this group tells of has no value without it.
        move = np.linalg.solve(left + 1e-9 * np.eye(left.shape[0]), j.T @ r) if left.size else np.empty(0)
        found[g] = np.sum((r + j @ move) ** 2)
    return found


@dataclasses.dataclass(frozen=True)
class Gain:
    """What a larger model gains on held-out directions, with its standard error, in units of the noise's variance."""

    total: float
    error: float

    @property
    def asked(self) -> bool:
        """Whether the gain is above one standard error."""
        return self.total > self.error


def gain(small: np.ndarray, large: np.ndarray) -> Gain:
    """The gain from Σr² by held-out group of a small and of a large model, (G,) each."""
    d = small - large
    error = float(np.sqrt(d.size) * np.std(d, ddof=1)) if d.size > 1 else float("inf")
    return Gain(float(d.sum()), error)

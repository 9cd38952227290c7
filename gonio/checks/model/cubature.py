"""Directional albedo of a model that is not ours, without trusting its own importance map.

Adaptive product Gauss–Kronrod rules over the hemisphere of outgoing directions, in (θo, φo): the cell with errors is
split until the sum of the errors is small. Where the search for peaks (the mirror direction, back to the light,
directions that the model's sampler draws, the largest values seen) finds one that the nodes of its cell do not see,
that cell is split too. What is left of the errors is the bound.
"""

import numpy as np

from gonio.checks.direction_search import directions, precision, sampled_angles, values
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.low_discrepancy import low_discrepancy

# Kronrod's 15 nodes on [-1, 1] with their weights, and those of the 7-point Gauss rule inside [QUADPACK, qk15].
NODES = np.array([0.991455371120812639206854697526329, 0.949107912342758524526189684047851,
                  0.864864423359769072789712788640926, 0.741531185599394439863864773280788,
                  0.586087235467691130294144691693013, 0.405845151377397166906606412076961,
                  0.207784955007898467600689403773245, 0.0])  # fmt: skip
KRONROD = np.array([0.022935322010529224963732008058970, 0.063092092629978553290700663189204,
                    0.104790010322250183839876322541518, 0.140653259715525918745189590510238,
                    0.169004726639267902826583426598550, 0.190350578064785409913256402421014,
                    0.204432940075298892414161999234649, 0.209482141084727828012999174891714])  # fmt: skip
GAUSS = np.array([0.129484966168869693270611432679082, 0.279705391489276667901467771423780,
                  0.381830050505118944950369775488975, 0.417959183673469387755102040816327])  # fmt: skip
X = np.concatenate([-NODES, NODES[-2::-1]])
W_K = np.concatenate([KRONROD, KRONROD[-2::-1]])
W_G = np.zeros(15)
W_G[1::2] = np.concatenate([GAUSS, GAUSS[-2::-1]])

CELLS = (6, 8)
"""Cells in θo and φo to begin with: nodes are then 1° and 3° apart."""

MAX_CELLS = 1500
"""Cells of one incidence after which the rest of the error is left as the bound: 340,000 evaluations."""


CLEAR = 1e-4
"""Bound that is enough where an albedo is ten times as far from the limit."""

UNFINISHED = 10.0
"""Factor on the bound where the cells ran out."""

PEAK_POINTS = 2000
"""Points near peaks that the nodes of the cells are held against."""


def cubature_albedo(
    brdf: AbstractBRDF, theta_i: float, phi_i: float, tolerance: float = 1e-7, limit: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(albedo, bound on its error), each of shape (channels,), of light from one direction, radians.

    With a `limit`, an albedo that is known to 1e-4 and lies clear of it is not refined further.

    The bound holds for what the nodes and the search for peaks see; a peak narrower than the first nodes' distance
    that is neither where mirrors, retroreflectors nor the model's sampler send light would go unseen.
    """
    wi = directions(np.array(theta_i), np.array(phi_i))
    t, p = (np.linspace(0, top, n + 1) for top, n in ((np.pi / 2, CELLS[0]), (2 * np.pi, CELLS[1])))
    cells = np.stack(
        [c.ravel() for c in np.meshgrid(t[:-1], p[:-1], indexing="ij")]
        + [np.full(CELLS[0] * CELLS[1], a[1]) for a in (t, p)],
        -1,
    )
    value, error, top = _rules(brdf, wi, phi_i, cells)
    peaks, heights = _peaks(brdf, wi, theta_i, phi_i, cells, top)
    rounding = 64 * precision()
    unseen = _unseen(cells, top, peaks, heights)
    while True:
        total, left = value.sum(0), error.sum(0) + rounding * np.abs(value).sum(0)
        worst = np.max(error, axis=-1)
        clear = limit is not None and np.all((left <= CLEAR) & (np.abs(total - limit) > 10 * left))
        if ((clear or np.all(left <= tolerance)) and not unseen.any()) or len(cells) >= MAX_CELLS:
            break
        # The cells that hold the larger part of the error at once, so that few calls are needed.
        order = np.argsort(worst)[::-1]
        split = np.zeros(len(cells), bool)
        split[order[: 1 + np.searchsorted(np.cumsum(worst[order]), 0.9 * worst.sum())][:36]] = True
        split |= unseen
        new = _quartered(cells[split])
        v, e, m = _rules(brdf, wi, phi_i, new)
        fresh = (new, v, e, m, _unseen(new, m, peaks, heights))
        cells, value, error, top, unseen = (
            np.concatenate([old[~split], more])
            for old, more in zip((cells, value, error, top, unseen), fresh, strict=True)
        )
    if len(cells) >= MAX_CELLS:
        # A lobe that needs more cells than there are may also lie in part where none of its nodes is.
        left = np.where(unseen.any(), np.inf, UNFINISHED * left)
    return total, np.where(np.isfinite(total), left, np.inf)


def _rules(brdf, wi, phi_i, cells):
    # Kronrod's sum, its distance from Gauss's, and the largest |f cosθ| at a node of each cell.
    theta = cells[:, 0, None] + cells[:, 2, None] * (X + 1) / 2
    phi = cells[:, 1, None] + cells[:, 3, None] * (X + 1) / 2 + phi_i
    theta, phi = np.broadcast_arrays(theta[:, :, None], phi[:, None, :])
    wo = directions(theta.ravel(), phi.ravel())
    f = values(brdf, wi, wo).reshape(len(cells), 15, 15, -1)
    flux = f * np.cos(theta)[..., None]
    area = (cells[:, 2] * cells[:, 3] / 4)[:, None]
    integrand = flux * np.sin(theta)[..., None]
    fine = np.einsum("nijc,i,j->nc", integrand, W_K, W_K) * area
    coarse = np.einsum("nijc,i,j->nc", integrand, W_G, W_G) * area
    return fine, np.abs(fine - coarse), np.abs(flux).max(axis=(1, 2, 3))


def _quartered(cells):
    half = cells[:, 2:] / 2
    return np.concatenate(
        [np.concatenate([cells[:, :2] + half * [i, j], half], axis=-1) for i in (0, 1) for j in (0, 1)]
    )


def _flux(brdf, wi, phi_i, angles):
    wo = directions(angles[:, 0], angles[:, 1] + phi_i)
    return np.nan_to_num(np.max(np.abs(values(brdf, wi, wo)), axis=-1)) * np.cos(angles[:, 0])


def _peaks(brdf, wi, theta_i, phi_i, cells, top):
    # What a search for peaks of f cosθo saw, near where lobes are wont to be: (θo, φo − φi) and the heights there.
    drawn = sampled_angles(brdf, np.full(64, theta_i), np.full(64, phi_i))
    starts = [[theta_i, np.pi], [theta_i, 0.0], [0.0, 0.0]]
    starts += [[a, b - phi_i] for a, b in zip(*drawn, strict=True) if a < np.pi / 2]
    starts += [cells[k, :2] + cells[k, 2:] / 2 for k in np.argsort(top)[::-1][:8]]
    best = np.array(starts)
    height = _flux(brdf, wi, phi_i, best)
    keep = np.argsort(height)[::-1][:16]
    best, height = best[keep], height[keep]
    seen = [(best, height)]
    u = low_discrepancy(400, 2)
    for size in 0.1 * 0.3 ** np.arange(6):
        r, a = size * np.sqrt(u[:, 0]), 2 * np.pi * u[:, 1]
        step = np.stack([r * np.cos(a), r * np.sin(a)], -1)
        step = step[None] / np.stack([np.ones(len(best)), np.maximum(np.sin(best[:, 0]), 0.05)], -1)[:, None]
        trial = best[:, None] + step
        trial[..., 0] = np.clip(np.abs(trial[..., 0]), 0, np.pi / 2)
        flat = trial.reshape(-1, 2)
        h = _flux(brdf, wi, phi_i, flat)
        seen.append((flat, h))
        by_start = h.reshape(len(best), -1)
        at = np.argmax(by_start, axis=1)
        better = by_start[np.arange(len(best)), at] > height
        best[better] = trial[better, at[better]]
        height = np.maximum(height, by_start.max(axis=1))
    points, heights = (np.concatenate(part) for part in zip(*seen, strict=True))
    tall = np.flatnonzero(heights > 1e-2 * heights.max())
    tall = tall[:: max(1, tall.size // PEAK_POINTS)]
    points, heights = np.concatenate([best, points[tall]]), np.concatenate([height, heights[tall]])
    return points % np.array([np.pi, 2 * np.pi]), heights


def _unseen(cells, top, peaks, heights):
    inside = (peaks[None, :, :] >= cells[:, None, :2]) & (peaks[None, :, :] <= cells[:, None, :2] + cells[:, None, 2:])
    return (inside.all(-1) & (heights[None] > 1.5 * top[:, None] + 1e-12)).any(axis=1)

"""Directional albedo of a model that is not ours, without trusting its own importance map.

Adaptive product Gauss–Kronrod rules over the hemisphere of outgoing directions, in (θo, φo): the cell with errors is
split until the sum of the errors is small. Where the search for peaks (the mirror direction, back to the light,
directions that the model's sampler draws, the largest values so far) finds one that the nodes of its cell miss,
that cell is split too. What remains of the errors is the bound.
"""

import dataclasses

import numpy as np

from gonio.checks.direction_search import directions, keep_best, precision, sampled_angles, values
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


@dataclasses.dataclass(frozen=True)
class _Light:
    """A model lit from one direction; azimuths of outgoing directions count from the light's."""

    brdf: AbstractBRDF
    theta_i: float
    phi_i: float

    def value(self, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        """f at n outgoing directions, (n, channels)."""
        wi = directions(np.array(self.theta_i), np.array(self.phi_i))
        return values(self.brdf, wi, directions(theta, phi + self.phi_i))

    def flux(self, angles: np.ndarray) -> np.ndarray:
        """The largest |f cosθo| of the channels at n directions (n, 2); 0 where it is not finite."""
        largest = np.max(np.abs(self.value(angles[:, 0], angles[:, 1])), axis=-1)
        return np.nan_to_num(largest) * np.cos(angles[:, 0])


@dataclasses.dataclass(frozen=True)
class _Cells:
    """Rectangles in (θo, φo), their Kronrod sums, the errors of these, and what their nodes miss."""

    corner: np.ndarray
    size: np.ndarray
    value: np.ndarray
    error: np.ndarray
    top: np.ndarray
    """(n,): the largest |f cosθ| at a node."""

    def misses(self, peaks: np.ndarray, heights: np.ndarray) -> np.ndarray:
        """(n,): whether a peak lies in the cell that is much higher than all of its nodes."""
        low, high = self.corner[:, None], (self.corner + self.size)[:, None]
        inside = ((peaks >= low) & (peaks <= high)).all(-1)
        return np.any(inside & (heights > 1.5 * self.top[:, None] + 1e-12), axis=1)

    def quarters(self, light: _Light, chosen: np.ndarray) -> "_Cells":
        """The chosen cells, each cut in four."""
        half = self.size[chosen] / 2
        corners = [self.corner[chosen] + half * [i, j] for i in (0, 1) for j in (0, 1)]
        return _integrated(light, np.concatenate(corners), np.tile(half, (4, 1)))

    def replaced(self, chosen: np.ndarray, new: "_Cells") -> "_Cells":
        """With new cells, at the end, for the chosen ones."""
        fields = [f.name for f in dataclasses.fields(self)]
        return _Cells(*(np.concatenate([getattr(self, f)[~chosen], getattr(new, f)]) for f in fields))


def cubature_albedo(
    brdf: AbstractBRDF, theta_i: float, phi_i: float, tolerance: float = 1e-7, limit: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(albedo, bound on its error), each of shape (channels,), of light from one direction, radians.

    With a `limit`, an albedo that is known to 1e-4 and lies clear of it is not refined further.

    The bound holds for what the nodes and the search for peaks see; a peak narrower than the first nodes' distance
    that is neither where mirrors, retroreflectors nor the model's sampler send light would go unnoticed.
    """
    light = _Light(brdf, theta_i, phi_i)
    t, p = (np.linspace(0, top, n + 1) for top, n in ((np.pi / 2, CELLS[0]), (2 * np.pi, CELLS[1])))
    corner = np.stack([c.ravel() for c in np.meshgrid(t[:-1], p[:-1], indexing="ij")], -1)
    cells = _integrated(light, corner, np.tile([t[1], p[1]], (len(corner), 1)))
    peaks, heights = _peaks(light, cells)
    missing = cells.misses(peaks, heights)
    rounding = 64 * precision()
    while True:
        total, error = cells.value.sum(0), cells.error.sum(0) + rounding * np.abs(cells.value).sum(0)
        clear = limit is not None and np.all((error <= CLEAR) & (np.abs(total - limit) > 10 * error))
        if ((clear or np.all(error <= tolerance)) and not missing.any()) or len(cells.corner) >= MAX_CELLS:
            break
        # The cells that hold the larger part of the error at once, so that few calls are needed.
        worst = np.max(cells.error, axis=-1)
        order = np.argsort(worst)[::-1]
        chosen = missing.copy()
        chosen[order[: 1 + np.searchsorted(np.cumsum(worst[order]), 0.9 * worst.sum())][:36]] = True
        new = cells.quarters(light, chosen)
        cells, missing = cells.replaced(chosen, new), np.concatenate([missing[~chosen], new.misses(peaks, heights)])
    if len(cells.corner) >= MAX_CELLS:
        # A lobe that needs more cells than there are may also lie in part where none of its nodes is.
        error = np.where(missing.any(), np.inf, UNFINISHED * error)
    return total, np.where(np.isfinite(total), error, np.inf)


def _integrated(light: _Light, corner: np.ndarray, size: np.ndarray) -> _Cells:
    """Kronrod's sums over cells, their distances from Gauss's, and the largest |f cosθ| at a node of each."""
    theta, phi = (corner[:, k, None] + size[:, k, None] * (X + 1) / 2 for k in (0, 1))
    theta, phi = np.broadcast_arrays(theta[:, :, None], phi[:, None, :])
    f = light.value(theta.ravel(), phi.ravel()).reshape(*theta.shape, -1)
    flux = f * np.cos(theta)[..., None]
    area = (size[:, 0] * size[:, 1] / 4)[:, None]
    integrand = flux * np.sin(theta)[..., None]
    fine, coarse = (np.einsum("nijc,i,j->nc", integrand, w, w) * area for w in (W_K, W_G))
    return _Cells(corner, size, fine, np.abs(fine - coarse), np.abs(flux).max(axis=(1, 2, 3)))


def _peaks(light: _Light, cells: _Cells) -> tuple[np.ndarray, np.ndarray]:
    """(θo, φo − φi) of points near peaks of f cosθo, by a search from where lobes are wont to be; their heights."""
    theta, phi = sampled_angles(light.brdf, *(np.full(64, a) for a in (light.theta_i, light.phi_i)))
    sampled = np.stack([theta, phi - light.phi_i], -1)[theta < np.pi / 2]
    usual = [[light.theta_i, np.pi], [light.theta_i, 0.0], [0.0, 0.0]]
    tallest = np.argsort(cells.top)[::-1][:8]
    best = np.concatenate([usual, sampled, (cells.corner + cells.size / 2)[tallest]])
    height = light.flux(best)
    keep = np.argsort(height)[::-1][:16]
    best, height = best[keep], height[keep]
    points, heights = [best.copy()], [height.copy()]
    u = low_discrepancy(400, 2)
    for size in 0.1 * 0.3 ** np.arange(6):
        r, a = size * np.sqrt(u[:, 0]), 2 * np.pi * u[:, 1]
        step = np.stack([r * np.cos(a), r * np.sin(a)], -1)
        trial = best[:, None] + step / np.stack([np.ones(len(best)), np.maximum(np.sin(best[:, 0]), 0.05)], -1)[:, None]
        trial[..., 0] = np.clip(np.abs(trial[..., 0]), 0, np.pi / 2)
        points.append(trial.reshape(-1, 2))
        heights.append(light.flux(points[-1]))
        keep_best(best, height, trial, heights[-1].reshape(len(best), -1))
    every, tall = np.concatenate(points), np.concatenate(heights)
    near = np.flatnonzero(tall > 1e-2 * tall.max())
    near = near[:: max(1, near.size // PEAK_POINTS)]
    return np.concatenate([best, every[near]]) % np.array([np.pi, 2 * np.pi]), np.concatenate([height, tall[near]])

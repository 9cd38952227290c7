"""Random pairs of directions to which an RGL file is fitted, and where the file's arrays are read for each."""

import dataclasses
from typing import Any

import jax
import numpy as np
from scipy import sparse

from gonio.data.interpolation.rgl_data import RGLData, direction, half_vector_at, warped
from gonio.data.interpolation.rgl_warp import Place, RGLMaterial
from gonio.models.compiling import wide_jit
from gonio.models.geometry.directions import Direction

GRAZING = np.radians(89.9)
LEAST_COSINE = 1e-6
BLOCK = 8192
"""Pairs whose places are computed in one call."""
BAND = (-0.003, 0.05)
"""Cosines of directions near the horizon; most are of the lower ones."""


@dataclasses.dataclass(frozen=True)
class RGLPairs:
    """Pairs (n,) with the weights, as sparse matrices, by which a file's arrays make their values."""

    wi: Direction
    wo: Direction
    samples: sparse.csr_array
    """(n, nodes of the spectra)."""
    ndf: sparse.csr_array
    sigma: sparse.csr_array

    def part(self, kept: np.ndarray) -> "RGLPairs":
        """Those of these numbers, or of this mask."""
        wi, wo = (Direction(*(c[kept] for c in w)) for w in (self.wi, self.wo))
        return RGLPairs(wi, wo, self.samples[kept], self.ndf[kept], self.sigma[kept])


def spread_pairs(data: RGLData, count: int, rng: np.random.Generator) -> RGLPairs:
    """Some `count` pairs, as many at each incidence of a file, spread evenly over its samples and up to half the way
    to its neighbours; `wo` may lie below the horizon."""
    each = -(-count // (data.phi_i.size * data.theta_i.size))
    parts = []
    for p, t in np.ndindex(data.phi_i.size, data.theta_i.size):
        u_x, u_y = warped(data, p, t, *rng.random((2, each)))
        theta = np.minimum(_around(data.theta_i, t, each, rng), GRAZING)
        phi = _around(data.phi_i, p, each, rng)
        wi = direction(theta, phi)
        m = half_vector_at(u_x, u_y)
        facing = np.sum(wi * m, axis=0)
        pair = np.stack([wi, 2 * facing * m - wi])
        parts.append(pair[:, :, facing > LEAST_COSINE])
    wi, wo = np.concatenate(parts, axis=2)
    return place_pairs(data, Direction(*wi), Direction(*wo))


def horizon_pairs(data: RGLData, count: int, rng: np.random.Generator) -> RGLPairs:
    """Random pairs, the light in the file's sector, with `wo` close to the horizon."""
    first = np.where(np.arange(count) % 2, data.theta_i[0], data.theta_i[-2])  # half of them in the last interval
    theta = np.minimum(rng.uniform(first, data.theta_i[-1]), GRAZING)
    phi = rng.uniform(data.phi_i[0], data.phi_i[-1], count)
    wo = direction(np.arccos(BAND[0] + (BAND[1] - BAND[0]) * rng.random(count) ** 3), rng.uniform(0, 2 * np.pi, count))
    return place_pairs(data, Direction(*direction(theta, phi)), Direction(*wo))


def place_pairs(data: RGLData, wi: Direction, wo: Direction) -> RGLPairs:
    """Where a file's arrays are read for pairs of directions (n,)."""
    place = _all_places(RGLMaterial(data), wi, wo)
    (phi, theta), weight = place.slices
    corners = []
    shape = (*data.vndf.shape[:2], *data.spectra.shape[-2:])
    columns, shares = _corners(place.x, place.y, shape[-1], shape[-2])
    for a, b in np.ndindex(weight.shape[1:]):
        first = (phi[:, a, b] * shape[1] + theta[:, a, b]) * (shape[2] * shape[3])
        corners.append((first[:, None] + columns, weight[:, a, b, None] * shares))
    # Two equal rows stand for all azimuths.
    across = [np.full_like(y, 0.5) if data.isotropic else y for y in (place.u_y, place.i_y)]
    ndf = bilinear_matrix(place.u_x, across[0], *data.ndf.shape[::-1])
    sigma = bilinear_matrix(place.i_x, across[1], *data.sigma.shape[::-1])
    indices, values = (np.concatenate(part, axis=1) for part in zip(*corners, strict=True))
    return RGLPairs(wi, wo, _matrix(indices, values, int(np.prod(shape))), ndf, sigma)


def _all_places(material: RGLMaterial, wi: Direction, wo: Direction) -> Any:
    """`Place` of n pairs as NumPy arrays: in blocks of one size, so that one program serves any number of pairs."""
    parts = [np.broadcast_to(np.asarray(c, float), np.shape(wi.z)) for c in (*wi, *wo)]
    n, made = parts[0].size, []
    for start in range(0, n, BLOCK):
        block = [np.resize(c[start : start + BLOCK], BLOCK) for c in parts]
        made.append(_places(material, Direction(*block[:3]), Direction(*block[3:])))
    return jax.tree.map(lambda *a: np.concatenate([np.asarray(v) for v in a])[:n], *made)


@wide_jit
def _places(material: RGLMaterial, wi: Direction, wo: Direction) -> Place:
    return jax.vmap(material.place)(wi, wo)


def _around(nodes: np.ndarray, k: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """Random values nearer to node k than to others."""
    low, high = (0.5 * (nodes[k] + nodes[max(min(k + side, nodes.size - 1), 0)]) for side in (-1, 1))
    return rng.uniform(low, high, count)


def _corners(x: np.ndarray, y: np.ndarray, columns: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """((n, 4) numbers, (n, 4) weights) of the nodes around positions in the unit square."""
    x, y = np.clip(x, 0, 1) * (columns - 1), np.clip(y, 0, 1) * (rows - 1)
    i, j = np.minimum(np.int64(x), columns - 2), np.minimum(np.int64(y), rows - 2)
    s, t = x - i, y - j
    first = j * columns + i
    numbers = np.stack([first, first + 1, first + columns, first + columns + 1], axis=1)
    return numbers, np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], axis=1)


def bilinear_matrix(x: np.ndarray, y: np.ndarray, columns: int, rows: int) -> sparse.csr_array:
    """(n, rows · columns): the weights that make values at positions (n,) of the unit square of a map's nodes."""
    return _matrix(*_corners(x, y, columns, rows), rows * columns)


def _matrix(indices: np.ndarray, values: np.ndarray, columns: int) -> sparse.csr_array:
    n, each = indices.shape
    return sparse.csr_array((values.ravel(), indices.ravel(), np.arange(0, n * each + 1, each)), (n, columns))

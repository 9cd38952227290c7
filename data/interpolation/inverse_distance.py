"""Scattered samples as a material: an inverse-distance mean of the nearest ones."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.data.flags import Flag
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import Direction, rotate_z
from gonio.models.warps.grazing_azimuth import polar_parts

CHUNK, FEW = 64, 16
"""Samples whose distances are computed at once; of fewer than the second that many."""
MAX_SAMPLES = 50_000
"""Every sample is visited for every value: beyond this a grid is the better table."""
ROWS = 256
"""Of distances at once."""
SOFTENING = 1e-12
"""Squared distance at which a sample counts as met: its weight is then beyond all others'."""
DESCRIPTION = (
    "inverse-distance mean of all scattered samples, weights 1/d⁶ with d² = |wi − wi'|² + |wo − wo'|²{}; an "
    "approximation"
)
SWAPPED = ", or the same with a sample's directions swapped if smaller (reciprocity is assumed)"


class Scattered(AbstractBRDF):
    """The inverse-distance mean of scattered samples [Shepard 1968], weights 1/d⁶: it falls off faster than
    the number of samples in a shell of the three or four dimensions grows, so the near ones decide.

    Distance of two pairs: |wi − wi'|² + |wo − wo'|², or, if `reciprocal`, that to the swapped sample if smaller.
    Where all samples have the light at one azimuth the surface is taken as isotropic: a pair is first turned
    to that azimuth.
    """

    pairs: Float[Array, "chunks 6 chunk"]
    values: Float[Array, "chunks chunk channel"]
    valid: Float[Array, "chunks chunk #channel"]
    """1 where there is a value, else 0; one column where that is the same for all channels."""
    same_all_round: bool = eqx.field(static=True)
    reciprocal: bool = eqx.field(static=True, default=True)

    @property
    def isotropic(self) -> bool:
        return self.same_all_round

    def formula(self, wi: Direction, wo: Direction) -> Float[Array, " channel"]:
        forward, backward = self._turned(wi, wo), self._turned(wo, wi)

        def step(sums: tuple[Array, Array], chunk: tuple[Array, Array, Array]) -> tuple[tuple[Array, Array], None]:
            samples, values, valid = chunk
            d2 = _distance2(samples, forward)
            if self.reciprocal:
                d2 = jnp.minimum(d2, _distance2(samples, backward))
            weight = 1.0 / (d2 + SOFTENING) ** 3
            return (sums[0] + weight @ values, sums[1] + weight @ valid), None

        zeros = [jnp.zeros(a.shape[-1], a.dtype) for a in (self.values, self.valid)]
        (total, weight), _ = jax.lax.scan(step, (zeros[0], zeros[1]), (self.pairs, self.values, self.valid))
        known = weight > 0
        return jnp.where(known, total / jnp.where(known, weight, 1.0), 0.0)

    def _turned(self, wi: Direction, wo: Direction) -> Float[Array, " 6"]:
        if not self.same_all_round:
            return jnp.stack([*wi, *wo])
        _, cos_p, sin_p = polar_parts(wi)
        return jnp.stack([*rotate_z(wi, cos_p, -sin_p), *rotate_z(wo, cos_p, -sin_p)])


def _distance2(samples: Array, pair: Array) -> Array:
    """By components, so that the samples of a chunk fill the processor's vectors."""
    return sum((samples[k] - pair[k]) ** 2 for k in range(6))  # pyright: ignore[reportReturnType]


def scattered_material(table: Table, reciprocal: bool = True) -> Scattered:
    """The interpolant of a scattered table. Raises GonioError for more than `MAX_SAMPLES` samples.

    `reciprocal`: whether a sample stands for its directions swapped too.
    """
    block = table.samples()
    n = block.f.shape[0]
    if n > MAX_SAMPLES:
        raise GonioError(
            f"{n} scattered samples are too many to interpolate (at most {MAX_SAMPLES}); fit a model, or thin them out"
        )
    wi, wo = block.wi, block.wo
    isotropic = one_azimuth(wi)
    if isotropic:
        wi, wo = _turned_back(wi, wo)
    dtype = jnp.result_type(float)
    valid = block.flag == Flag.VALID
    alike = valid[:, :1] if (valid == valid[:, :1]).all() else valid
    arrays = np.stack([*wi, *wo], axis=-1), np.where(valid, block.f, 0.0), alike
    pairs, values, known = (jnp.asarray(chunks(a), dtype) for a in arrays)
    return Scattered(jnp.swapaxes(pairs, 1, 2), values, known, isotropic, reciprocal)


def one_azimuth(wi: Direction) -> bool:
    """Whether the light of all samples, NumPy components (n,), comes from one azimuth."""
    azimuth = np.arctan2(wi.y, wi.x)[np.hypot(wi.x, wi.y) > 1e-9]
    return bool(azimuth.size == 0 or np.ptp(azimuth) < 1e-9)


def left_out(wi: Direction, wo: Direction, values: np.ndarray, isotropic: bool, reciprocal: bool = True) -> np.ndarray:
    """The mean (n, C) of all other samples' values at each of the samples (n, C), all of them valid."""
    if isotropic:
        wi, wo = _turned_back(wi, wo)
    pairs, swapped = np.stack([*wi, *wo], axis=-1), np.stack([*wo, *wi], axis=-1)
    if isotropic:
        swapped = np.stack([c for w in _turned_back(wo, wi, each=True) for c in w], axis=-1)
    means = np.empty_like(values, dtype=float)
    for start in range(0, len(pairs), ROWS):
        part = np.arange(start, min(start + ROWS, len(pairs)))
        d2 = _squares(pairs, pairs[part])
        if reciprocal:
            d2 = np.minimum(d2, _squares(pairs, swapped[part]))
        weight = 1.0 / (d2 + SOFTENING) ** 3
        weight[np.arange(part.size), part] = 0.0
        means[start : start + ROWS] = weight @ values / weight.sum(axis=1, keepdims=True)
    return means


def _squares(samples: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(m, n) squared distances."""
    return sum((pairs[:, None, k] - samples[None, :, k]) ** 2 for k in range(6))  # pyright: ignore[reportReturnType]


def _turned_back(wi: Direction, wo: Direction, each: bool = False) -> tuple[Direction, Direction]:
    """Pairs (n,) turned about the normal so that wi has azimuth 0: all by one angle, or each by its own."""
    sine = np.hypot(wi.x, wi.y)
    cos, sin = np.where(sine > 1e-9, wi.x, 1.0), np.where(sine > 1e-9, wi.y, 0.0)
    cos, sin = cos / np.hypot(cos, sin), sin / np.hypot(cos, sin)
    if not each:
        first = int(np.argmax(sine > 1e-9))
        cos, sin = cos[first], sin[first]
    turned_i, turned_o = (rotate_z(w, cos, -sin) for w in (wi, wo))
    return turned_i, turned_o


def chunks(rows: np.ndarray) -> np.ndarray:
    """Rows in groups of `CHUNK`, filled up with zeros (samples that have no value)."""
    size = FEW if rows.shape[0] <= FEW else CHUNK
    return np.pad(rows.astype(float), ((0, -rows.shape[0] % size), (0, 0))).reshape(-1, size, rows.shape[1])

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

CHUNK = 64
MAX_SAMPLES = 50_000
"""Every sample is visited for every value: beyond this a grid is the better table."""
SOFTENING = 1e-12
"""Squared distance at which a sample counts as met: its weight is then beyond all others'."""
DESCRIPTION = (
    "inverse-distance mean of all scattered samples, weights 1/d⁶ with d² = |wi − wi'|² + |wo − wo'|², or the same "
    "with a sample's directions swapped if smaller (reciprocity is assumed); an approximation"
)


class Scattered(AbstractBRDF):
    """The inverse-distance mean of scattered samples [Shepard 1968], weights 1/d⁶: it falls off faster than
    the number of samples in a shell of the three or four dimensions grows, so the near ones decide.

    Distance of two pairs: |wi − wi'|² + |wo − wo'|², or that to the swapped sample if smaller (reciprocity).
    Where all samples have the light at one azimuth the surface is taken as isotropic: a pair is first turned
    to that azimuth.
    """

    pairs: Float[Array, "chunks chunk 6"]
    values: Float[Array, "chunks chunk channel"]
    valid: Float[Array, "chunks chunk channel"]
    """1 where there is a value, else 0."""
    same_all_round: bool = eqx.field(static=True)

    @property
    def isotropic(self) -> bool:
        return self.same_all_round

    def formula(self, wi: Direction, wo: Direction) -> Float[Array, " channel"]:
        forward, backward = self._turned(wi, wo), self._turned(wo, wi)

        def step(sums: tuple[Array, Array], chunk: tuple[Array, Array, Array]) -> tuple[tuple[Array, Array], None]:
            samples, values, valid = chunk
            d2 = jnp.minimum(_distance2(samples, forward), _distance2(samples, backward))
            weight = valid / (d2 + SOFTENING)[:, None] ** 3
            return (sums[0] + jnp.sum(weight * values, 0), sums[1] + jnp.sum(weight, 0)), None

        zero = jnp.zeros(self.values.shape[-1], self.values.dtype)
        (total, weight), _ = jax.lax.scan(step, (zero, zero), (self.pairs, self.values, self.valid))
        known = weight > 0
        return jnp.where(known, total / jnp.where(known, weight, 1.0), 0.0)

    def _turned(self, wi: Direction, wo: Direction) -> Float[Array, " 6"]:
        if not self.same_all_round:
            return jnp.stack([*wi, *wo])
        _, cos_p, sin_p = polar_parts(wi)
        return jnp.stack([*rotate_z(wi, cos_p, -sin_p), *rotate_z(wo, cos_p, -sin_p)])


def _distance2(samples: Array, pair: Array) -> Array:
    return jnp.sum((samples - pair[None, :]) ** 2, axis=-1)


def scattered_material(table: Table) -> Scattered:
    """The interpolant of a scattered table. Raises GonioError for more than `MAX_SAMPLES` samples."""
    block = table.samples()
    n = block.f.shape[0]
    if n > MAX_SAMPLES:
        raise GonioError(
            f"{n} scattered samples are too many to interpolate (at most {MAX_SAMPLES}); fit a model, or thin them out"
        )
    wi, wo = block.wi, block.wo
    sin_i = np.hypot(wi.x, wi.y)
    azimuth = np.arctan2(wi.y, wi.x)[sin_i > 1e-9]
    isotropic = azimuth.size == 0 or np.ptp(azimuth) < 1e-9
    if isotropic and azimuth.size:
        c, s = np.cos(azimuth[0]), -np.sin(azimuth[0])
        wi, wo = (rotate_z(w, c, s) for w in (wi, wo))
    dtype = jnp.result_type(float)
    valid = block.flag == Flag.VALID
    arrays = np.stack([*wi, *wo], axis=-1), np.where(valid, block.f, 0.0), valid
    pairs, values, known = (jnp.asarray(_chunks(a), dtype) for a in arrays)
    return Scattered(pairs, values, known, bool(isotropic))


def _chunks(rows: np.ndarray) -> np.ndarray:
    """Rows in groups of `CHUNK`, filled up with zeros (samples that have no value)."""
    return np.pad(rows.astype(float), ((0, -rows.shape[0] % CHUNK), (0, 0))).reshape(-1, CHUNK, rows.shape[1])

"""Scattered samples as a material: an inverse-distance mean of the nearest ones."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from gonio.data.flags import Flag
from gonio.data.layout import HORIZON
from gonio.data.table import Table
from gonio.models.base import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.geometry import Direction, rotate_z

NEIGHBOURS = 8
CHUNK = 32
MAX_SAMPLES = 50_000
"""Every sample is visited for every value: beyond this a grid is the better table."""
DESCRIPTION = (
    f"inverse-distance mean of the {NEIGHBOURS} nearest scattered samples, by |wi − wi'|² + |wo − wo'|² or the same "
    "with a sample's directions swapped (reciprocity is assumed); an approximation of first order"
)


class Scattered(AbstractBRDF):
    """Franke and Little's modified inverse-distance mean [Franke 1982] over the nearest scattered samples.

    Distance of two pairs: |wi − wi'|² + |wo − wo'|², or that to the swapped sample if smaller (reciprocity).
    Where all samples have the light at one azimuth the surface is taken as isotropic: a pair is first turned
    to that azimuth.
    """

    pairs: Float[Array, "chunks chunk 6"]
    values: Float[Array, "sample channel"]
    valid: Bool[Array, "sample channel"]
    isotropic: bool = eqx.field(static=True)

    def f(self, wi, wo):
        forward, backward = self._turned(wi, wo), self._turned(wo, wi)
        k = NEIGHBOURS + 1

        def step(best, chunk):
            samples, first = chunk
            d2 = jnp.minimum(_distance2(samples, forward), _distance2(samples, backward))
            number = first + jnp.arange(CHUNK, dtype=jnp.int32)
            negative, at = jax.lax.top_k(-jnp.concatenate([best[0], d2]), k)
            return (-negative, jnp.concatenate([best[1], number])[at]), None

        start = (jnp.full(k, jnp.inf, self.pairs.dtype), jnp.zeros(k, jnp.int32))
        first = jnp.arange(0, self.pairs.shape[0] * CHUNK, CHUNK, dtype=jnp.int32)
        (d2, nearest), _ = jax.lax.scan(step, start, (self.pairs, first))
        distance = jnp.sqrt(d2)
        # The farthest of the nine sets the radius where the weight reaches 0: neighbours come and go smoothly.
        farthest = jnp.max(jnp.where(jnp.isfinite(distance), distance, 0.0))
        radius = jnp.where(jnp.isfinite(distance[-1]), farthest, 2.0 * farthest)
        inside = jnp.maximum(radius - distance, 0.0) / jnp.maximum(radius * distance, 1e-9 * radius**2 + 1e-18)
        weight = jnp.where(self.valid[nearest], (inside**2)[:, None], 0.0)
        total = jnp.sum(weight, 0)
        found = total > 0
        value = jnp.sum(weight * self.values[nearest], 0) / jnp.where(found, total, 1.0)
        nearest_value = jnp.where(self.valid[nearest[0]], self.values[nearest[0]], 0.0)
        value = jnp.where(found, value, nearest_value)
        return jnp.where((wi.z > HORIZON) & (wo.z > HORIZON), value, 0.0)

    def _turned(self, wi, wo):
        if not self.isotropic:
            return jnp.stack([*wi, *wo])
        sin_i = jnp.sqrt(wi.x**2 + wi.y**2)
        at_pole = sin_i == 0
        safe = jnp.where(at_pole, 1.0, sin_i)
        cos_p, sin_p = jnp.where(at_pole, 1.0, wi.x / safe), jnp.where(at_pole, 0.0, -wi.y / safe)
        return jnp.stack([*rotate_z(wi, cos_p, sin_p), *rotate_z(wo, cos_p, sin_p)])


def _distance2(samples, pair):
    return jnp.sum((samples - pair[None, :]) ** 2, axis=-1)


def scattered_material(table: Table) -> Scattered:
    """The interpolant of a scattered table. Raises GonioError for more than `MAX_SAMPLES` samples, or no valid one."""
    block = table.samples()
    n = block.f.shape[0]
    if n == 0:
        raise GonioError(f"table {table.name or 'without a name'} holds no valid reading; nothing can be interpolated")
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
        wi, wo = (Direction(w.x * c - w.y * s, w.x * s + w.y * c, w.z) for w in (wi, wo))
    dtype = jnp.result_type(float)
    pairs = np.full((-(-n // CHUNK) * CHUNK, 6), np.inf)
    pairs[:n] = np.stack([*wi, *wo], axis=-1)
    valid = block.flag == Flag.VALID
    return Scattered(
        jnp.asarray(pairs.reshape(-1, CHUNK, 6), dtype),
        jnp.asarray(np.where(valid, block.f, 0.0), dtype),
        jnp.asarray(valid),
        bool(isotropic),
    )

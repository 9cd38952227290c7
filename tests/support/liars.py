"""Published models that gain energy or are not reciprocal, and honest ones, written as anybody might write them.

None has an importance map of its own: they are what a check meets when a model comes from outside.
"""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import add, dot, norm, normalize


def above(wi, wo, value):
    return jnp.where((wi.z > 0) & (wo.z > 0), value, 0.0)


def tan2_half(wi, wo):
    h = normalize(add(wi, wo))
    return (h.x**2 + h.y**2) / jnp.maximum(h.z, 1e-150) ** 2


class BlinnPhong(AbstractBRDF):
    """The renderers' (n + 8)/8π."""

    n: float

    def f(self, wi, wo):
        h = normalize(add(wi, wo))
        return above(wi, wo, (self.n + 8) / (8 * jnp.pi) * jnp.maximum(h.z, 0.0) ** self.n)


class WardDuer(AbstractBRDF):
    """Ward's lobe with Dür's 1/(cosθi cosθo)."""

    alpha: float

    def f(self, wi, wo):
        lobe = jnp.exp(-tan2_half(wi, wo) / self.alpha**2) / (4 * jnp.pi * self.alpha**2)
        return above(wi, wo, lobe / (wi.z * wo.z))


class Ward(AbstractBRDF):
    """Ward 1992: it loses energy at grazing, and gains none."""

    alpha: float

    def f(self, wi, wo):
        lobe = jnp.exp(-tan2_half(wi, wo) / self.alpha**2) / (4 * jnp.pi * self.alpha**2)
        return above(wi, wo, lobe / jnp.sqrt(jnp.abs(wi.z * wo.z)))


class CookTorrance1982(AbstractBRDF):
    """With 1982's 1/π and an un-normalised D: four times too much."""

    m: float

    def f(self, wi, wo):
        h = normalize(add(wi, wo))
        d = jnp.exp(-tan2_half(wi, wo) / self.m**2) / (self.m**2 * jnp.maximum(h.z, 1e-70) ** 4)
        cos_d = jnp.maximum(dot(wi, h), 1e-150)
        g = jnp.minimum(1.0, 2 * h.z * jnp.minimum(wi.z, wo.z) / cos_d)
        return above(wi, wo, d * g / (jnp.pi * wi.z * wo.z))


class DisneyDiffuse(AbstractBRDF):
    """Burley 2012."""

    roughness: float

    def f(self, wi, wo):
        f90 = 0.5 + 2 * self.roughness * (0.5 * norm(add(wi, wo))) ** 2
        rim_i, rim_o = (1 + (f90 - 1) * (1 - w.z) ** 5 for w in (wi, wo))
        return above(wi, wo, rim_i * rim_o / jnp.pi)


class Minnaert(AbstractBRDF):
    """(k + 1)/2π (cosθi cosθo)^(k−1): gains for k < 1."""

    k: float

    def f(self, wi, wo):
        return above(wi, wo, (self.k + 1) / (2 * jnp.pi) * (jnp.abs(wi.z * wo.z) + 1e-300) ** (self.k - 1))


class OrenNayarFull(AbstractBRDF):
    """Oren & Nayar 1994 with the interreflection term, albedo 1."""

    sigma: float

    def f(self, wi, wo):
        s2 = self.sigma**2
        theta_i, theta_o = (jnp.arccos(jnp.clip(w.z, -1, 1)) for w in (wi, wo))
        alpha, beta = jnp.maximum(theta_i, theta_o), jnp.minimum(theta_i, theta_o)
        size = jnp.sqrt((wi.x**2 + wi.y**2) * (wo.x**2 + wo.y**2))
        cos_phi = jnp.where(size > 1e-15, (wi.x * wo.x + wi.y * wo.y) / jnp.where(size > 1e-15, size, 1.0), 0.0)
        rim = jnp.where(cos_phi >= 0, 0.0, (2 * beta / jnp.pi) ** 3)
        c1 = 1 - 0.5 * s2 / (s2 + 0.33)
        c2 = 0.45 * s2 / (s2 + 0.09) * (jnp.sin(alpha) - rim)
        c3 = 0.125 * s2 / (s2 + 0.09) * (4 * alpha * beta / jnp.pi**2) ** 2
        mean = jnp.tan(jnp.minimum(alpha + beta, 3.14159) / 2)
        first = c1 + cos_phi * c2 * jnp.tan(beta) + (1 - jnp.abs(cos_phi)) * c3 * mean
        second = 0.17 * s2 / (s2 + 0.13) * (1 - cos_phi * (2 * beta / jnp.pi) ** 2)
        return above(wi, wo, (first + second) / jnp.pi)


class PhongOverCosine(AbstractBRDF):
    """Phong's lobe divided by cosθi alone."""

    n: float

    def f(self, wi, wo):
        c = jnp.maximum(wi.z * wo.z - wi.x * wo.x - wi.y * wo.y, 0.0)
        return above(wi, wo, 0.2 * c**self.n / jnp.maximum(wi.z, 1e-300))


class CoatedDiffuse(AbstractBRDF):
    """A diffuse term scaled by what the coat lets in, but not by what it lets out."""

    f0: float

    def f(self, wi, wo):
        return above(wi, wo, 0.8 / jnp.pi * (1 - self.f0 - (1 - self.f0) * (1 - wi.z) ** 5))


class Foreign(AbstractBRDF):
    """A model of ours without the importance map that would help to integrate it."""

    base: AbstractBRDF

    def f(self, wi, wo):
        return self.base.f(wi, wo)


class Lopsided(AbstractBRDF):
    """Reciprocal, but not mirror symmetric; below 0 somewhere where the level is less than 0.3."""

    level: float

    def f(self, wi, wo):
        return above(wi, wo, (self.level + 0.3 * (wi.x * wo.y + wo.x * wi.y)) / jnp.pi)

"""The dipole with Grosjean's diffusion and exitance from both fluence and flux."""

from typing import NamedTuple

import jax.numpy as jnp

from gonio.models.arrays import Channels, Scalar
from gonio.models.subsurface.base import (
    AbstractBSSRDF,
    of_source,
    root,
    within,
)
from gonio.models.subsurface.internal_reflection import first_moment, second_moment


class _Sources(NamedTuple):
    strength: Channels
    """α'²/2."""
    sigma: Channels
    real: Channels
    image: Channels
    flux: Channels
    """C_E."""
    fluence: Channels
    """C_φ/D."""


class BetterDipole(AbstractBSSRDF):
    """R = α'²/(4π) [C_E Σ z (1 + σd) e^(−σd)/d³ + (C_φ/D) (e^(−σd)/d of source less image)] [d'Eon 2012].

    D = (2σa + σs')/(3 σt'²) [Grosjean], σ = √(σa/D); the image lies 4AD above the source, A = (1 + 3C₂)/(1 − 2C₁),
    C_φ = (1 − 2C₁)/4, C_E = (1 − 3C₂)/2 by the exact moments of the reflection from within.
    """

    limits = (
        "less than a half space reflects: by 30 % at an albedo of 0.8, 9 % at 0.95, 2 % at 0.99 (isotropic scattering, "
        "matched index), as light scattered once is left out; with it, 13 to 18 % more than a half space does"
    )

    def _sources(self) -> _Sources:
        z = 1.0 / self.extinction
        diffusion = (self.absorption + self.extinction) * z * z / 3.0
        c1, c2 = first_moment(self.eta), second_moment(self.eta)
        image = z + 4.0 * diffusion * (1.0 + c2) / (1.0 - c1)
        strength, sigma = 0.5 * (self.scattering * z) ** 2, root(self.absorption / diffusion)
        return _Sources(strength, sigma, z, image, 0.5 * (1.0 - c2), 0.25 * (1.0 - c1) / diffusion)

    def profile(self, r: Scalar) -> Channels:
        s = self._sources()
        real, image = (jnp.sqrt(r * r + z * z) for z in (s.real, s.image))
        fluence = jnp.exp(-s.sigma * real) / real - jnp.exp(-s.sigma * image) / image
        flux = of_source(s.real, s.sigma, r) + of_source(s.image, s.sigma, r)
        return s.strength / (2.0 * jnp.pi) * (s.flux * flux + s.fluence * fluence)

    def cumulative(self, r: Scalar) -> Channels:
        s = self._sources()
        flux = within(s.real, s.sigma, r) + within(s.image, s.sigma, r)
        real, image = (
            jnp.exp(-s.sigma * z) * _slope(s.sigma, r * r / (jnp.sqrt(r * r + z * z) + z)) for z in (s.real, s.image)
        )
        return s.strength * (s.flux * flux + s.fluence * (real - image))

    def hankel(self, k: Scalar) -> Channels:
        s = self._sources()
        q = jnp.sqrt(k * k + s.sigma * s.sigma)
        real, image = jnp.exp(-s.real * q), jnp.exp(-s.image * q)
        return s.strength * (s.flux * (real + image) + s.fluence * real * _slope(q, s.image - s.real))


def _slope(sigma: Channels, x: Channels) -> Channels:
    """(1 − e^(−σx))/σ; x where σ is 0."""
    small = sigma < 1e-100
    safe = jnp.where(small, 1.0, sigma)
    return jnp.where(small, x, -jnp.expm1(-safe * x) / safe)

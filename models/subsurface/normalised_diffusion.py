"""Two exponentials fitted to Monte Carlo profiles."""

import jax.numpy as jnp

from gonio.models.arrays import Channels, Scalar
from gonio.models.subsurface.base import (
    AbstractBSSRDF,
)
from gonio.models.volume_scatter.chandrasekhar_h import half_space_albedo


class NormalisedDiffusion(AbstractBSSRDF):
    """R = A s (e^(−sr) + e^(−sr/3))/(8πr), s = (1.85 − A + 7|A − 0.8|³) σt' [Christensen & Burley 2015, eqs. 3, 5].

    For a narrow beam along the normal. A, the share that leaves, is the exact one of a half space of isotropic
    scatterers with this α', 1 − √(1 − α') H(1) [Chandrasekhar 1960]; the index enters by Ft only.
    """

    limits = (
        "right in the total and to 10 % within three mean free paths (isotropic scattering, matched index); beyond ten "
        "of them off by up to 45 %, beyond thirty nearly all is missing; internal reflection is left out"
    )

    def _shape(self) -> tuple[Channels, Channels]:
        """(A, s)."""
        w = self.scattering / self.extinction
        share = half_space_albedo(jnp.ones((), w.dtype), w)
        return share, (1.85 - share + 7.0 * jnp.abs(share - 0.8) ** 3) * self.extinction

    def profile(self, r: Scalar) -> Channels:
        share, s = self._shape()
        return share * s * (jnp.exp(-s * r) + jnp.exp(-s * r / 3.0)) / (8.0 * jnp.pi * r)

    def cumulative(self, r: Scalar) -> Channels:
        share, s = self._shape()
        return -share * (jnp.expm1(-s * r) / 4.0 + 0.75 * jnp.expm1(-s * r / 3.0))

    def hankel(self, k: Scalar) -> Channels:
        share, s = self._shape()
        k2, s2 = k * k, s * s
        return 0.25 * share * s * (1.0 / jnp.sqrt(s2 + k2) + 1.0 / jnp.sqrt(s2 / 9.0 + k2))

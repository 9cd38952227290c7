"""What every BSSRDF is: light that enters a translucent half space at one place and leaves it at another."""

import abc
from typing import Any, ClassVar, NamedTuple, final

import equinox as eqx
import jax.numpy as jnp

from gonio.models.arrays import Channels, Scalar
from gonio.models.errors import GonioError
from gonio.models.fresnel import fresnel_dielectric
from gonio.models.geometry.directions import Direction
from gonio.models.parameters import ParameterInfo, parameter

MOST = 1e5
"""1/mm: a mean free path of 10 nm."""
ABSORPTION = ParameterInfo(0.0, MOST, "1/mm", "absorption coefficient σa", start=0.01, role="coefficient", log=True)
SCATTERING = ParameterInfo(
    0.0, MOST, "1/mm", "scattering coefficient σs; σs' = σs (1 − g)", start=1.0, role="coefficient", log=True
)
ASYMMETRY = ParameterInfo(-0.99, 0.99, "1", "mean cosine g of a scattering", start=0.0, role="phase")
INDEX = ParameterInfo(1.0, 3.0, "1", "index of the material over that outside", start=1.3, role="index")
ALBEDO = ParameterInfo(0.0, 1.0, "1", "albedo α' = σs'/σt' of a reduced scattering", start=0.9, role="albedo")
FREE_PATH = ParameterInfo(1e-5, 1e5, "mm", "reduced mean free path 1/σt', σt' = σa + σs'", start=1.0, role="length")


class Position(NamedTuple):
    """A place on the surface, mm."""

    x: Scalar
    y: Scalar


class AbstractBSSRDF(eqx.Module):
    """A translucent half space: S(xi, wi; xo, wo) = Ft(wi) R(|xo − xi|) Ft(wo)/π, radiance per flux, 1/(mm² sr).

    R is the exitance at a distance from a narrow beam of unit flux that passed the surface, and Ft what the surface
    lets pass. A model gives R with its integrals; lengths are mm; σa with σs (and g), or α' with 1/σt', say the
    material. Methods take scalars (shape ``()``), parameters may carry one channel axis.
    """

    limits: ClassVar[str]
    """Where the model is wrong, and by how much: one sentence."""

    sigma_a: Channels | None = parameter(ABSORPTION, default=None)
    sigma_s: Channels | None = parameter(SCATTERING, default=None)
    g: Channels = parameter(ASYMMETRY, default=0.0)
    eta: Channels = parameter(INDEX, default=1.0)
    albedo: Channels | None = parameter(ALBEDO, default=None)
    mfp: Channels | None = parameter(FREE_PATH, default=None)

    def __check_init__(self) -> None:
        known = [v is not None for v in (self.sigma_a, self.sigma_s, self.albedo, self.mfp)]
        if known not in ([True, True, False, False], [False, False, True, True]):
            raise GonioError("light below a surface takes sigma_a and sigma_s, or albedo and mfp (mm): give one pair")

    @property
    def absorption(self) -> Channels:
        """σa, 1/mm."""
        return (1.0 - self.albedo) / self.mfp if self.sigma_a is None else self.sigma_a  # pyright: ignore

    @property
    def scattering(self) -> Channels:
        """σs' = σs (1 − g), 1/mm."""
        return self.albedo / self.mfp if self.sigma_s is None else self.sigma_s * (1.0 - self.g)  # pyright: ignore

    @property
    def extinction(self) -> Channels:
        """σt' = σa + σs', 1/mm, kept above 0."""
        return jnp.maximum(self.absorption + self.scattering, 1e-30)

    @abc.abstractmethod
    def profile(self, r: Scalar) -> Channels:
        """R, 1/mm², at a distance r > 0 mm."""

    @abc.abstractmethod
    def cumulative(self, r: Scalar) -> Channels:
        """∫₀ʳ R 2πr dr: the share that leaves within r ≥ 0 mm."""

    @abc.abstractmethod
    def hankel(self, k: Scalar) -> Channels:
        """R̂(k) = ∫ R J₀(kr) 2πr dr, for k ≥ 0, 1/mm."""

    @final
    def total(self) -> Channels:
        """∫ R dA: the share that leaves anywhere."""
        return self.hankel(jnp.zeros(()))

    @final
    def transmittance(self, cosine: Scalar) -> Channels:
        """Ft: the share of the light at an angle of this cosine in [0, 1] that passes the smooth surface."""
        return 1.0 - fresnel_dielectric(cosine, self.eta)

    @final
    def s(self, xi: Position, wi: Direction, xo: Position, wo: Direction) -> Channels:
        """S(xi, wi; xo, wo), 1/(mm² sr), for directions above the horizon."""
        distance = jnp.hypot(xo.x - xi.x, xo.y - xi.y)
        return self.transmittance(wi.z) * self.profile(distance) * self.transmittance(wo.z) / jnp.pi


def root(x: Any) -> Any:
    """√x for x ≥ 0, with a finite slope at 0."""
    return jnp.sqrt(jnp.maximum(x, 0.0) + jnp.finfo(jnp.result_type(x)).tiny)


def of_source(z: Channels, sigma: Channels, r: Scalar) -> Channels:
    """z (1 + σd) e^(−σd)/d³ with d² = r² + z²: 2π times the flux through the plane from a source at depth z."""
    d = jnp.sqrt(r * r + z * z)
    return z * (1.0 + sigma * d) * jnp.exp(-sigma * d) / d**3


def within(z: Channels, sigma: Channels, r: Scalar) -> Channels:
    """∫₀ʳ `of_source` r dr = e^(−σz) − (z/d) e^(−σd), without a difference of equal terms."""
    d = jnp.sqrt(r * r + z * z)
    beyond = r * r / (d + z)
    return jnp.exp(-sigma * z) * (beyond / d - (z / d) * jnp.expm1(-sigma * beyond))

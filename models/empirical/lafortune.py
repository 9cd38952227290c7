"""The generalised cosine lobe."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Sample, Scalar, known_equal, parameter
from gonio.models.empirical.phong import Phong
from gonio.models.geometry.directions import normalize
from gonio.models.geometry.guards import least_positive

C_X = ParameterInfo(
    -2.0, 2.0, "1", "weight of wi.x wo.x: negative mirrors, positive sends back", start=-0.6, role="weight"
)
C_Y = ParameterInfo(
    -2.0, 2.0, "1", "weight of wi.y wo.y: negative mirrors, positive sends back", start=-0.6, role="weight"
)
C_Z = ParameterInfo(0.0, 2.0, "1", "weight of wi.z wo.z", start=0.57, role="weight")
N = ParameterInfo(0.0, 1e5, "1", "exponent of the weighted cosine", start=30.0, role="exponent", log=True)


class Lafortune(AbstractBRDF):
    """f = (c_x wi.x wo.x + c_y wi.y wo.y + c_z wi.z wo.z)ⁿ: a generalised cosine lobe [Lafortune et al. 1997, eq. 4].

    0 where the bracket is not positive. `norm`: "lafortune" (as written), or "ngan", which multiplies by
    (n+2)/(2π max|c|ⁿ) [Ngan et al. 2005] and then reflects at most 1. −c_x = −c_y = c_z is Phong's lobe; a surface of
    several lobes is a sum. Values beyond the largest floating-point number (c > 1 with a large n) are held below it.
    """

    lobe = True
    violates: ClassVar = {"energy": "As written its height is free: 2π c_zⁿ/(n+2) at normal incidence, π for n = 0."}

    c_x: Channels = parameter(C_X)
    c_y: Channels = parameter(C_Y)
    c_z: Channels = parameter(C_Z)
    n: Channels = parameter(N)
    norm: str = eqx.field(static=True, default="lafortune", metadata={"choices": ("lafortune", "ngan")})

    @property
    def isotropic(self) -> bool:
        return known_equal(self.c_x, self.c_y)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        sizes = [jnp.where(c < 0, -c, c) for c in (self.c_x, self.c_y, self.c_z)]
        largest = jnp.maximum(jnp.maximum(sizes[0], sizes[1]), sizes[2])
        safe = jnp.where(largest > 0, largest, 1.0)
        # 1 − bracket/max|c| as a sum of squares loses no digit where the lobe is sharp; the bracket itself, none at 0.
        bracket, missing = 0.0, 0.0
        for c, size, a, b in zip((self.c_x, self.c_y, self.c_z), sizes, wi, wo, strict=True):
            apart = jnp.where(c < 0, a + b, a - b)
            bracket = bracket + c * (a * b)
            missing = missing + 0.5 * ((safe - size) * (a * a + b * b) + size * apart * apart) / safe
        inside = bracket > 0
        sharp = missing < 0.25  # not further: XLA's log1p is off by 3e-14 from −0.41 to −0.3
        log_near = jnp.log1p(-jnp.where(sharp, missing, 0.0))
        log_far = jnp.log(least_positive(jnp.where(sharp, 1.0, bracket / safe)))
        exponent = self.n * jnp.where(sharp, log_near, log_far)
        if self.norm == "ngan":
            return jnp.where(inside, (self.n + 2.0) / (2 * jnp.pi) * jnp.exp(exponent), 0.0)
        most = jnp.log(jnp.finfo(exponent.dtype).max) - 30.0
        return jnp.where(inside, jnp.exp(jnp.minimum(exponent + self.n * jnp.log(safe), most)), 0.0)

    def _mirrored_axis(self, wi: Direction) -> Direction:
        # The lobe's axis (c_x wi.x, c_y wi.y, c_z wi.z), mirrored: a Phong lobe of light from there has this axis.
        c_x, c_y, c_z = (jnp.mean(c) for c in (self.c_x, self.c_y, self.c_z))
        return normalize(Direction(-c_x * wi.x, -c_y * wi.y, c_z * wi.z))

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        """Phong's lobe about (c_x wi.x, c_y wi.y, c_z wi.z)."""
        return Phong(self.n).sample(self._mirrored_axis(wi), u1, u2)

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return Phong(self.n).pdf(self._mirrored_axis(wi), wo)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return Phong(self.n).lobe_map(self._mirrored_axis(wi), u1, u2)

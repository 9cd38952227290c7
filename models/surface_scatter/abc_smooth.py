"""The ABC lobe of smooth surfaces, after their scattering in direction cosines."""

from typing import ClassVar

import jax.numpy as jnp

from gonio.models.brdf import Channels, Direction, ParameterInfo, Scalar, parameter
from gonio.models.fresnel import fresnel_of
from gonio.models.microfacet.base import ETA, F0, K
from gonio.models.surface_scatter.shift_invariant import AbstractDiscLobe
from gonio.models.warps.direction_cosines import projected_distance2

B = ParameterInfo(0.0, 1e7, "1", "inverse square of the core's width", start=1e3, role="inverse_width", log=True)
C = ParameterInfo(
    0.01, 10.0, "1", "exponent of the fall, half of the power of the tail", start=1.0, role="exponent", log=True
)


class ABCSmooth(AbstractDiscLobe):
    """f = F (1 + b|β−β₀|²)^(−c): the ABC lobe in direction cosines, F(θd) [Löw et al. 2012, eq. 10-14].

    β−β₀ = (wi.x + wo.x, wi.y + wo.y), and F at cosθd = √(1 − ¼|(wi.x − wo.x, wi.y − wo.y)|²), both in projection; the
    paper's factor A is the term's scale. F by `f0` (Schlick), `eta` (and `k`), or 1.
    """

    lobe = True
    violates: ClassVar = {"energy": "Its height is free (the paper's A is the scale): at 1, it reflects π for b = 0."}

    b: Channels = parameter(B)
    c: Channels = parameter(C)
    f0: Channels | None = parameter(F0, default=None)
    eta: Channels | None = parameter(ETA, default=None)
    k: Channels | None = parameter(K, default=None)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        lobe = jnp.exp(-self.c * jnp.log1p(self.b * projected_distance2(wi, wo)))
        return fresnel_of(self, _projected_cos_d(wi, wo)) * lobe

    def core(self, wi: Direction) -> tuple[Channels, Channels]:
        return 1.0 / jnp.sqrt(jnp.maximum(self.b, 1e-2)), self.c


def _projected_cos_d(wi: Direction, wo: Direction) -> Scalar:
    # 1 − ¼|difference|² as a sum of squares, so that nothing cancels at grazing.
    cos2 = 0.5 * (wi.z * wi.z + wo.z * wo.z) + 0.25 * projected_distance2(wi, wo)
    some = cos2 > 0
    return jnp.minimum(jnp.where(some, jnp.sqrt(jnp.where(some, cos2, 1.0)), 0.0), 1.0)

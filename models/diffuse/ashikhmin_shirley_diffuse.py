"""The diffuse term that goes with a glossy one and leaves it its share."""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Scalar, parameter
from gonio.models.warps.hemisphere import polar_map

DIFFUSE = ParameterInfo(
    0.0, 1.0, "1", "reflectance of the diffuser below", start=0.5, role="albedo", per_channel=True, linear=True
)
SPECULAR = ParameterInfo(
    0.0, 1.0, "1", "normal reflectance of the gloss above", start=0.04, role="fresnel", per_channel=True
)


class AshikhminShirleyDiffuse(AbstractBRDF):
    """f = 28 rd/(23π) (1−rs)(1−(1−μi/2)⁵)(1−(1−μo/2)⁵): a diffuser below a gloss [Ashikhmin & Shirley 2000, eq. 5].

    Reciprocal; its albedo is rd (1 − rs)(1 − (1 − μ/2)⁵), 31/32 of rd (1 − rs) at the normal and 0 at grazing,
    where the gloss takes all.
    """

    rd: Channels = parameter(DIFFUSE)
    rs: Channels = parameter(SPECULAR)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return 28.0 / (23.0 * jnp.pi) * self.rd * (1.0 - self.rs) * (_entering(wi.z) * _entering(wo.z))

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return polar_map(u1, u2)


def _entering(mu: Scalar) -> Scalar:
    # 1 − (1 − x)⁵ with x = μ/2, multiplied out so that grazing keeps its digits.
    x = 0.5 * mu
    return x * (5.0 - x * (10.0 - x * (10.0 - x * (5.0 - x))))

"""Half spaces of isotropic scatterers: scattered once, and scattered to the end."""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Scalar, parameter
from gonio.models.volume_scatter.chandrasekhar_h import h_isotropic
from gonio.models.warps.hemisphere import volume_map

SCATTERED = "single-scattering albedo"
SINGLE = ParameterInfo(0.0, 1.0, "1", SCATTERED, start=0.8, role="albedo", per_channel=True, linear=True)
MULTIPLE = ParameterInfo(0.0, 1.0, "1", SCATTERED, start=0.8, role="albedo", per_channel=True)


class LommelSeeliger(AbstractBRDF):
    """f = w/(4π (μi + μo)): light scattered once in a dark half space, the lunar law [Seeliger 1887].

    Its albedo is (w/2)(1 − μ ln(1 + 1/μ)).
    """

    loses_energy = (
        "what scatters more than once is left out: with w = 1 it reflects 0.153 at normal incidence, 0.5 at grazing"
    )

    w: Channels = parameter(SINGLE)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return self.w / (4 * jnp.pi * (wi.z + wo.z))

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return volume_map(wi, u1, u2)


class Chandrasekhar(AbstractBRDF):
    """f = w H(μi) H(μo)/(4π (μi + μo)): a half space of isotropic scatterers [Chandrasekhar 1960, ch. V].

    All orders of scattering, with the exact H function: its albedo is 1 − √(1 − w) H(μ), hence 1 for w = 1.
    """

    w: Channels = parameter(MULTIPLE)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        h_i, h_o = h_isotropic(wi.z, self.w), h_isotropic(wo.z, self.w)
        return self.w * (h_i * h_o) / (4 * jnp.pi * (wi.z + wo.z))

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return volume_map(wi, u1, u2)

"""Scatter of polished surfaces, as codes for stray light describe it."""

from typing import ClassVar

import jax.numpy as jnp

from gonio.models.brdf import Channels, Direction, ParameterInfo, parameter
from gonio.models.surface_scatter.shift_invariant import AbstractDiscLobe
from gonio.models.warps.direction_cosines import projected_distance2

B0 = ParameterInfo(
    0.0, 1e8, "1/sr", "BRDF in the mirror direction", start=1.0, role="scale", per_channel=True, linear=True
)
L = ParameterInfo(1e-5, 2.0, "1", "shoulder of the lobe, in direction cosines", start=0.01, role="shoulder", log=True)
S = ParameterInfo(-10.0, 0.0, "1", "slope of the tail in a plot of logarithms", start=-1.5, role="exponent")
A = ParameterInfo(
    0.0,
    1e6,
    "1/sr",
    "BRDF one direction cosine off the mirror",
    start=0.01,
    role="scale",
    per_channel=True,
    linear=True,
)
B = ParameterInfo(
    1e-12, 1e3, "1", "what levels the lobe off at the mirror direction", start=1e-3, role="shoulder", log=True
)
G = ParameterInfo(0.0, 10.0, "1", "power of the tail", start=1.5, role="exponent")


class HarveyShack(AbstractDiscLobe):
    """f = b0 (1 + (|β−β₀|/l)²)^(s/2): the shift-invariant scatter of polished optics [Harvey 1976].

    β−β₀ = (wi.x + wo.x, wi.y + wo.y): the same function of direction cosines at every incidence.
    """

    violates: ClassVar = {"energy": "Its height is free: it reflects up to π b0, which is so at s = 0."}

    b0: Channels = parameter(B0)
    l: Channels = parameter(L)  # noqa: E741
    s: Channels = parameter(S)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        shape = jnp.exp(0.5 * self.s * jnp.log1p(projected_distance2(wi, wo) / self.l**2))
        return self.b0 * shape

    def core(self, wi: Direction) -> tuple[Channels, Channels]:
        return self.l, -0.5 * self.s


class ABg(AbstractDiscLobe):
    """f = a/(b + |β−β₀|^g): scatter as stray-light codes tabulate it [Harvey 1976, as in ASAP and Zemax].

    β−β₀ = (wi.x + wo.x, wi.y + wo.y). Where g < 1 it has a cusp in the mirror direction.
    """

    violates: ClassVar = {"energy": "Its height is free: it reflects up to π a/b, which is so where b is large."}

    a: Channels = parameter(A)
    b: Channels = parameter(B)
    g: Channels = parameter(G)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        rho2 = projected_distance2(wi, wo)
        # Nearer than this, far below rounding, is at the mirror: a cusp's slope there would overflow.
        away = rho2 > float(jnp.finfo(rho2.dtype).tiny) ** 0.5
        power = jnp.exp(0.5 * self.g * jnp.log(jnp.where(away, rho2, 1.0)))
        power = jnp.where(away, power, jnp.where(self.g > 0, 0.0, 1.0))
        return self.a / (self.b + power)

    def core(self, wi: Direction) -> tuple[Channels, Channels]:
        # b^(1/g), within what a double can square.
        exponent = jnp.log(self.b) / jnp.maximum(self.g, 1e-2)
        return jnp.exp(jnp.clip(exponent, -18.0, 2.0)), 0.5 * self.g

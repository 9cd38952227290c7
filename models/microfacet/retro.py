"""Microfacets that send light back where it came from."""

import equinox as eqx

from gonio.models.brdf import AbstractBRDF, Channels, Direction, Sample, Scalar, parameter
from gonio.models.microfacet import base as mf
from gonio.models.microfacet.ggx import GGX


class Retro(AbstractBRDF):
    """f(wi, wo) = f_GGX(mirror of wi, wo): the microfacet lobe about the back vector [Belcour et al. 2014, §4].

    The half vector is taken between `wo` and the mirror image of `wi` in the normal, so the lobe points back to the
    light, with GGX's slopes, masking and energy; F is at that half vector. `smith` as in `ggx`.
    """

    lobe = True

    alpha: Channels | None = parameter(mf.ALPHA, default=None)
    alpha_x: Channels | None = parameter(mf.ALPHA_X, default=None)
    alpha_y: Channels | None = parameter(mf.ALPHA_Y, default=None)
    f0: Channels | None = parameter(mf.F0, default=None)
    eta: Channels | None = parameter(mf.ETA, default=None)
    k: Channels | None = parameter(mf.K, default=None)
    smith: str = eqx.field(static=True, default="correlated", metadata={"choices": ("correlated", "separable")})

    @property
    def surface(self) -> GGX:
        """The facets that would mirror light from the mirror image of `wi` in the normal."""
        return GGX(**vars(self))

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return self.surface.formula(mirrored(wi), wo)

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        return self.surface.sample(mirrored(wi), u1, u2)

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return self.surface.pdf(mirrored(wi), wo)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return self.surface.lobe_map(mirrored(wi), u1, u2)


def mirrored(w: Direction) -> Direction:
    """The mirror image of a direction in the normal."""
    return Direction(-w.x, -w.y, w.z)

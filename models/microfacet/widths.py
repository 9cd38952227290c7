"""The widths of slope distributions that may differ along x and y."""

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.brdf import AbstractBRDF


class AbstractWidths(AbstractBRDF):
    """A lobe of facets whose final class has the field `alpha`, or `alpha_x` and `alpha_y`."""

    @property
    def widths(self) -> tuple[Scalar, Scalar]:
        """(alpha_x, alpha_y); twice alpha where the surface is isotropic."""
        return (self.alpha, self.alpha) if self.alpha_x is None else (self.alpha_x, self.alpha_y)

    @property
    def mean_widths(self) -> tuple[Scalar, Scalar]:
        """The widths by which directions are drawn: their mean where channels differ, as geometry has no channels."""
        return tuple(jnp.mean(w) for w in self.widths)

    @property
    def facet_widths(self) -> tuple[Scalar, Scalar] | None:
        return self.mean_widths

"""The widths of slope distributions that may differ along x and y."""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Scalar


def along_axes(brdf: AbstractBRDF, name: str) -> tuple[Channels, Channels]:
    """The values of a parameter along x and y, such as alpha_x and alpha_y; twice alpha if isotropic."""
    x, y = getattr(brdf, f"{name}_x", None), getattr(brdf, f"{name}_y", None)
    return (getattr(brdf, name),) * 2 if x is None or y is None else (x, y)


class AbstractWidths(AbstractBRDF):
    """A lobe of facets whose final class has the field `alpha`, or `alpha_x` and `alpha_y` beside it."""

    @property
    def widths(self) -> tuple[Scalar, Scalar]:
        """(alpha_x, alpha_y); twice alpha where the surface is isotropic."""
        return along_axes(self, "alpha")

    @property
    def mean_widths(self) -> tuple[Scalar, Scalar]:
        """The widths by which directions are drawn: their mean where channels differ, as geometry has no channels."""
        alpha_x, alpha_y = self.widths
        return jnp.mean(alpha_x), jnp.mean(alpha_y)

    @property
    def facet_widths(self) -> tuple[Scalar, Scalar] | None:
        return self.mean_widths

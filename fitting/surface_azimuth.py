"""What a fit says where its table does not tell how an anisotropic sample lay."""

import numpy as np

from gonio.data.layouts.base import SAME
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF

NO_AZIMUTH = (
    "the table has no azimuth of the half vector, as that of an isotropic surface: what the model says of x and y "
    "(as alpha_x, alpha_y) is of no directions on the sample; fit an isotropic model, or give readings with azimuths"
)
FROM_THE_LIGHT = (
    "the light's azimuth is 0 (or 180°) in all readings, or they are counted from it: x and y of the model (as of "
    "alpha_x, alpha_y) are along the plane of incidence and across it, and how the sample lay there is not known"
)


def azimuth_notes(table: Table, brdf: AbstractBRDF) -> list[str]:
    """A note where directions on the sample matter to the model and the table has none; none of isotropic models."""
    if brdf.isotropic or table.interpolant is not None:
        return []
    layout = table.layout
    if layout.in_half_vectors:
        return [] if layout.has_azimuth_of_light else [NO_AZIMUTH]
    if layout.gridded and "phi_i" not in layout.axes:
        return [FROM_THE_LIGHT]
    if not layout.gridded or layout.one_light_azimuth:
        tilted = np.sin(layout.axes["theta_i"]) > SAME if not layout.gridded else slice(None)
        across = np.abs(np.sin(layout.axes["phi_i"][tilted])) > SAME
        return [] if across.any() else [FROM_THE_LIGHT]
    return []

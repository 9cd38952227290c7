"""The layouts by the names that files have for them: the one list of all."""

from collections.abc import Mapping

from gonio.data.layouts.base import Angles, Layout
from gonio.data.layouts.half_difference_grid import HalfDifferenceGrid
from gonio.data.layouts.in_plane_grid import InPlaneGrid
from gonio.data.layouts.isotropic_grid import IsotropicGrid
from gonio.data.layouts.scattered_samples import ScatteredSamples
from gonio.data.layouts.spherical_grid import SphericalGrid
from gonio.models.errors import GonioError

LAYOUTS: dict[str, type[Layout]] = {
    kind.name: kind for kind in (SphericalGrid, IsotropicGrid, HalfDifferenceGrid, InPlaneGrid, ScatteredSamples)
}


def layout_of(name: str, axes: Mapping[str, Angles]) -> Layout:
    """The layout of a name and its axes, radians. Raises GonioError for an unknown name, or axes that do not fit."""
    if name not in LAYOUTS:
        raise GonioError(f"layout {name!r} is unknown; expected one of {', '.join(LAYOUTS)}")
    return LAYOUTS[name](axes)

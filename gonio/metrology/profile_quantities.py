"""What a profile says of the light below a surface: by its readings alone, and by a fit of it."""

import os
from collections.abc import Sequence

import numpy as np

from gonio.checks.profile_light import ProfileLight, by_distance, light_of_profile
from gonio.data.material import Material
from gonio.data.profile import Profile
from gonio.data.subject import load_material
from gonio.fitting.result import FitResult
from gonio.fitting.subsurface.profile_fit import fit_profile
from gonio.fitting.subsurface.result import ProfileFit
from gonio.metrology.fit_numbers import FitNumbers
from gonio.metrology.quantity import Quantity
from gonio.metrology.standards.evaluation import Undecided
from gonio.metrology.subsurface_quantities import (
    GROUP,
    SHARES,
    TOTAL,
    QuantityRow,
    SpotRadii,
    by_channel,
    subsurface_quantities,
)
from gonio.models.errors import GonioError
from gonio.models.special.scipy_functions import ndtri

LEVEL = 0.01
"""Chance of counting noise as light."""
BY_READINGS = "by the readings"
GEOMETRY = "∫∫ of π times the radiance over the flux, both along the normal"


def profile_quantities(profile: Profile) -> tuple[list[Quantity], list[Undecided]]:
    """By the readings alone: the light that leaves, and the radii within which half and nine tenths of it do."""
    side, names = by_distance(profile), profile.channels.names
    factor = float(-ndtri(LEVEL / 2 / len(names)))
    channels = [light_of_profile(side, c, factor) for c in range(len(names))]
    known = [light for light in channels if light is not None]
    if len(known) < len(channels):
        why = "of a channel fewer than three distances have readings above their noise"
        return [], [Undecided(name, BY_READINGS, GROUP, why) for name in (TOTAL, *map(_radius_name, SHARES))]
    zero = np.zeros(len(names))
    total, bound = (np.array([getattr(light, name) for light in known]) for name in ("total", "bound"))
    rows = by_channel(QuantityRow(TOTAL, BY_READINGS, "1", GEOMETRY, total, bound), names, zero)
    undecided = []
    for share in SHARES:
        ends = np.array([_radii(light, share) for light in known])
        if np.isfinite(ends).all():
            middle, half = ends.mean(axis=1), np.ptp(ends, axis=1) / 2
            what = "from the centre of the lit spot, by what the viewed spot reads"
            rows += by_channel(QuantityRow(_radius_name(share), BY_READINGS, "mm", what, middle, half), names, zero)
        else:
            why = "the light is not known well enough that far from and near to the beam; read further out and in"
            undecided.append(Undecided(_radius_name(share), BY_READINGS, GROUP, why))
    return rows, undecided


def _radius_name(share: float) -> str:
    return f"radius of {100 * share:g} %"


def _radii(light: ProfileLight, share: float) -> tuple[float, float]:
    """The least and the largest radius that may hold this share; NaN where that is beyond the readings."""
    low, high = share * (light.total - light.bound), share * (light.total + light.bound)
    least, most = light.within - light.bound, light.within + light.bound
    if not (most[0] <= low and least[-1] >= high):
        return np.nan, np.nan
    return float(np.interp(low, most, light.r)), float(np.interp(high, least, light.r))


def fit_of_profile(profile: Profile, given: FitResult | ProfileFit | Material | str | os.PathLike[str]) -> Material:
    """The material of a fit of a profile: of a fit's result or file; or of an expression, or "auto", fitted here.

    Raises GonioError for a material that is no fit, and for one of another number of channels.
    """
    if isinstance(given, str) and not (os.path.isfile(given) or given.endswith(".toml")):
        return fit_profile(profile, None if given == "auto" else given).material
    material = load_material(given)
    if "fit" not in material.meta:
        raise GonioError(f"{material.name} is not a fitted material; give one that 'gonio fit' wrote, or a model")
    if len(material.channels) != len(profile.channels):
        raise GonioError(
            f"the fit has {len(material.channels)} channels and the profile {len(profile.channels)}; give the fit of "
            "that profile"
        )
    return material


def quantities_of_fits(profile: Profile, fits: Sequence[Material]) -> list[Quantity]:
    """Coefficients, lengths, totals and the edge loss at the profile's own spots, by each of its fits."""
    spots = SpotRadii(profile.illuminated_radius, profile.viewed_radius)
    rows: list[Quantity] = []
    for material in fits:
        rows += subsurface_quantities(material, FitNumbers.of(material), spots)
    return rows

"""What a translucent material does with light below its surface, from its coefficients: lengths, totals, edge loss."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gonio.data.material import Material
from gonio.metrology.fit_numbers import FitNumbers
from gonio.metrology.quantity import Quantity
from gonio.models.brdf import AbstractBRDF
from gonio.models.subsurface.base import AbstractBSSRDF
from gonio.models.subsurface.evaluation import BLOCK, evaluated, totals
from gonio.models.subsurface.spots import kept_share
from gonio.models.subsurface.wide_spots import WideSpots

GROUP = "subsurface"
TOTAL, BY_MODEL = "total reflectance", "by the model"
SHARES = (0.5, 0.9)
"""Of the light that leaves: quantities are the radii within which it does."""
REACH = 1e-5, 1e5
"""Radii that are searched, in reduced mean free paths."""


class SpotRadii(NamedTuple):
    """Radii, mm, of the illuminated and the viewed spot of an instrument."""

    illuminated: float
    viewed: float


class QuantityRow(NamedTuple):
    """A quantity by channel: values and bounds (channels,)."""

    name: str
    place: str
    unit: str
    geometry: str
    value: np.ndarray
    bound: np.ndarray


def subsurface_quantities(
    material: Material, numbers: FitNumbers | None = None, spots: SpotRadii | None = None
) -> list[Quantity]:
    """Coefficients, lengths and totals of a material whose light below the surface is known; none of any other.

    Args:
        material: of any kind.
        numbers: of the fit whose covariance spreads them.
        spots: the instrument whose edge loss is wanted too.
    """
    if not isinstance(material.brdf, WideSpots):
        return []
    names = material.channels.names
    rows = _rows(material.brdf, len(names), spots)

    def values(brdf: AbstractBRDF) -> np.ndarray:
        return np.array([row.value for row in _rows(brdf, len(names), spots)])

    u = np.zeros((len(rows), len(names)))
    if numbers is not None:
        with np.errstate(invalid="ignore"):
            u = numbers.spread(numbers.slopes(values))
    made: list[Quantity] = []
    for row, spread in zip(rows, u, strict=True):
        made += by_channel(row, names, spread)
    return made


def by_channel(row: QuantityRow, channels: Sequence[str], u: np.ndarray) -> list[Quantity]:
    """Quantities of this group, one a channel, with standard uncertainties u (channels,) beside their bounds."""
    one = Quantity(row.name, row.place, "", 0.0, 0.0, unit=row.unit, geometry=row.geometry, group=GROUP)
    columns = zip(channels, row.value, row.bound, u, strict=True)
    return [dataclasses.replace(one, channel=c, value=float(v), bound=float(b), u=float(s)) for c, v, b, s in columns]


def _rows(brdf: AbstractBRDF, count: int, spots: SpotRadii | None) -> list[QuantityRow]:
    assert isinstance(brdf, WideSpots)
    b = brdf.bssrdf
    absorption, scattering, extinction = (
        np.broadcast_to(np.asarray(v, float).reshape(-1), count) for v in (b.absorption, b.scattering, b.extinction)
    )
    with np.errstate(divide="ignore"):
        length = 1 / np.sqrt(3 * absorption * extinction)
    exact, total = np.zeros(count), np.broadcast_to(totals(b), count)
    rows = [
        QuantityRow("absorption coefficient σa", "", "1/mm", "", absorption, exact),
        QuantityRow("reduced scattering coefficient σs′", "", "1/mm", "σs (1 − g)", scattering, exact),
        QuantityRow("reduced albedo α′", "", "1", "σs′/(σa + σs′)", scattering / extinction, exact),
        QuantityRow("transport mean free path", "", "mm", "1/(σa + σs′)", 1 / extinction, exact),
        QuantityRow("diffusion length", "", "mm", "1/√(3 σa (σa + σs′))", length, exact),
        QuantityRow("∫∫R dA", "", "1", "what leaves, of what passed the surface", total, exact),
        QuantityRow(
            TOTAL,
            BY_MODEL,
            "1",
            "∫∫R dA Ft(0°)²: π times the radiance over the flux, both along the normal",
            total * np.asarray(b.transmittance(np.ones(()))).reshape(-1) ** 2,
            exact,
        ),
    ]
    for share, radii in zip(SHARES, _radii(b, count), strict=True):
        what = f"of a narrow beam {100 * share:g} % of what leaves does within it"
        rows.append(QuantityRow(f"radius of {100 * share:g} %", "", "mm", what, radii, exact))
    if spots is not None and max(spots) > 0:
        kept = kept_share(b, *spots)
        place = f"lit {spots.illuminated:g} mm, viewed {spots.viewed:g} mm"
        lost, bound = (np.broadcast_to(v, count) for v in (1 - kept.value, kept.bound))
        rows.append(QuantityRow("edge loss", place, "1", "of a BRDF that spots of these radii read", lost, bound))
    return rows


def _radii(b: AbstractBSSRDF, count: int) -> list[np.ndarray]:
    """Radii (channels,) within which each of `SHARES` of the light leaves."""
    size = 1 / np.asarray(b.extinction, float)
    grid = np.geomspace(REACH[0] * size.min(), REACH[1] * size.max(), BLOCK)
    within, total = evaluated(b, "cumulative", grid), totals(b)
    every = []
    for share in SHARES:
        radii = []
        for c in range(within.shape[1]):
            k = int(np.searchsorted(within[:, c], share * total[c]))
            fine = np.geomspace(grid[max(k - 1, 0)], grid[min(k, BLOCK - 1)], BLOCK)
            light = evaluated(b, "cumulative", fine)[:, c]
            radii.append(float(np.interp(share * total[c], light, fine)) if total[c] > 0 else np.nan)
        every.append(np.broadcast_to(np.array(radii), count))
    return every

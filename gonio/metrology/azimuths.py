"""Albedos of many azimuths of the light in few rows, for people to read."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from gonio.metrology.quantity import Quantity

FEW = 3
"""Azimuths that are listed one by one."""
ALIKE = 1e-6
"""Relative difference of values that are printed as one."""


def fewer_azimuths(quantities: Sequence[Quantity]) -> list[Quantity]:
    """The quantities with one row an incidence where all azimuths of the light give the same, else the least and most.

    What was read at a few azimuths stays as it is. Least and most are by the mean over channels, so that a row holds
    one azimuth. The order stays.
    """
    turned: dict[tuple[str, float], dict[float, list[Quantity]]] = {}
    for q in quantities:
        if "phi_i" in q.angles:
            turned.setdefault((q.name, q.angles["theta_i"]), {}).setdefault(q.angles["phi_i"], []).append(q)
    places = {}
    for (_, theta), by_azimuth in turned.items():
        if len(by_azimuth) > FEW:
            places |= _places(theta, by_azimuth)
    kept = ((q, places.get(id(q), q.place)) for q in quantities)
    return [q if place == q.place else dataclasses.replace(q, place=place) for q, place in kept if place is not None]


def _places(theta: float, by_azimuth: dict[float, list[Quantity]]) -> dict[int, str | None]:
    """What stands for the place of each quantity (by its id) at one incidence, None for what is left out."""
    places: dict[int, str | None] = {id(q): None for of in by_azimuth.values() for q in of}
    azimuths, count = list(by_azimuth), len(by_azimuth)
    values = [np.array([(q.value, q.uncertainty) for q in of]) for of in by_azimuth.values()]
    alike = all(v.shape == values[0].shape and np.allclose(v, values[0], rtol=ALIKE, atol=0) for v in values)
    if alike:
        named = {azimuths[0]: f"θi {theta:.4g}°, {count} φi alike"}
    else:
        means = [float(np.mean(v[:, 0])) for v in values]
        ends = {azimuths[int(np.argmin(means))]: "least", azimuths[int(np.argmax(means))]: "most"}
        named = {p: f"θi {theta:.4g}°, φi {p:.4g}° ({word} of {count})" for p, word in ends.items()}
    for azimuth, place in named.items():
        places |= {id(q): place for q in by_azimuth[azimuth]}
    return places

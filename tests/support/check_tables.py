"""Tables of models on every kind of layout, for tests of checks."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gonio.checks import certify
from gonio.checks.certificate import Property
from gonio.checks.properties import PROPERTIES
from gonio.data import layouts
from gonio.data.layouts import Layout
from gonio.data.subject import SubjectLike
from gonio.data.table import Table, whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.expression.builder import build


def degrees(*start_stop_step: float) -> np.ndarray:
    """`np.arange` in degrees, as radians."""
    return np.radians(np.arange(*start_stop_step))


def scattered_both_ways(pairs: int = 2000) -> Layout:
    """Random pairs of directions up to 84°, each with its exchanged pair."""
    rng = np.random.default_rng(0)
    theta, phi = np.arccos(1 - 0.9 * rng.random((2, pairs))), 2 * np.pi * rng.random((2, pairs))
    return layouts.scattered(*(np.r_[a[0], a[1]] for a in (theta, phi)), *(np.r_[a[1], a[0]] for a in (theta, phi)))


SQUARE = layouts.isotropic(degrees(0, 86, 10), degrees(0, 86, 10), degrees(0, 360, 30))
LAYOUTS = {
    "isotropic": SQUARE,
    "half of the azimuths": layouts.isotropic(degrees(0, 86, 10), degrees(0, 86, 10), degrees(0, 181, 30)),
    "spherical": layouts.spherical(degrees(0, 86, 15), degrees(0, 360, 60), degrees(0, 86, 15), degrees(0, 360, 30)),
    "one light azimuth": layouts.spherical(degrees(0, 86, 10), [0.5], degrees(0, 86, 10), degrees(0, 360, 30) + 0.5),
    "half/difference": layouts.half_difference(degrees(0, 90, 6), degrees(0, 90, 6), degrees(0, 360, 30)),
    "in plane": layouts.in_plane(degrees(0, 81, 5), degrees(-80, 81, 5)),
    "scattered": scattered_both_ways(),
}


def outgoing_grid(step: float, shift: float = 0.0) -> Layout:
    """Five incidences, and detector directions by steps of so many degrees, shifted in theta by a share of a step."""
    return layouts.isotropic(degrees(0, 81, 20), degrees(shift * step, 89.9, step), degrees(0, 360, step))


def property_of(name: str, subject: SubjectLike, **options: Any) -> Property:
    """What a check says of one property, which alone is judged: the others would take most of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(certify, "PROPERTIES", {name: PROPERTIES[name]})
        return certify.check(subject, **options)[name]


def model_table(
    expression: str,
    layout: Layout = SQUARE,
    change: Callable[..., np.ndarray] | None = None,
    noise: float = 0.0,
    stated: float | None = None,
) -> Table:
    """A table of a model.

    Args:
        change: makes the readings of f, (cells, channels), and the four angles, each (cells, 1).
        noise: relative noise of the readings.
        stated: relative uncertainty that is stored; None: unknown.
    """
    f = grid_values(build(expression), layout).reshape(layout.size, -1)
    if change is not None:
        f = change(f, *(angle[:, None] for angle in layout.angles()))
    u = None if stated is None else (stated * np.abs(f)).reshape(*layout.shape, -1)
    f = f * (1 + noise * np.random.default_rng(0).standard_normal(f.shape))
    return whole_table_of_values(layout, f.reshape(*layout.shape, -1), u_f=u)

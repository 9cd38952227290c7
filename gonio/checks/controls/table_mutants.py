"""Honest tables with one mistake each, as instruments and converters come to make them."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gonio.checks.controls.model_mutants import TRUTH
from gonio.data.layouts import Layout, isotropic
from gonio.data.table import Table, whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.brdf import AbstractBRDF
from gonio.models.expression.builder import build

NOISE = 0.01
"""Relative standard uncertainty of the readings, which the tables state."""


class TableMutant(NamedTuple):
    """A mistake, the table that has it, and the property that fails."""

    mistake: str
    table: Table
    gives_away: str


def grid() -> Layout:
    """An isotropic grid by 5° that resolves the lobe of `material`."""
    polar = np.radians(np.arange(0, 86, 5.0))
    return isotropic(polar, polar, np.radians(np.arange(0, 360, 5.0)))


def material() -> AbstractBRDF:
    """What the tables were measured of: it reflects three quarters."""
    return build("0.5 * ggx(alpha=0.4) + lambert(rho=0.3)")


def honest_table() -> Table:
    """The table without a mistake."""
    return _table(lambda f, *_: f)


def _table(change: Callable) -> Table:
    layout = grid()
    f = grid_values(material(), layout)[..., 0]
    angles = [a.reshape(layout.shape) for a in layout.angles()]
    f = change(f, angles[0], angles[2], angles[3])
    u = NOISE * np.abs(f)[..., None]
    noise = np.random.default_rng(7).standard_normal(f.shape)
    return whole_table_of_values(layout, f * (1 + NOISE * noise), u_f=u)


def _clipped(f, *_):
    return np.minimum(f, 0.2)


def _rescaled(f, *_):
    # Each incidence by a factor of its own, as if its albedo were to be one half: the relative readings lose their tie.
    return f / f.max(axis=(1, 2), keepdims=True)


def table_mutants() -> list[TableMutant]:
    """Each mistake once."""
    mistakes = [
        ("f cosθo kept for f", lambda f, ti, to, p: f * np.cos(to), "reciprocity"),
        ("polar angles of the detector off by a step", lambda f, *_: np.roll(f, 1, axis=1), "reciprocity"),
        ("axes in another order (Fortran's for C's)",
         lambda f, *_: f.ravel().reshape(f.shape[::-1]).transpose(), "reciprocity"),
        ("each incidence rescaled by its own peak", _rescaled, "reciprocity"),
        ("the source fading during the scan", lambda f, ti, to, p: f * (1 - 0.6 * ti / np.pi * 2), "reciprocity"),
        ("readings scaled by two", lambda f, *_: 2 * f, "energy"),
        ("azimuths off by two steps", lambda f, *_: np.roll(f, 2, axis=2), "symmetry"),
        ("a dark level subtracted that was not there", lambda f, *_: f - 1.2 * f.min(), "positivity"),
        ("a saturated lobe", _clipped, TRUTH),
        ("azimuth differences counted from the mirror direction", lambda f, *_: np.roll(f, 36, axis=2), TRUTH),
        ("readings scaled by one half", lambda f, *_: f / 2, TRUTH),
    ]  # fmt: skip
    return [TableMutant(mistake, _table(change), law) for mistake, change, law in mistakes]

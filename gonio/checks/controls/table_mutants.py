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

Mistake = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Readings made of f, theta_i and theta_o, all of the grid's shape."""


class TableMutant(NamedTuple):
    """A mistake, the table that has it, the property that fails, and the material that was meant."""

    mistake: str
    table: Table
    gives_away: str
    meant: AbstractBRDF
    undecided: tuple[str, ...] = ()
    """Properties that an honest table of this kind leaves open."""


def grid() -> Layout:
    """An isotropic grid by 5°, and 10° in azimuth, that resolves the lobe of `material`."""
    polar = np.radians(np.arange(0, 86, 5.0))
    return isotropic(polar, polar, np.radians(np.arange(0, 360, 10.0)))


def material() -> AbstractBRDF:
    """The material of the tables of reflection: it reflects three quarters."""
    return build("0.5 * ggx(alpha=0.4) + lambert(rho=0.3)")


def honest_tables() -> list[TableMutant]:
    """The tables without a mistake: of reflection, and those that transmit."""
    from gonio.checks.controls.transmitting_tables import honest_sides

    return [TableMutant("the table that was meant", _table(lambda f, *_: f), "", material()), *honest_sides()]


def _table(mistake: Mistake) -> Table:
    layout = grid()
    theta_i, _, theta_o, _ = (a.reshape(layout.shape) for a in layout.angles())
    f = mistake(grid_values(material(), layout)[..., 0], theta_i, theta_o)
    noise = np.random.default_rng(7).standard_normal(f.shape)
    return whole_table_of_values(layout, f * (1 + NOISE * noise), u_f=NOISE * np.abs(f)[..., None])


MISTAKES: dict[str, tuple[str, Mistake]] = {
    "f cosθo kept for f": ("reciprocity", lambda f, ti, to: f * np.cos(to)),
    "polar angles of the detector off by a step": ("reciprocity", lambda f, *_: np.roll(f, 1, axis=1)),
    "axes in another order (Fortran's for C's)":
        ("reciprocity", lambda f, *_: f.ravel().reshape(f.shape[::-1]).transpose()),
    # As if the albedo of each incidence were to be one half: the relative readings lose their tie.
    "each incidence rescaled by its own peak": ("reciprocity", lambda f, *_: f / f.max(axis=(1, 2), keepdims=True)),
    "the source fading during the scan": ("reciprocity", lambda f, ti, to: f * (1 - 0.6 * ti / np.pi * 2)),
    "readings scaled by two": ("energy", lambda f, *_: 2 * f),
    "azimuths off by two steps": ("symmetry", lambda f, *_: np.roll(f, 2, axis=2)),
    "a dark level subtracted that was not there": ("positivity", lambda f, *_: f - 1.2 * f.min()),
    "a saturated lobe": (TRUTH, lambda f, *_: np.minimum(f, 0.2)),
    "azimuth differences counted from the mirror direction": (TRUTH, lambda f, *_: np.roll(f, 18, axis=2)),
    "readings scaled by one half": (TRUTH, lambda f, *_: f / 2),
}  # fmt: skip
"""Each mistake once: the property that fails, and the readings that it makes."""


def table_mutants() -> list[TableMutant]:
    """A table of each mistake: of reflection, and of those that transmit."""
    from gonio.checks.controls.transmitting_tables import transmitting_mutants

    meant = material()
    of_reflection = [TableMutant(m, _table(change), law, meant) for m, (law, change) in MISTAKES.items()]
    return of_reflection + transmitting_mutants()

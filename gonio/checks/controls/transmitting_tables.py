"""Tables of both sides of a sample, honest or with one mistake each, as instruments and converters make them."""

import functools
from collections.abc import Callable

import numpy as np

from gonio.checks.controls.model_mutants import TRUTH
from gonio.checks.controls.table_mutants import NOISE, TableMutant
from gonio.data.layouts import Layout, isotropic
from gonio.data.table import MEDIA, Table, whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.brdf import AbstractBRDF
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction

Mistake = Callable[[np.ndarray, Direction, Direction], np.ndarray]
"""Readings made of f and of the directions to light and detector, all of shape (cells,)."""

GLASS = "0.6 * rough_dielectric(alpha=0.5, eta=1.5)"
"""Between air and dyed glass. By 5° its energy stays open: light from behind near grazing goes on through few nodes."""
SHEET = "thin_sheet(rho=0.3, tau=0.1) + 0.4 * transmitted(base=ggx(alpha=0.5))"
"""In air, with a lobe about what goes straight through."""
MEDIA_OF = {GLASS: [1.0, 1.5], SHEET: [1.0, 1.0]}


def _grid() -> Layout:
    """Light and detector on both sides, by 5°."""
    polar = np.radians(np.arange(0, 86, 5.0))
    both = np.concatenate([polar, (np.pi - polar)[::-1]])
    return isotropic(both, both, np.radians(np.arange(0, 360, 10.0)))


@functools.cache
def _meant(material: str) -> tuple[AbstractBRDF, Layout, np.ndarray]:
    """The model, its grid, and f at its cells."""
    model, layout = build(material), _grid()
    return model, layout, grid_values(model, layout)[..., 0].ravel()


def _table(material: str, mistake: Mistake) -> Table:
    _, layout, f = _meant(material)
    f = mistake(f, *layout.directions()).reshape(layout.shape)
    noise = np.random.default_rng(11).standard_normal(f.shape)
    table = whole_table_of_values(layout, f * (1 + NOISE * noise), u_f=NOISE * np.abs(f)[..., None])
    table.provenance[MEDIA] = MEDIA_OF[material]
    return table


def _through(factor: Callable[[Direction, Direction], np.ndarray]) -> Mistake:
    """Readings through the sample times a factor."""
    return lambda f, wi, wo: np.where(wi.z * wo.z < 0, factor(wi, wo), 1.0) * f


def _shifted(f: np.ndarray, wi: Direction, wo: Direction, material: str, axis: int, nodes: int) -> np.ndarray:
    """Readings through the sample that stand so many nodes of an axis off."""
    layout = _meant(material)[1]
    return np.where(wi.z * wo.z < 0, np.roll(f.reshape(layout.shape), nodes, axis).ravel(), f)


MISTAKES: dict[str, tuple[str, str, Mistake]] = {
    "η² at the exit lost": (GLASS, "reciprocity", _through(lambda wi, wo: np.where(wo.z < 0, 1.5**-2, 1.0))),
    "η² at the exit counted twice": (GLASS, "reciprocity", _through(lambda wi, wo: np.where(wo.z < 0, 1.5**2, 1.0))),
    "h of refraction not turned to the front": (GLASS, "reciprocity", _through(lambda wi, wo: (wi.z > 0) * 1.0)),
    "the sign of wi·h: dark beyond 45° from behind": (
        GLASS, "reciprocity", _through(lambda wi, wo: ~((wi.z < 0) & (wi.z > -0.7)) * 1.0)),
    "f_t cosθo kept for f_t": (GLASS, "reciprocity", _through(lambda wi, wo: np.abs(wo.z))),
    "f_t cosθo kept for f_t of a sheet": (SHEET, "reciprocity", _through(lambda wi, wo: np.abs(wo.z))),
    "f_t divided by cosθo once more": (SHEET, "reciprocity", _through(lambda wi, wo: 1 / np.abs(wo.z))),
    "unlike sides of a sheet": (SHEET, "reciprocity", _through(lambda wi, wo: np.where(wi.z < 0, 1.3, 1.0))),
    "a sheet that reflects and transmits more than it receives": (
        SHEET, "energy", lambda f, wi, wo: 1.5 * f),
    "transmittance scaled by two": (SHEET, "energy", _through(lambda wi, wo: np.array(2.0))),
    "azimuths behind the sample off by two steps": (
        SHEET, "symmetry", lambda f, wi, wo: _shifted(f, wi, wo, SHEET, 2, 2)),
    "a dark level subtracted behind the sample that was not there": (
        SHEET, "positivity", lambda f, wi, wo: np.where(wi.z * wo.z < 0, f - 1.2 * f.min(), f)),
    "azimuths behind the sample counted from the other side": (
        SHEET, TRUTH, lambda f, wi, wo: _shifted(f, wi, wo, SHEET, 2, 18)),
    "readings behind the sample scaled by one half": (SHEET, TRUTH, _through(lambda wi, wo: np.array(0.5))),
}  # fmt: skip
"""Each mistake once: the material, the property that fails, and the readings that it makes."""


def honest_sides() -> list[TableMutant]:
    """An interface and a sheet without a mistake."""
    named = (("the interface that was meant", GLASS, ("energy",)), ("the sheet that was meant", SHEET, ()))
    return [TableMutant(n, _table(m, lambda f, *_: f), "", _meant(m)[0], undecided) for n, m, undecided in named]


def transmitting_mutants() -> list[TableMutant]:
    """A table of each mistake."""
    return [
        TableMutant(mistake, _table(material, change), law, _meant(material)[0])
        for mistake, (material, law, change) in MISTAKES.items()
    ]

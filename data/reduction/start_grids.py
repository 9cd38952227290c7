"""Grids from which a table is thinned: its own, less its symmetries, and one in half/difference angles."""

import dataclasses

import numpy as np

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.layouts.base import Layout
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import NORMAL, Direction, rotate_z

HALF_DIFFERENCE = (45, 30, 24)  # nodes of theta_h, theta_d, phi_d where a table is laid out anew
MAX_TURNS = 8  # azimuths of the light over which an anisotropic table is averaged
ISOTROPY, BILATERAL, RECIPROCITY = "isotropy", "bilateral symmetry", "reciprocity"

Nodes = tuple[np.ndarray, ...]
"""Numbers of the kept nodes of each axis, increasing."""


@dataclasses.dataclass(frozen=True)
class StartGrid:
    """A grid to thin: values (*shape, C), validity of the same shape, and the simplifications that led to it."""

    layout: Layout
    f: np.ndarray
    valid: np.ndarray
    simplified_by: tuple[str, ...] = ()

    @property
    def nodes(self) -> Nodes:
        """All nodes of each axis."""
        return tuple(np.arange(n) for n in self.layout.shape)

    def grey(self) -> "StartGrid":
        """The mean over the channels, valid where all of them are."""
        f = np.mean(np.where(self.valid, self.f, 0.0), axis=-1, keepdims=True)
        return dataclasses.replace(self, f=f, valid=self.valid.all(-1, keepdims=True))


def start_grids(table: Table, truth: AbstractBRDF) -> list[StartGrid]:
    """The grids that a table, with the interpolant `truth`, can be thinned from.

    No symmetry is tested beforehand: one that the surface breaks costs its error in the scene.
    """
    grids = []
    layout = table.layout if table.layout.gridded and table.interpolant is None else None
    if layout is not None:
        f = np.asarray(table.f[...], float)
        grids.append(StartGrid(layout, f, (np.asarray(table.flag[...]) == Flag.VALID) & np.isfinite(f)))
    turning = layout is None or layout.has_azimuth_of_light
    isotropy = (ISOTROPY,) if turning else ()
    outgoing = None if layout is None else layout.outgoing_grid()
    if outgoing is not None:
        azimuth = outgoing.azimuth
        if turning:
            grid = layouts.isotropic(outgoing.theta_i, outgoing.theta_o, azimuth)
            grids.append(_averaged(truth, grid, isotropy, outgoing.phi_i))
        if azimuth[-1] > np.pi * (1 + 1e-9):
            half = np.unique(np.round(np.append(azimuth[azimuth <= np.pi], np.pi), 12))
            grid = layouts.isotropic(outgoing.theta_i, outgoing.theta_o, np.minimum(half, np.pi))
            grids.append(_averaged(truth, grid, (*isotropy, BILATERAL), outgoing.phi_i))
    if turning or outgoing is not None:
        turns = np.linspace(0, 2 * np.pi, MAX_TURNS, endpoint=False) if turning else np.zeros(1)
        simplified_by = (*isotropy, BILATERAL, "half/difference angles", RECIPROCITY)
        grids.append(_averaged(truth, layouts.merl("lower", HALF_DIFFERENCE), simplified_by, turns))
    elif layout is not None and layout.in_half_vectors and not layout.reciprocal_by_construction:
        phi_d = layout.axes["phi_d"]
        grid = layouts.half_difference(layout.axes["theta_h"], layout.axes["theta_d"], phi_d[phi_d < np.pi - 1e-9])
        grids.append(_averaged(truth, grid, (RECIPROCITY,), np.zeros(1)))
    return grids


def _averaged(truth: AbstractBRDF, layout: Layout, simplified_by: tuple[str, ...], turns: np.ndarray) -> StartGrid:
    """A grid of the mean of a table over azimuths of the light and what the simplifications take for equal."""
    above = layout.above_horizon()
    wi, wo = (
        Direction(*(np.where(above, c, up) for c, up in zip(w, NORMAL, strict=True))) for w in layout.directions()
    )
    total, number = np.zeros(()), 0
    for phi in turns[:: max(1, -(-len(turns) // MAX_TURNS))]:
        for side in (1, -1) if BILATERAL in simplified_by else (1,):
            a, b = (rotate_z(Direction(w.x, side * w.y, w.z), np.cos(phi), np.sin(phi)) for w in (wi, wo))
            for pair in ((a, b), (b, a)) if RECIPROCITY in simplified_by else ((a, b),):
                total, number = total + evaluate_in_blocks(truth, *pair), number + 1
    f = (total / number).reshape(*layout.shape, -1)
    return StartGrid(layout, f, np.broadcast_to(above.reshape(*layout.shape, 1), f.shape), simplified_by)

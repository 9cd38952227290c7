"""The layouts of the scans that `gonio.stability.problems` names, and tables of its problems."""

import functools

import numpy as np

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.layouts import Layout
from gonio.data.table import Channels, Table, whole_table_of_values
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.stability.problems import BRUSHED, COARSE, COARSEST, GRID, MERL, NARROW, PLANE, SMALL, RecoveryProblem


def _degrees(*axes: tuple[float, float, float]) -> list[np.ndarray]:
    return [np.radians(np.arange(*axis)) for axis in axes]


@functools.cache
def layout_of(scan: str) -> Layout:
    """The layout of a scan by its name."""
    return {
        MERL: lambda: layouts.merl(counts=(60, 30, 36)),
        GRID: lambda: layouts.isotropic(*_degrees((0, 86, 5), (0, 86, 5), (0, 360, 20))),
        COARSE: lambda: layouts.isotropic(*_degrees((0, 81, 10), (0, 81, 10), (0, 360, 30))),
        COARSEST: lambda: layouts.isotropic(*_degrees((0, 76, 15), (0, 76, 15), (0, 360, 30))),
        SMALL: lambda: layouts.isotropic(*_degrees((0, 36, 5), (0, 36, 5), (0, 360, 30))),
        NARROW: lambda: layouts.isotropic(*_degrees((0, 21, 5), (0, 21, 5), (0, 360, 15))),
        PLANE: lambda: layouts.in_plane(*_degrees((0, 61, 15), (-80, 81, 5))),
        BRUSHED: lambda: layouts.spherical(*_degrees((10, 71, 20), (0, 360, 30), (10, 71, 10), (0, 360, 30))),
    }[scan]()


def table_of_problem(problem: RecoveryProblem, seed: int) -> Table:
    """The readings of a problem, noise and outliers drawn by the seed."""
    rng, layout = np.random.default_rng(seed), layout_of(problem.scan)
    f = np.asarray(evaluate(build(problem.measured), *layout.directions()), float).reshape(*layout.shape, -1)
    usual = np.median(np.abs(f[np.isfinite(f)]))
    relative = problem.noise * np.maximum(np.abs(f), 1e-3 * usual)
    sigma = -problem.noise * np.ones_like(f) if problem.noise < 0 else relative
    y = f + sigma * rng.standard_normal(f.shape)
    y = np.where(rng.random(f.shape) < problem.spikes, 100 * y, y)
    u = sigma if problem.known and problem.noise else None
    table = whole_table_of_values(layout, y, Channels.of_count(f.shape[-1]), u_f=u, name=problem.name)
    table.provenance.update({} if problem.noise else {"instrument": "ideal"})
    if problem.missing:
        gone = (rng.random(f.shape) < problem.missing) & (table.flag == Flag.VALID)
        table.flag[gone], table.f[gone] = Flag.NOT_MEASURED, np.nan
    return table

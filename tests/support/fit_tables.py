"""Tables of spelled models on small grids, for tests of fits."""

import dataclasses

import numpy as np

from gonio.data import layouts
from gonio.data.table import whole_table_of_values
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

THETA = np.radians(np.arange(0, 86, 5.0))
ISOTROPIC = layouts.isotropic(THETA, THETA, np.radians(np.arange(0, 360, 20.0)))
COARSE_THETA = np.radians(np.arange(0, 81, 8.0))
COARSE_ISOTROPIC = layouts.isotropic(COARSE_THETA, COARSE_THETA, np.radians(np.arange(0, 360, 30.0)))
COARSE_SPHERICAL = layouts.spherical(
    COARSE_THETA[::2], np.radians([0, 45, 90.0]), COARSE_THETA, np.radians(np.arange(0, 360, 30.0))
)
ONE_LOBE = "lambert(rho=[.1,.2,.4]) + [.9,.7,.8]*ggx(alpha=.25, f0=0.04)"


def table_of(expression, layout=ISOTROPIC, noise=0.0, seed=1, **fields):
    f = np.asarray(evaluate(build(expression), *layout.directions())).reshape(*layout.shape, -1)
    f = f * (1 + noise * np.random.default_rng(seed).standard_normal(f.shape))
    ideal = {} if noise else {"instrument": "ideal"}
    table = whole_table_of_values(layout, f, **fields)
    return dataclasses.replace(table, provenance={**ideal, **table.provenance})


def coarse_table_of(expression, layout=COARSE_ISOTROPIC, noise=0.02, seed=1):
    return table_of(expression, layout, noise, seed)


def free(result):
    return {p.label: p for p in result.parameters if p.status != "fixed"}


def values(result):
    return np.array([p.value for p in free(result).values()])

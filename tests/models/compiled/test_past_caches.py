"""Values that go past the caches: to the bit those that go through them, wherever the lines of memory begin."""

import jax
import numpy as np
import pytest

from gonio.models.compiled import program
from gonio.models.compiled.dispatch import Formula, values
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction

MODELS = {"three channels": "lambert(rho=[0.8, 0.5, 0.1])", "one": "lambert(rho=0.3) + minnaert(rho=0.2, k=0.4)"}


def _of_pairs(model, *c):
    return model.f(Direction(*c[:3]), Direction(*c[3:]))


PAIRS = Formula(_of_pairs, ((0,),) * 6)
GRID = Formula(_of_pairs, (*((0,),) * 3, *((0, 1),) * 3))


def directions(rng, shape, dtype):
    z, phi = 0.05 + 0.9 * rng.random(shape), 2 * np.pi * rng.random(shape)
    s = np.sqrt(1 - z**2)
    return [c.astype(dtype) for c in (s * np.cos(phi), s * np.sin(phi), z)]


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_values_past_the_caches_have_the_same_bits(name, dtype, monkeypatch):
    rng, model = np.random.default_rng(1), build(MODELS[name])
    cases = [(PAIRS, (n,), directions(rng, n, dtype) + directions(rng, n, dtype)) for n in (17, 64, 1001, 50_003)]
    cases += [(GRID, (m, n), directions(rng, m, dtype) + directions(rng, (m, n), dtype)) for m, n in ((3, 64), (9, 77))]
    every_other = directions(rng, 2002, dtype) + directions(rng, 2002, dtype)
    cases.append((PAIRS, (1001,), [c[::2] for c in every_other]))
    with jax.enable_x64(dtype is np.float64):
        model = jax.tree.map(lambda a: a.astype(dtype), model)
        for formula, sizes, arrays in cases:
            made = []
            for limit in (1 << 60, 0):
                monkeypatch.setattr(program, "PAST_CACHES", limit)
                made.append(values(formula, model, arrays, sizes, dtype))
            assert made[0] is not None and made[0].dtype == dtype
            assert made[0].tobytes() == made[1].tobytes()

"""Loops known by the name of their formula give what was traced would give, and are made again where it has changed."""

import os

import numpy as np
import pytest

from gonio.models.albedo import FLUX
from gonio.models.compiled import dispatch, program
from gonio.models.compiled.directed import PAIRS
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.machine import machine
from gonio.models.evaluation import channel_count
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import from_spherical

pytestmark = pytest.mark.skipif(machine() is None, reason="this processor has no compiled loops")
GOLD = "0.5 * lambert(rho=[0.2, 0.3, 0.4]) + phong(n=20)"
"""With numbers that are computed before the loop, and channels."""
WI, WO = (from_spherical(np.linspace(0.1, 1.2, 9), phi, np) for phi in (0.0, 2.9))


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("GONIO_PROGRAMS_DIR", str(tmp_path))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    monkeypatch.delenv("GONIO_NO_CACHE", raising=False)
    return tmp_path


@pytest.fixture
def traces(monkeypatch):
    """A process that remembers nothing, and how often it traces."""
    made, translated = [], program.translated
    monkeypatch.setattr(program, "translated", lambda *a, **k: made.append(1) or translated(*a, **k))

    def new_process():
        made.clear()
        monkeypatch.setattr(dispatch, "_programs", {})
        monkeypatch.setattr(dispatch, "_models", {})
        return made

    return new_process


def f_of(expression):
    return dispatch.values(PAIRS, build(expression), [*WI, *WO], (9,), np.dtype(float))


def test_another_process_traces_nothing_and_gives_the_same_bits(traces):
    made = traces()
    first = f_of(GOLD)
    assert len(made) == 1
    made = traces()
    np.testing.assert_array_equal(f_of(GOLD), first)
    assert not made


def test_other_numbers_take_up_the_loop_and_other_kinds_do_not(traces):
    traces()
    f_of(GOLD)
    made = traces()
    changed = f_of(GOLD.replace("20", "7").replace("0.5", "0.25"))
    assert not made
    with pytest.MonkeyPatch.context() as without:
        without.setenv("GONIO_NO_CACHE", "1")
        traces()
        np.testing.assert_array_equal(changed, f_of(GOLD.replace("20", "7").replace("0.5", "0.25")))
    made = traces()
    assert f_of("0.5 * lambert(rho=0.2) + phong(n=20)").shape == (9,)
    assert len(made) == 1


@pytest.mark.parametrize("cut", [0, 40, 200])
def test_a_damaged_loop_is_made_again(traces, folder, cut):
    traces()
    first = f_of(GOLD)
    for file in folder.iterdir():
        file.write_bytes(file.read_bytes()[:cut])
    made = traces()
    np.testing.assert_array_equal(f_of(GOLD), first)
    assert len(made) == 1


def test_that_a_formula_has_no_loop_is_kept_too(traces, monkeypatch):
    def unsupported(*_, **__):
        raise Unsupported("nothing")

    traces()
    monkeypatch.setattr(program, "translated", unsupported)
    assert f_of(GOLD) is None
    traces()
    monkeypatch.setattr(program, "translated", lambda *_, **__: pytest.fail("traced again"))
    assert f_of(GOLD) is None


def test_another_formula_of_the_same_model_has_a_name_of_its_own():
    model = build("phong(n=20)")
    leaves, tree = dispatch.jax.tree.flatten(model)
    names = {dispatch._name(formula, tree, leaves, dtype) for formula in (PAIRS, FLUX) for dtype in (np.float32, float)}
    assert len(names) == 4 and "" not in names


def test_channels_are_counted_once(folder):
    for _ in range(2):
        assert channel_count(build("lambert(rho=[0.2, 0.3])")) == 2
        assert channel_count(build("lambert(rho=0.2)")) is None
    assert len(os.listdir(folder)) == 2

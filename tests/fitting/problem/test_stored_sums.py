"""Fits of large tables, whose readings stay in them: the same as of readings in memory, in little memory."""

import dataclasses
import pickle
import tracemalloc

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.hdf5.reader import open_table
from gonio.data.table import Channels, whole_table_of_values
from gonio.fitting.fit_table import fit
from gonio.fitting.problem.parameterisation import parameters
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import (
    Readings,
    loss_floor,
    readings_of,
    residual_weights,
    sigma_of,
    stored_readings,
)
from gonio.fitting.result import FitResult
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.expression.parser import parse, with_defaults
from support.marks import thorough

MODEL = "lambert + ggx(f0=0.04)"
RTOL = 1e-9  # of the numbers: an end is stationary to 1e-9 of their standard uncertainties


def table_of(seed: int, known: str = "all"):
    """Random readings of paint on a grid with holes, of which all, some or no uncertainties are known."""
    rng = np.random.default_rng(seed)
    theta, phi = np.radians(np.linspace(0, 84, 9)), np.linspace(0, 2 * np.pi, 12, endpoint=False)
    grid = layouts.isotropic(theta, theta, phi)
    f = np.asarray(evaluate(build("lambert(rho=[.1,.3]) + [.9,.7]*ggx(alpha=.25, f0=0.04)"), *grid.directions()))
    f = f.reshape(*grid.shape, 2)
    u_f = 0.02 * f * rng.uniform(0.5, 2, f.shape)
    f = f + u_f * rng.standard_normal(f.shape)
    u_f = np.where((known == "all") | (rng.random(f.shape) < 0.7), u_f, np.nan)
    table = whole_table_of_values(grid, f, Channels(("a", "b")), u_f=None if known == "none" else u_f)
    table.flag[rng.random(f.shape) < 0.1] = Flag.SATURATED
    table.flag[2, 3:5] = Flag.NOT_MEASURED  # whole cells
    return table


@pytest.fixture
def large(monkeypatch):
    """Every table is a large one, of several blocks, of which some are kept."""
    for name, size in {"readings.STORED": 1, "readings.FEWEST_STORED": 8, "table_rows.BLOCK": 500}.items():
        monkeypatch.setattr(f"gonio.fitting.problem.{name}", size)
    monkeypatch.setattr("gonio.fitting.problem.stored_sums.KEPT", 50_000)


def numbers(r: FitResult) -> np.ndarray:
    """What a fit tells in numbers: parameters, uncertainties, tests, metrics."""
    rows = [[p.value, p.standard_uncertainty, *p.interval95] for p in r.parameters]
    tests = r.residuals
    assert tests is not None
    return np.array([*np.ravel(rows), *r.metrics.values(), r.bic, r.cost, tests.scale, tests.standing_out])


@pytest.mark.parametrize(
    ("known", "options"),
    [
        ("some", {}),
        ("none", {"theta_max": np.radians(70)}),
        *thorough(
            ("all", {}),
            ("some", {"loss": "log", "weight": "solid-angle"}),
            ("all", {"loss": "log1p", "per_channel": True}),
            ("all", {"robust": "tukey"}),
        ),
    ],
)
def test_a_large_table_is_fitted_as_a_small_one(request, known, options):
    table = table_of(3, known)
    whole = fit(table, MODEL, starts=1, **options)
    request.getfixturevalue("large")
    pieces = fit(table, MODEL, starts=1, **options)
    assert (pieces.samples, pieces.cells, pieces.counts) == (whole.samples, whole.cells, whole.counts)
    assert pieces.converged == whole.converged and pieces.floor == pytest.approx(whole.floor, rel=1e-15)
    np.testing.assert_allclose(numbers(pieces), numbers(whole), rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(*([p.value for p in r.parameters] for r in (pieces, whole)), rtol=RTOL)


def test_readings_that_repeat_others_count_once_in_large_tables_too(request):
    table = table_of(4)
    mirrored = -np.arange(12) % 12
    for values in (table.f, table.u_f, table.flag):
        values[:, :, 7:] = values[:, :, mirrored[7:]]
    whole = fit(table, MODEL, starts=1)
    request.getfixturevalue("large")
    pieces = fit(table, MODEL, starts=1)
    assert pieces.counts == whole.counts and whole.counts["copies"] > 500
    np.testing.assert_allclose(numbers(pieces), numbers(whole), rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("known", ["all", "some", "none"])
def test_readings_that_stay_in_a_file_are_those_of_the_table(tmp_path, large, known):
    table = table_of(5, known)
    table.save(tmp_path / "t.h5")
    limit = np.radians(80)
    whole, stored = readings_of(table, theta_max=limit), stored_readings(open_table(tmp_path / "t.h5", 0), limit)
    assert stored is not None
    few, n = np.array([7, 3, 250, 3, 8]), whole.f.shape[0]
    for rows in (few, slice(90, 480), slice(None), np.arange(n) % 5 == 0):
        same(stored.part(rows), whole.part(rows))
        assert np.array_equal(stored.cos_i[rows], whole.cos_i[rows])
    same(stored.of_channels(np.array([1])).part(few), whole.of_channels(np.array([1])).part(few))
    same(stored.in_memory, whole)
    same(pickle.loads(pickle.dumps(stored)), whole)
    for name in ("count", "sides", "complete", "negative"):
        assert getattr(stored, name) == getattr(whole, name)
    assert np.array_equal(stored.counts, whole.counts)
    assert stored.brightness(1, 1) == pytest.approx(whole.brightness(1, 1))
    for loss in ("sigma", "cbrt", "log", "log1p") if known != "none" else ("cbrt", "log1p"):
        weights = [residual_weights(r, loss, sigma_of(r)) for r in (stored, whole)]
        assert np.array_equal(np.asarray(weights[0]), np.asarray(weights[1]))
        assert loss_floor(stored, loss) == loss_floor(whole, loss)


def same(a: Readings, b: Readings) -> None:
    """Whether readings are the same to the bit, where there are any."""
    pairs = zip((*a.wi, *a.wo, a.f, a.valid), (*b.wi, *b.wo, b.f, b.valid), strict=True)
    assert all(np.array_equal(x, y) for x, y in pairs)
    np.testing.assert_array_equal(np.asarray(a.u_f), np.asarray(b.u_f))


def test_a_model_is_selected_alike(request):
    table = dataclasses.replace(table_of(1), u_f=None)
    whole = fit(table, starts=1)
    request.getfixturevalue("large")
    assert fit(table, starts=1).requested == whole.requested


def test_a_fit_takes_less_memory_than_its_readings_would(monkeypatch):
    """What is kept, and what is looked at at a time, has a size of its own."""
    fit(table_of(3), MODEL, starts=0)  # what is compiled takes memory once
    monkeypatch.setattr("gonio.fitting.problem.stored_sums.KEPT", 1 << 20)
    monkeypatch.setattr("gonio.fitting.problem.table_rows.BLOCK", 1 << 16)
    monkeypatch.setattr("gonio.fitting.problem.readings.STORED", 1 << 16)
    theta, rng = np.radians(np.linspace(0, 85, 56)), np.random.default_rng(0)
    grid = layouts.isotropic(theta, theta, np.linspace(0, 2 * np.pi, 192, endpoint=False))
    f = np.asarray(evaluate(build("lambert(rho=[.1,.3]) + ggx(alpha=.25, f0=0.04)"), *grid.directions()))
    f = (f * (1 + 0.02 * rng.standard_normal(f.shape))).reshape(*grid.shape, 2)
    table = whole_table_of_values(grid, f, u_f=0.02 * f)
    tracemalloc.start()
    assert fit(table, MODEL, starts=0).residuals is not None
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.6 * 80 * grid.size  # of directions, f and weights


def test_xla_sums_pieces_too(monkeypatch, large):
    """What the processor's own loops do not take."""
    monkeypatch.setenv("GONIO_EVALUATE_WITH", "xla")
    table, stored = table_of(2), stored_readings(table_of(2))
    assert stored is not None
    s, fixed, _ = parameters(with_defaults(parse("lambert(rho=?)")), 2)
    parts = [readings_of(table), stored]
    problems = [FitProblem.create(s, fixed, "log1p", r, residual_weights(r, "log1p", None), 1.0) for r in parts]
    whole, pieces = (problem.evaluate(np.array([0.2, 0.5])) for problem in problems)
    sums = ((*e.equations[:2], *e.equations.matrix, *(e.scores or ())) for e in (whole, pieces))
    for a, b in zip(*sums, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)
    np.testing.assert_allclose(pieces.f[30:90], whole.f[30:90], rtol=1e-14)

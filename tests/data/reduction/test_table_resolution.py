"""How well a table resolves a scene: bounds that hold against the surface itself, and no promise below them."""

import dataclasses
import math

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.interpolation.multilinear import as_material
from gonio.data.reduction import coarsest_table
from gonio.data.reduction.coarsest_table import reduce_table
from gonio.data.reduction.table_resolution import known_truth, measured_error, resolution
from gonio.data.reduction.thin_grid import SceneValues
from gonio.data.scene import Range, Scene
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.expression.builder import build
from support.fit_tables import table_of
from support.marks import thorough

ROUND = (0.0, 2 * np.pi)
LAMP = Scene("lamp", 0.05, (Range((0.5, 0.9), ROUND, 1.0),), (Range((0.0, 1.2), ROUND, 1.0),))
PAINT = "lambert(rho=.3) + .5*ggx(alpha=.4, f0=.1)"
SHARP = "lambert(rho=.1) + ggx(alpha=.03, f0=.3)"


def grid(step, last=80.0):
    theta = np.radians(np.arange(0, last + 0.1, step))
    return layouts.isotropic(theta, theta, np.radians(np.arange(0, 360, 2 * step)))


def seen(table, scene=LAMP, count=6000):
    pairs = scene.pairs(count)
    return SceneValues(pairs, evaluate_in_blocks(as_material(table), pairs.wi, pairs.wo))


def true_error(table, expression, scene=LAMP):
    """Against the surface, on directions that the estimate does not use."""
    values = seen(table, scene, 31_000)
    return values.pairs.error(values.f, evaluate_in_blocks(build(expression), values.pairs.wi, values.pairs.wo))


@pytest.mark.parametrize("step", [8.0, *thorough(4.0, 16.0)])
@pytest.mark.parametrize("expression", [PAINT, SHARP, "oren_nayar(rho=.5, sigma=.6)", "lambert(rho=.2)"])
def test_the_bound_holds_and_is_no_idle_one(expression, step):
    table = table_of(expression, grid(step))
    bound, true = resolution(table, seen(table)).error, true_error(table, expression)
    assert true <= bound + 1e-6  # single precision
    assert bound <= max(20 * true, 1e-6) or true > 0.05


def test_a_finer_grid_resolves_more():
    bounds = [resolution(t, seen(t)).error for t in (table_of(PAINT, grid(s)) for s in (16.0, 8.0, 4.0))]
    assert bounds[0] > 2 * bounds[1] > 4 * bounds[2] > 0


def test_noise_counts_as_what_it_makes():
    table = table_of("lambert(rho=.3)", grid(8.0), noise=0.1)
    told = dataclasses.replace(table, u_f=0.1 * np.nan_to_num(np.abs(table.f)))
    true = true_error(table, "lambert(rho=.3)")
    for t in (table, told):
        assert true <= resolution(t, seen(t)).error <= 4 * true
    assert "noise" in resolution(told, seen(told)).reason


def test_what_was_not_read_is_not_resolved():
    low = Scene("low", 0.05, (Range((1.1, 1.4), ROUND, 1.0),), LAMP.views)
    found = resolution(t := table_of(PAINT, grid(4.0, 52.0)), seen(t, low))
    assert found.error == math.inf and "nothing was read" in found.reason
    theta = np.radians([0, 5, 10, 15, 40, 45, 50, 55, 60, 65, 70, 75, 80])
    hole = table_of("lambert(rho=.3)", layouts.isotropic(theta, theta, grid(8.0).axes["delta_phi"]))
    assert "5 times as wide" in resolution(hole, seen(hole)).reason
    one = layouts.isotropic([0.7], grid(4.0).axes["theta_o"], grid(4.0).axes["delta_phi"])
    flat = table_of("lambert(rho=.3)", one)
    assert resolution(flat, seen(flat)).error == math.inf


def test_stretched_steps_have_a_bound_that_holds_and_lists_have_none():
    rng = np.random.default_rng(3)
    theta = np.radians(80 * np.linspace(0, 1, 14) ** 1.4)
    expression = "lambert(rho=.3) + .5*ggx(alpha=.6, f0=.1)"
    stretched = table_of(expression, layouts.isotropic(theta, theta, np.radians(np.arange(0, 360, 15.0))))
    assert true_error(stretched, expression) <= resolution(stretched, seen(stretched)).error < math.inf
    polar, azimuth = np.arccos(rng.uniform(0.15, 1, (2, 1500))), rng.uniform(0, 2 * np.pi, 1500)
    scattered = table_of(expression, layouts.scattered(polar[0], np.zeros(1500), polar[1], azimuth))
    found = resolution(scattered, seen(scattered))
    assert found.error == math.inf and "between them" in found.reason


def test_the_truth_that_the_provenance_names_is_measured_against():
    table = table_of(PAINT, grid(8.0))
    values = seen(table)
    assert known_truth(table, values.pairs) is None
    table.provenance["material"] = {"name": "paint", "spelling": PAINT}
    truth = known_truth(table, values.pairs)
    np.testing.assert_allclose(truth, evaluate_in_blocks(build(PAINT), values.pairs.wi, values.pairs.wo))
    error = values.pairs.error(values.f, truth)
    assert error <= measured_error(values.pairs, values.f, truth) <= 1.5 * error
    for spelling in (None, 3, "no(such=1)", "lambert(rho=[.1,.2,.3])"):
        table.provenance["material"]["spelling"] = spelling
        assert known_truth(table, values.pairs) is None


@pytest.mark.parametrize("named", [False, *thorough(True)])
def test_nothing_is_promised_that_the_whole_table_does_not_keep(monkeypatch, named):
    monkeypatch.setattr(coarsest_table, "SEARCH", 2500)
    monkeypatch.setattr(coarsest_table, "CHECK", 9000)
    monkeypatch.setattr(coarsest_table, "HALF_DIFFERENCE", (18, 12, 8))
    for expression, keeps in ((PAINT, True), (SHARP, False)):
        provenance = {"material": {"name": "it", "spelling": expression}} if named else {}
        reduced = reduce_table(table_of(expression, grid(8.0), provenance=provenance), LAMP)
        true = true_error(reduced.table, expression)
        assert true <= reduced.promised and reduced.error <= LAMP.tolerance
        assert reduced.keeps == keeps == (reduced.exit_status == 0)
        assert ("not promised" in reduced.promise()) == (not keeps) and reduced.promise() == reduced.facts()["promised"]

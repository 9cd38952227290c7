"""How verdicts change, or stay, as f is scaled, the sample turned, channels permuted, wi and wo exchanged."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from gonio.checks.certify import check
from gonio.checks.model.energy import model_energy
from gonio.checks.model.evidence import ModelEvidence
from gonio.checks.model.isotropy import model_symmetry
from gonio.checks.model.reciprocity import model_reciprocity
from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.table import Table
from gonio.models.expression.builder import build
from support.check_tables import SQUARE, degrees, model_table, scattered_both_ways

RGB = "lambert(rho=[0.2, 0.3, 0.4]) + [0.1, 0.2, 0.1] * ggx(alpha=0.4)"
EVEN = layouts.spherical(degrees(0, 76, 15), degrees(0, 360, 45), degrees(0, 76, 15), degrees(0, 360, 45))
FULL = {"isotropic": SQUARE, "spherical": EVEN, "scattered": scattered_both_ways(300)}
NOISE = 0.05


def slanted(f, theta_i, phi_i, theta_o, phi_o):
    """Neither reciprocal nor symmetric, and below 0 at some angles."""
    turn = np.mod(phi_o - phi_i, 2 * np.pi)
    return f * (1 + 0.3 * np.cos(theta_i) + 0.2 * np.sin(turn)) - 0.9 * f * (theta_o > 1.2) * (turn > 5)


def slanted_table(layout, stated=NOISE, noise=NOISE):
    return model_table(RGB, layout, slanted, noise, stated)


def changed(table: Table, change: Callable[[np.ndarray], np.ndarray], **fields) -> Table:
    """The table with its readings, flags and uncertainties rearranged alike."""
    arrays = {name: getattr(table, name) for name in ("f", "flag", "u_f")}
    return dataclasses.replace(table, **{k: None if v is None else change(v) for k, v in arrays.items()}, **fields)


def numbers(p):
    return [np.nan if v is None else v for v in (p.residual, p.bound)]


def assert_same(before, after, names=("reciprocity", "energy", "positivity", "symmetry", "isotropy", "pole")):
    for name in names:
        a, b = before[name], after[name]
        assert a.verdict == b.verdict, name
        assert numbers(a) == pytest.approx(numbers(b), rel=1e-9, abs=1e-12, nan_ok=True), name


@pytest.mark.parametrize("stated", [None, NOISE], ids=["unknown noise", "stated noise"])
@pytest.mark.parametrize("layout", FULL.values(), ids=FULL)
def test_twice_the_f_is_twice_the_albedo_and_the_same_relative_differences(layout, stated):
    table, factor = slanted_table(layout, stated), 2.0
    twice = dataclasses.replace(table, f=factor * table.f, u_f=None if stated is None else factor * table.u_f)
    before, after = (check(t, feature_width=0.6) for t in (table, twice))
    assert_same(before, after, ("reciprocity", "positivity", "symmetry", "isotropy", "pole", "horizon"))
    largest = [c["energy"].facts.get("largest_albedo") for c in (before, after)]
    if largest[0] is not None:
        assert largest[1] == pytest.approx(factor * largest[0], rel=1e-12)


@pytest.mark.parametrize("layout", FULL.values(), ids=FULL)
def test_channels_in_another_order_have_the_same_verdicts_and_keep_their_names(layout):
    table, order = slanted_table(layout), [2, 0, 1]
    names = Channels(tuple(table.channels.names[k] for k in order))
    permuted = changed(table, lambda a: a[..., order], channels=names)
    before, after = (check(t, feature_width=0.6) for t in (table, permuted))
    assert_same(before, after)
    for p in before.properties:
        assert p.where.get("channel") == after[p.name].where.get("channel")


def test_scattered_readings_in_another_order_have_the_same_verdicts():
    table = slanted_table(FULL["scattered"])
    order = np.random.default_rng(0).permutation(table.layout.size)
    layout = layouts.scattered(*(a[order] for a in table.layout.axes.values()))
    assert_same(check(table), check(changed(table, lambda a: a[order], layout=layout)))


@pytest.mark.parametrize("steps", [1, 3])
def test_a_turned_sample_has_the_same_verdicts(steps):
    table = slanted_table(EVEN, noise=0.0)  # noise would pair other readings at another plane
    assert_same(check(table), check(changed(table, lambda a: np.roll(a, (steps, steps), (1, 3)))))


def test_light_and_detector_exchanged_are_as_reciprocal_as_before():
    table = slanted_table(EVEN, stated=None)  # counts are alike at an incidence, so that their tails are not exchanged
    before, after = (check(t) for t in (table, changed(table, lambda a: np.moveaxis(a, (0, 1), (2, 3)))))
    assert_same(before, after, ("reciprocity", "positivity"))


def test_models_scale_as_tables_do():
    one, two = (ModelEvidence(build(f"{factor} * ggx(alpha=0.3)")) for factor in (1, 2))
    for law in (model_reciprocity, model_symmetry):
        assert law(one, 1e-9).verdict == law(two, 1e-9).verdict == "pass"
    assert 1 + model_energy(two, 1e-6).residual == pytest.approx(2 * (1 + model_energy(one, 1e-6).residual), rel=1e-6)

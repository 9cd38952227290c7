"""Reciprocity, symmetry, isotropy and the pole of tables on every layout."""

import dataclasses

import numpy as np
import pytest

import gonio
from gonio.checks.table.equal_readings import table_isotropy, table_pole, table_reciprocity, table_symmetry
from gonio.checks.table.evidence import TableEvidence
from gonio.data import layouts
from gonio.data.formats.registry import read
from support import helpers
from support.check_tables import LAYOUTS, SQUARE, degrees, model_table

SPHERICAL = layouts.spherical(degrees(0, 90, 15), degrees(0, 360, 45), degrees(0, 90, 15), degrees(0, 360, 45))
HALF = layouts.half_difference(degrees(0, 90, 10), degrees(0, 90, 10), degrees(0, 360, 30), degrees(0, 360, 45))
PAINT = "0.5 * ggx(alpha=0.4) + lambert(rho=0.3)"


def verdict(check, table, tolerance=0.05):
    return check(TableEvidence(table), tolerance).verdict


def tilted(layout):
    """f ∝ 1 + 0.2 cosθi: the two values of a pair differ by 0.2 |cosθi − cosθo| / (1 + 0.1 (cosθi + cosθo))."""
    return model_table("lambert(rho=1)", layout, lambda f, theta_i, *_: 1 + 0.2 * np.cos(theta_i))


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_pairs_are_there_on_every_layout_and_differ_as_they_should(layout):
    assert table_reciprocity(TableEvidence(model_table("ggx(alpha=0.4)", layout)), 0.05).residual < 1e-6
    reciprocity = table_reciprocity(TableEvidence(tilted(layout)), 0.05)
    cos_i, cos_o = layout.cosines()
    above = np.minimum(cos_i, cos_o) > 1e-9
    expected = np.max(np.abs(0.2 * (cos_i - cos_o) / (1 + 0.1 * (cos_i + cos_o)))[above])
    assert reciprocity.facts["largest"] == pytest.approx(expected, rel=1e-6)
    assert 0.05 < reciprocity.residual < expected and reciprocity.verdict == "fail"
    assert reciprocity.facts["pairs"] > 10


def test_a_layout_that_stores_one_value_for_both_cannot_be_tested():
    assert verdict(table_reciprocity, tilted(layouts.merl(counts=(8, 8, 8)))) == "not applicable"


def test_grids_that_differ_are_compared_through_interpolation_with_its_error():
    layout = layouts.isotropic(degrees(0, 81, 10), degrees(2.5, 85, 5), degrees(0, 360, 15))
    table = model_table("lambert(rho=0.3) + 0.2 * ggx(alpha=0.5)", layout)
    reciprocity = table_reciprocity(TableEvidence(table), 0.05)
    assert reciprocity.verdict == "pass" and reciprocity.facts["interpolation_error"] > 0


@pytest.mark.parametrize("surface", ["0.4 * ggx(alpha=0.25)", "0.4 * phong(n=30)", "0.15 * ward(alpha=0.05)"])
@pytest.mark.parametrize(
    "layout",
    [
        layouts.isotropic(degrees(0, 81, 30), degrees(0, 85, 5), degrees(0, 360, 15)),
        layouts.isotropic(degrees(0, 81, 15), degrees(1.5, 85, 3), degrees(0, 360, 15)),
        layouts.spherical(degrees(0, 81, 20), degrees(0, 360, 90), degrees(0, 85, 10), degrees(0, 360, 15)),
    ],
    ids=["far incidences", "other nodes", "far azimuths of the light"],
)
def test_interpolation_between_far_readings_does_not_fail_what_is_reciprocal(layout, surface):
    """A lobe that falls between two incidences differs from the line between its readings by any amount."""
    honest = model_table(f"lambert(rho=0.3) + {surface}", layout)
    assert verdict(table_reciprocity, honest) != "fail"
    violated = model_table(
        f"lambert(rho=0.3) + {surface}", layout, lambda f, i, _, o, __: f * (1 + 0.2 * np.sign(o - i))
    )
    assert verdict(table_reciprocity, violated) == "fail"


def test_known_noise_is_not_taken_for_a_violated_law():
    known, unknown = (
        table_reciprocity(TableEvidence(model_table("lambert(rho=0.5)", noise=0.1, stated=stated)), 0.05)
        for stated in (0.1, None)
    )
    assert known.verdict == unknown.verdict == "undecided"
    pairs = known.facts["pairs"]
    # Sums of squares and shares beyond 2σ of normal deviates, within four of their standard deviations.
    assert known.facts["chi2_per_pair"] == pytest.approx(1, abs=4 * np.sqrt(2 / pairs))
    assert known.facts["share_beyond_2_sigma"] == pytest.approx(0.0455, abs=4 * np.sqrt(0.0455 / pairs))


def test_a_table_lopsided_in_azimuth_is_not_symmetric():
    lopsided = model_table("lambert(rho=1)", change=lambda f, ti, pi, to, po: 1 + 0.3 * np.sin(po))
    assert verdict(table_symmetry, lopsided) == "fail"
    assert verdict(table_symmetry, model_table("ggx(alpha=0.5)")) == "pass"
    assert verdict(table_symmetry, model_table("ggx(alpha=0.5)", LAYOUTS["half of the azimuths"])) == "not applicable"


@pytest.mark.parametrize("layout", [SPHERICAL, HALF], ids=["spherical", "half/difference"])
def test_turned_readings_are_compared(layout):
    assert verdict(table_isotropy, model_table(PAINT, layout)) == "pass"
    for folds in (1, 2, 3, 4):  # leaning, brushed, threefold and woven surfaces

        def grain(f, ti, pi, to, po, folds=folds):
            return f * (1 + 0.5 * np.cos(folds * pi + 0.8) * np.sin(ti))

        assert verdict(table_isotropy, model_table(PAINT, layout, grain)) == "fail", folds
    assert verdict(table_isotropy, model_table(PAINT)) == "not applicable"


@pytest.mark.parametrize("layout", [SPHERICAL, SQUARE], ids=["spherical", "isotropic"])
def test_readings_at_the_normal_have_no_azimuth(layout):
    assert verdict(table_pole, model_table(PAINT, layout)) == "pass"
    assert verdict(table_pole, model_table(PAINT, layout, stated=0.01)) == "pass"
    off = model_table(PAINT, layout, lambda f, ti, pi, to, po: f * (1 + 0.3 * np.cos(po - pi)))
    pole = table_pole(TableEvidence(off), 0.05)
    assert pole.verdict == "fail"
    beside = layouts.isotropic(degrees(5, 86, 10), degrees(5, 86, 10), degrees(0, 360, 30))
    assert verdict(table_pole, model_table(PAINT, beside)) == "not applicable"


def test_a_channel_that_is_off_alone_fails_and_is_named():
    table = model_table("lambert(rho=[0.2, 0.2, 0.2])")
    table.f[..., 2] *= 1 + np.cos(table.layout.axes["theta_i"])[:, None, None]
    reciprocity = table_reciprocity(TableEvidence(table), 0.05)
    assert reciprocity.verdict == "fail" and reciprocity.where["channel"] == "B"


@pytest.mark.parametrize(("name", "expected"), [("cc_ibiza_sunset", "fail"), ("acrylic_felt_white", "undecided")])
def test_measured_materials_are_judged_as_known(name, expected):
    table = read(helpers.shared("data", "rgl", f"{name}_rgb.bsdf"))
    reciprocity = table_reciprocity(TableEvidence(table), 0.05)
    assert reciprocity.verdict == expected
    assert reciprocity.residual > 0.16 if expected == "fail" else reciprocity.residual < 0.03


@pytest.mark.parametrize(("model", "expected"), [("lambert + ggx", "pass"), ("lambert + beckmann", "undecided")])
def test_a_model_reads_the_exchanged_directions_as_far_as_the_readings_follow_it(model, expected):
    layout = layouts.isotropic(degrees(0, 81, 20), degrees(0, 81, 5), degrees(0, 360, 15))
    surface = "lambert(rho=0.3) + ggx(alpha=0.2, f0=0.5)"
    evidence = TableEvidence(model_table(surface, layout), model=model)
    reciprocity = table_reciprocity(evidence, 0.05)
    assert reciprocity.verdict == expected and "Without the model it is undecided" in reciprocity.detail
    assert bool(reciprocity.assumes) == (expected == "pass")


@pytest.mark.parametrize("last", [60, 80])
def test_light_that_is_missing_beside_steeper_views_is_named(last):
    table = model_table(
        "lambert(rho=0.3)", layouts.isotropic(degrees(0, last + 1, 20), degrees(0, 81, 20), degrees(0, 360, 30))
    )
    reciprocity = table_reciprocity(TableEvidence(table), 0.05)
    assert reciprocity.verdict == ("undecided" if last == 60 else "pass")
    named = "The light went to θi 60°, the detector to θo 80°: read light from up to there" in reciprocity.detail
    assert named == (last == 60)


def test_a_model_passes_nothing_that_readings_contradict():
    layout = layouts.isotropic(degrees(0, 81, 20), degrees(2.5, 81, 5), degrees(0, 360, 15))
    surface = "lambert(rho=0.3) + ggx(alpha=0.2, f0=0.5)"
    lie = model_table(surface, layout, lambda f, i, _, o, __: f * np.where((o > i) & (o > 1), 1.07, 1))
    assert table_reciprocity(TableEvidence(lie, model="lambert + ggx"), 0.05).verdict != "pass"
    not_reciprocal = TableEvidence(model_table(surface, layout), model="lambert + ggx(energy=turquin)")
    assert "the model is not reciprocal" in table_reciprocity(not_reciprocal, 0.05).detail


def test_a_table_that_was_made_reciprocal_says_so():
    """Readings of 2 % noise, and the same repaired: the pass is the table's, and not the surface's."""
    read = model_table(PAINT, SQUARE)
    noise = 0.02 * np.random.default_rng(0).standard_normal(read.f.shape)
    read = dataclasses.replace(read, f=read.f * (1 + noise), u_f=0.02 * np.abs(read.f))
    before, after = (table_reciprocity(TableEvidence(t), 0.05) for t in (read, gonio.repair(read).table))
    assert not before.assumes and "last digit" not in before.detail
    assert after.verdict == "pass" and after.assumes and "last digit" in after.detail

"""Verdicts on readings that should be equal: by the region that differs most, of truly exchanged pairs alone."""

import numpy as np
import pytest

import gonio
from gonio.data import layouts
from support.check_tables import degrees, model_table, property_of

GRID = layouts.isotropic(degrees(0, 86, 5), degrees(0, 86, 5), degrees(0, 360, 15))
HEMISPHERE = np.meshgrid(np.radians(np.arange(5.0, 86, 5)), np.radians(np.arange(0.0, 360, 15)), indexing="ij")


def planted(low, high, factor=2.0, noise=0.0, stated=None):
    """A diffuser whose readings at theta_o between two angles, degrees, and smaller theta_i are too bright."""

    def change(f, theta_i, phi_i, theta_o, phi_o):
        inside = (theta_o > np.radians(low)) & (theta_o < np.radians(high)) & (theta_i < np.radians(low))
        return np.where(inside, factor * f, f)

    return model_table("lambert(rho=0.3)", GRID, change, noise, stated)


@pytest.mark.parametrize("stated", [None, 0.02], ids=["noise not stated", "noise stated"])
@pytest.mark.parametrize(("low", "high"), [(32, 48), (73, 90)], ids=["low", "grazing"])
def test_a_region_that_differs_fails_wherever_it_lies(low, high, stated):
    reciprocity = property_of("reciprocity", planted(low, high, 1.3, 0.02, stated))
    assert reciprocity.verdict == "fail"
    angles = [v for k, v in reciprocity.where.items() if k.startswith("theta")]
    assert low - 10 < max(angles) <= 90
    assert property_of("reciprocity", planted(low, high, 1.0, 0.02, stated)).verdict != "fail"


@pytest.mark.parametrize(("factor", "verdict"), [(1.04, "pass"), (1.06, "fail")])
def test_exact_tables_are_judged_at_the_tolerance(factor, verdict):
    difference = 2 * (factor - 1) / (factor + 1)
    certificate = gonio.check(planted(32, 48, factor))
    assert certificate["reciprocity"].verdict == verdict
    assert certificate["reciprocity"].residual == pytest.approx(difference, rel=1e-6)


def test_a_few_pairs_that_surely_differ_leave_it_open_and_are_counted():
    table = planted(32, 48, 1.0)
    table.f[2, 9, 3] *= 1.5
    reciprocity = property_of("reciprocity", table)
    pairs = reciprocity.facts["pairs"]
    assert reciprocity.verdict == "undecided" and reciprocity.facts["share_beyond_tolerance"] == pytest.approx(
        1 / pairs
    )


def one_incidence(theta_i):
    theta_o, phi_o = (a.ravel() for a in HEMISPHERE)
    return gonio.Table.from_arrays(theta_i, 0.0, theta_o, phi_o, 0.1 * (1 + theta_o))


@pytest.mark.parametrize("theta_i", [0.0, np.radians(45.0)])
def test_readings_of_one_incidence_say_nothing_of_reciprocity(theta_i):
    grid = layouts.isotropic([theta_i], degrees(5, 86, 5), degrees(0, 360, 15))
    for table in (one_incidence(theta_i), model_table("lambert(rho=0.3)", grid)):
        certificate = gonio.check(table)
        assert certificate["reciprocity"].verdict == "not testable" and certificate.overall != "pass"


def test_repeats_are_merged_and_tell_the_noise():
    rng, n, noise = np.random.default_rng(1), 4, 0.03
    theta_i, theta_o, phi = (
        a.ravel() for a in np.meshgrid(*[np.radians(np.arange(5.0, 81, 15))] * 2, [0.0, 1.5, np.pi])
    )
    angles = [np.repeat(a, n) for a in (theta_i, 0 * phi, theta_o, phi)]
    f = 0.1 * (1 + noise * rng.normal(size=angles[0].size))
    reciprocity = property_of("reciprocity", gonio.Table.from_arrays(*angles, f))
    assert "repeats merged" in reciprocity.detail and reciprocity.verdict != "fail"
    # χ² of the merged repeats, as their scatter tells it: within four standard deviations of a normal law's.
    pairs = reciprocity.facts["pairs"]
    assert reciprocity.facts["chi2_per_pair"] == pytest.approx(1, abs=4 * np.sqrt(2 / pairs))


def test_what_no_reading_is_exchanged_with_is_told():
    layout = layouts.isotropic(degrees(0, 41, 5), degrees(0, 86, 5), degrees(0, 360, 15))
    certificate = gonio.check(model_table("lambert(rho=0.3)", layout))
    reciprocity = certificate["reciprocity"]
    assert reciprocity.verdict == "undecided" and "beyond θ 45°" in reciprocity.detail
    assert reciprocity.facts["share_not_compared"] == pytest.approx(0.5, abs=0.1)


def test_a_reference_is_missed_by_a_region_whatever_the_median():
    """Nine of ten readings are the reference's own; a region at grazing incidence is 30 % too bright."""
    exact, wrong = planted(73, 90, 1.0), planted(73, 90, 1.3)
    for table, verdict in ((exact, "pass"), (wrong, "fail")):
        agreement = property_of("agreement", table, against="lambert(rho=0.3)")
        assert agreement.verdict == verdict
    assert agreement.residual == pytest.approx(0.6 / 2.3, rel=1e-6) and agreement.where["theta_to"] > 70


def test_a_few_compared_pairs_do_not_stand_for_many_readings():
    rng, n = np.random.default_rng(2), 4000
    theta_i, theta_o = np.arccos(1 - 0.9 * rng.random((2, n)))
    phi_i, phi_o = rng.uniform(0, 2 * np.pi, (2, n))
    some = slice(40)
    angles = [np.r_[a, b[some]] for a, b in ((theta_i, theta_o), (phi_i, phi_o), (theta_o, theta_i), (phi_o, phi_i))]
    reciprocity = property_of("reciprocity", gonio.Table.from_arrays(*angles, np.full(n + 40, 0.1)))
    assert reciprocity.facts["pairs"] >= 40 and reciprocity.verdict == "undecided"
    assert reciprocity.facts["share_not_compared"] > 0.5


def with_noise(layout, expression, scatter, seed=1):
    """A table of a material whose readings scatter by scatter(f), which it does not state."""
    rng = np.random.default_rng(seed)
    return model_table(expression, layout, lambda f, *_: f + scatter(f) * rng.standard_normal(f.shape))


@pytest.mark.parametrize("name", ["isotropy", "pole"])
def test_noise_that_is_not_stated_is_not_taken_for_a_dependence_on_the_azimuth(name):
    ring = layouts.isotropic(degrees(0, 81, 10), degrees(0, 81, 10), degrees(0, 360, 15))
    brushed = "lambert(rho=0.1) + 0.5 * ggx(alpha_x=0.2, alpha_y=0.6, f0=0.9)"
    noisy = gonio.check(with_noise(ring, "lambert(rho=0.3)", lambda f: 0.3 * f))[name]
    assert noisy.verdict == "undecided" and noisy.residual > 0.1
    truly = property_of("isotropy", with_noise(ring, brushed, lambda f: 0.03 * f))
    assert truly.verdict == "fail" and truly.residual - truly.bound > 0.05


def test_the_noise_of_dark_readings_is_not_a_violation():
    """A detector's noise does not become smaller with what it reads: pairs in the dark differ by all they are."""
    satin = "lambert(rho=0.01) + 0.5 * ggx(alpha=0.15, f0=0.9)"
    table = with_noise(layouts.merl(counts=(12, 12, 24)), satin, lambda f: np.full(f.shape, 0.002))
    assert property_of("symmetry", table).verdict != "fail"
    table.f[...] = np.maximum(table.f, 0)  # many are cut off at zero
    assert property_of("symmetry", table).verdict != "fail"

import numpy as np
import pytest
from scipy.stats import norm, skellam

from gonio.checks.table.count_statistics import decimal_step, difference_p, family_p, quantum, sidak
from gonio.checks.table.reciprocity import table_reciprocity
from gonio.data.layouts import isotropic
from gonio.data.table import whole_table_of_values

POLAR = np.radians(np.arange(0, 86, 10.0))
LAYOUT = isotropic(POLAR, POLAR, np.radians(np.arange(0, 360, 30.0)))
ANGLES = [a.reshape(LAYOUT.shape) for a in LAYOUT.angles()]


def one(*values):
    return [np.array([float(v)]) for v in values]


@pytest.mark.parametrize(
    ("up", "down", "x"), [(0.2, 0.2, 5), (1, 1, 9), (10, 10, 22), (100, 100, 75), (1000, 1000, 250)]
)
def test_tails_of_counts_are_those_of_their_exact_distribution(up, down, x):
    p = difference_p(*one(x, 0, np.sqrt(up), np.sqrt(down), 1, 1, 0))[0]
    assert p == pytest.approx(2 * skellam.sf(x - 1, up, down), rel=0.01)


def test_tails_without_counts_are_normal():
    z = np.array([0.5, 2.4, 2.6, 8.0])
    p = difference_p(z, 0 * z, np.full(4, 0.6), np.full(4, 0.8), *np.full((2, 4), 1e-9), np.zeros(4))
    np.testing.assert_allclose(p, 2 * norm.sf(z), rtol=1e-4)


def test_no_difference_is_so_large_that_it_has_no_p_value():
    huge = np.array([50.0, 1e4, 1e12])
    p = difference_p(huge, 0 * huge, *np.ones((2, 3)), np.array([1e-6, 1.0, 1e6]), np.ones(3), np.zeros(3))
    assert np.all((p >= 0) & (p < 1e-9))


def test_a_family_has_the_level_that_was_asked():
    assert family_p(sidak(0.01, 12345), 12345) == pytest.approx(0.01)
    assert sidak(0.01, 1) == pytest.approx(0.01)


def test_the_size_of_a_count_is_found():
    rng = np.random.default_rng(0)
    expected, scale = rng.uniform(0.01, 0.5, 4000), 200.0
    f = rng.poisson(expected * scale) / scale
    noisy = np.sqrt(expected / scale + (0.1 * expected) ** 2)
    for u in (np.sqrt(expected / scale), noisy):
        assert np.median(quantum(np.zeros(4000), f, u)) * scale == pytest.approx(1, abs=0.4)
    # Noise in proportion has no counts: what is found is too small to change a tail.
    q = quantum(np.zeros(4000), expected, 0.02 * expected)
    assert np.max(q / (0.02 * expected)) < 0.05


def table(violation=0.0, relative=0.02, photons=None, seed=0):
    rng = np.random.default_rng(seed)
    theta_i, _, theta_o, phi = ANGLES
    f = 0.1 + 0.3 * np.exp(-((theta_i - theta_o) ** 2 + 0.3 * (1 + np.cos(phi))) / 0.1)
    f = f * (1 + violation * np.sign(theta_i - theta_o) / 2)
    u, reading = relative * f, f * (1 + relative * rng.standard_normal(f.shape))
    if photons:
        scale = photons * np.cos(theta_i)
        u, reading = np.sqrt(u**2 + f / scale), rng.poisson(reading * scale) / scale
    return whole_table_of_values(LAYOUT, reading, u_f=u[..., None])


@pytest.mark.parametrize(("photons", "least"), [(None, 3), (30, 0)])
def test_honest_tables_are_called_wrong_as_often_as_stated(photons, least):
    tables = (table(photons=photons, seed=k) for k in range(80))
    alarms = sum(table_reciprocity(t, 0.05, level=0.2).facts["significant"] for t in tables)
    # 16 expected of a continuous test, fewer of counts; 3.6 standard deviations.
    assert least <= alarms <= 29


@pytest.mark.parametrize(
    ("violation", "relative", "verdict", "significant"),
    [
        (0.005, 0.001, "pass", True),  # significant but tiny
        (0.0, 0.01, "pass", False),
        (0.02, 0.15, "undecided", False),  # not significant because noisy
        (0.10, 0.01, "fail", True),
    ],
)
def test_small_and_noisy_are_told_apart(violation, relative, verdict, significant):
    found = table_reciprocity(table(violation, relative), 0.05)
    assert (found.verdict, found.facts["significant"]) == (verdict, significant)
    assert found.facts["least_violation"] <= violation + 1e-9 <= found.facts["largest_violation"] + 1e-9
    assert (found.facts["p_value"] < 0.01) == significant


def test_a_single_wrong_pair_is_found_and_named():
    one = table(0.0, 0.01)
    one.f[5, 2, 3] *= 1.2
    found = table_reciprocity(one, 0.05)
    assert found.verdict == "fail"
    assert sorted((found.where["theta_i"], found.where["theta_o"])) == pytest.approx([20, 50])
    assert 0.05 < found.residual < 0.19
    p = np.array(found.series["p_map"]["p"], float)
    assert np.unravel_index(np.nanargmin(p), p.shape) in ((2, 5), (5, 2))


def test_a_channel_that_is_wrong_is_named():
    honest, wrong = table(0.0, 0.01), table(0.2, 0.01)
    f, u = (np.concatenate([getattr(t, k) for t in (honest, wrong)], -1) for k in ("f", "u_f"))
    found = table_reciprocity(whole_table_of_values(LAYOUT, f, u_f=u), 0.05)
    good, bad = found.facts["p_value_by_channel"]
    assert good > 0.01 and bad < 1e-9 and found.where["channel"] == 1


def test_readings_that_were_rounded_are_not_called_wrong_for_it():
    one = table(0.0, 1e-5)
    assert not table_reciprocity(one, 0.05).facts["significant"]
    one.f = np.round(one.f, 4)
    assert decimal_step(one.f.ravel()) == pytest.approx(1e-4)
    assert not table_reciprocity(one, 0.05).facts["significant"]
    wrong = table(0.05, 1e-5)
    wrong.f = np.round(wrong.f, 4)
    assert table_reciprocity(wrong, 0.05).facts["significant"]
    assert decimal_step(np.random.default_rng(0).random(100)) == 0 and decimal_step(np.full(100, 0.2)) == 0


@pytest.mark.parametrize(("stated", "said"), [(0.01, ""), (0.004, "too small"), (0.03, "too large")])
def test_uncertainties_that_do_not_fit_the_scatter_are_doubted(stated, said):
    one = table(0.0, 0.01)
    one.u_f = one.u_f * (stated / 0.01)
    found = table_reciprocity(one, 0.05)
    assert found.facts["scatter_in_uncertainties"] == pytest.approx(0.01 / stated, rel=0.15)
    assert said in found.detail and ("stated too" in found.detail) == bool(said)

"""Reciprocity of tables with stored uncertainties: alarms at the level, small and noisy told apart, places named."""

import numpy as np
import pytest
from scipy.stats import binom

from gonio.checks.table.comparison import compare
from gonio.checks.table.equal_readings import table_reciprocity, table_symmetry
from gonio.checks.table.evidence import LEVEL, TableEvidence
from gonio.checks.table.statistics.counts import decimal_step
from gonio.data.table import whole_table_of_values
from support.check_tables import SQUARE

ANGLES = [a.reshape(SQUARE.shape) for a in SQUARE.angles()]


def reciprocity_of(table, level=LEVEL):
    return table_reciprocity(TableEvidence(table, level), 0.05)


def table(violation=0.0, relative=0.02, photons=None, seed=0):
    rng = np.random.default_rng(seed)
    theta_i, _, theta_o, phi = ANGLES
    beside = np.sin(theta_i) * np.sin(theta_o) * (1 + np.cos(phi))  # the same at all azimuths at normal incidence
    f = 0.1 + 0.3 * np.exp(-((theta_i - theta_o) ** 2 + beside) / 0.1)
    f = f * (1 + violation * np.sign(theta_i - theta_o) / 2)
    u, reading = relative * f, f * (1 + relative * rng.standard_normal(f.shape))
    if photons:
        scale = photons * np.cos(theta_i)
        u, reading = np.sqrt(u**2 + f / scale), rng.poisson(reading * scale) / scale
    return whole_table_of_values(SQUARE, reading, u_f=u[..., None])


@pytest.mark.parametrize("photons", [None, 30])
def test_honest_tables_are_called_wrong_as_often_as_stated(photons):
    tables, level = 80, 0.2
    alarms = sum(reciprocity_of(table(photons=photons, seed=k), level).facts["significant"] for k in range(tables))
    assert alarms <= binom.ppf(0.9995, tables, level)
    if photons is None:  # tests of counts alarm less often than their level
        assert alarms >= binom.ppf(0.0005, tables, level)


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
    reciprocity = reciprocity_of(table(violation, relative))
    assert (reciprocity.verdict, reciprocity.facts["significant"]) == (verdict, significant)
    assert reciprocity.facts["least_violation"] <= violation + 1e-9 <= reciprocity.facts["largest_violation"] + 1e-9
    assert (reciprocity.facts["p_value"] < 0.01) == significant


def test_a_single_wrong_pair_is_found_and_named():
    one = table(0.0, 0.01)
    one.f[5, 2, 3] *= 1.2
    reciprocity = reciprocity_of(one)
    assert reciprocity.verdict == "fail"
    assert sorted((reciprocity.where["theta_i"], reciprocity.where["theta_o"])) == pytest.approx([20, 50])
    assert 0.05 < reciprocity.residual < 0.19
    p = np.array(reciprocity.series["p_map"]["p"], float)
    assert np.unravel_index(np.nanargmin(p), p.shape) in ((2, 5), (5, 2))


def test_a_channel_that_is_wrong_is_named():
    honest, wrong = table(0.0, 0.01), table(0.2, 0.01)
    f, u = (np.concatenate([getattr(t, k) for t in (honest, wrong)], -1) for k in ("f", "u_f"))
    reciprocity = reciprocity_of(whole_table_of_values(SQUARE, f, u_f=u))
    good, bad = reciprocity.facts["p_value_by_channel"]
    assert good > 0.01 and bad < 1e-9 and reciprocity.where["channel"] == "channel 2"


def test_readings_that_were_rounded_are_not_called_wrong_for_it():
    one = table(0.0, 1e-5)
    assert not reciprocity_of(one).facts["significant"]
    one.f = np.round(one.f, 4)
    assert decimal_step(one.f.ravel()) == pytest.approx(1e-4)
    assert not reciprocity_of(one).facts["significant"]
    wrong = table(0.05, 1e-5)
    wrong.f = np.round(wrong.f, 4)
    assert reciprocity_of(wrong).facts["significant"]
    assert decimal_step(np.random.default_rng(0).random(100)) == 0 and decimal_step(np.full(100, 0.2)) == 0


@pytest.mark.parametrize(("stated", "remark"), [(0.01, ""), (0.004, "too small"), (0.03, "too large")])
def test_uncertainties_that_do_not_fit_the_scatter_are_doubted(stated, remark):
    one = table(0.0, 0.01)
    one.u_f = one.u_f * (stated / 0.01)
    reciprocity = reciprocity_of(one)
    assert reciprocity.facts["scatter_in_uncertainties"] == pytest.approx(0.01 / stated, rel=0.15)
    assert remark in reciprocity.detail and ("stated too" in reciprocity.detail) == bool(remark)


def test_dark_readings_of_one_count_and_of_none_are_no_violation():
    theta_i, _, theta_o, phi = ANGLES
    level, names = 0.05, ("reciprocity", "symmetry")
    alarms, fails = dict.fromkeys(names, 0), 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        # From 1e-6 counts to thousands, dimmer readings with larger counts: light that arrives aslant.
        expected = 3000 * np.exp(-((theta_i - theta_o) ** 2 + 1 - np.cos(phi - np.pi)) * 6)
        scale = 1e5 * np.cos(theta_i)
        measured = whole_table_of_values(
            SQUARE,
            rng.poisson(expected * np.cos(theta_i)) / scale,
            u_f=np.sqrt(expected * np.cos(theta_i))[..., None] / scale[..., None],
        )
        for name, check in zip(names, (table_reciprocity, table_symmetry), strict=True):
            judged = check(TableEvidence(measured, level), 0.05)
            alarms[name] += judged.facts["significant"]
            fails += judged.verdict == "fail"
            assert judged.residual + judged.bound <= 2
    assert max(alarms.values()) <= binom.ppf(0.9995, 40, level), alarms
    assert fails <= binom.ppf(0.9995, 80, level)


def test_noise_without_a_sign_fails_nothing_that_no_test_calls_significant():
    rng = np.random.default_rng(3)
    readings = rng.standard_normal(SQUARE.shape)
    faint = whole_table_of_values(SQUARE, 0.01 + readings, u_f=np.full((*SQUARE.shape, 1), 0.95))
    evidence = TableEvidence(faint)
    pairs = evidence.pairs("exchanged")
    judged = compare(evidence, pairs, np.zeros(len(pairs))).judged("pole", evidence, 0.05, "readings")
    assert not judged.facts["significant"]
    assert judged.verdict == "undecided"

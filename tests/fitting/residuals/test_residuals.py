"""What a fit leaves over: tests that know noise from structure, maps, outliers, and counts."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from gonio.data.flags import Flag
from gonio.fitting.fit_table import fit
from gonio.fitting.residuals.maps import residual_map
from gonio.fitting.residuals.noise_tests import chi2_upper, judge, runs
from gonio.fitting.residuals.pair_angles import neighbour_order, pair_angles
from gonio.models.geometry.directions import Direction
from support.fit_tables import ISOTROPIC, table_of

TRUTH = "lambert(rho=[.1,.2,.4])+[.6,.5,.4]*ggx(alpha=0.3)"


def directions(theta, phi):
    return Direction(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))


def test_runs_by_all_sequences():
    """Mean 0 and standard deviation 1 over every order of five ups and four downs."""
    import itertools

    z = []
    for up in itertools.combinations(range(9), 5):
        signs = np.zeros(9, bool)
        signs[list(up)] = True
        z.append(runs(signs))
    assert np.mean(z) == pytest.approx(0, abs=1e-12) and np.std(z) == pytest.approx(1, abs=1e-12)
    assert np.isnan(runs(np.ones(9, bool)))


def test_chi_squared():
    for freedom in (10, 100, 5000):
        for value in (0.7, 1.0, 1.3):
            assert chi2_upper(value * freedom, freedom) == pytest.approx(
                stats.chi2.sf(value * freedom, freedom), abs=2e-3
            )


def test_noise_and_structure_are_told_apart():
    rng = np.random.default_rng(0)
    n, said = 4000, []
    for wave in (0.0, 0.05, 0.5):
        t = rng.standard_normal((n, 2)) + wave * np.sin(np.arange(n) / 50)[:, None]
        said.append(judge(t, np.ones_like(t, bool), None, 0, False))
    assert [s.verdict for s in said] == ["noise", "noise", "structure"]
    assert said[2].shared == pytest.approx(0.125 / 1.125, abs=0.03)
    one_sided = np.abs(rng.standard_normal((n, 1)))
    assert judge(one_sided, np.ones((n, 1), bool), None, 0, False).verdict == "structure"
    assert judge(one_sided[:5], np.ones((5, 1), bool), None, 0, False).verdict == "unknown"


def test_false_alarms_are_as_rare_as_said():
    rng = np.random.default_rng(1)
    said = [judge(rng.standard_normal((300, 3)), np.ones((300, 3), bool), None, 0, False) for _ in range(400)]
    assert sum(s.verdict == "structure" for s in said) <= 4
    assert sum(s.runs_p < 0.05 for s in said) <= 30  # 20 are expected


def test_neighbours_follow_each_other():
    rng = np.random.default_rng(2)
    wi, wo = (directions(np.arccos(rng.random(3000)), rng.uniform(0, 2 * np.pi, 3000)) for _ in range(2))
    order = neighbour_order(wi, wo)
    assert np.array_equal(np.sort(order), np.arange(3000))
    at = np.stack([*wi, *wo])
    steps = [np.median(np.linalg.norm(np.diff(at[:, o], axis=1), axis=0)) for o in (np.arange(3000), order)]
    assert steps[1] < 0.3 * steps[0]


def test_angles_of_pairs():
    theta, phi = np.radians([10.0, 40.0, 70.0]), np.zeros(3)
    a = pair_angles(directions(theta, phi), directions(theta, phi + np.pi))
    np.testing.assert_allclose(a.theta_i, [10, 40, 70])
    np.testing.assert_allclose(a.theta_h, 0, atol=1e-6)
    np.testing.assert_allclose(a.theta_d, [10, 40, 70])
    retro = pair_angles(directions(theta, phi), directions(theta, phi))
    np.testing.assert_allclose(retro.theta_h, [10, 40, 70])
    np.testing.assert_allclose(retro.phase, 0, atol=1e-6)


def test_a_map_holds_medians_and_counts():
    theta = np.radians([15.0, 15.0, 15.0, 55.0])
    a = pair_angles(directions(theta, np.zeros(4)), directions(np.radians([25.0, 25.0, 25.0, 65.0]), np.zeros(4)))
    relative = np.array([[0.1], [0.2], [0.9], [-0.5]])
    m = residual_map(a, relative, np.array([[True], [True], [True], [True]]), ("theta_i", "theta_o"))
    assert m.median_relative[1, 2] == 0.2 and m.count[1, 2] == 3 and m.median_relative[5, 6] == -0.5
    assert np.isnan(m.median_relative[0, 0]) and m.count.sum() == 4 and m.region(1, 2) == "θi 10–20°, θo 20–30°"


@pytest.fixture(scope="module")
def right():
    return fit(table_of(TRUTH, noise=0.01), "lambert + ggx", starts=0)


def test_a_right_model_leaves_noise_and_a_wrong_one_structure(right):
    assert right.residuals.noisiness.verdict == "noise" and "are noise" in right.residuals.sentences[0]
    assert right.residuals.scale == pytest.approx(0.01, rel=0.05)
    wrong = fit(table_of(TRUTH, noise=0.01), "lambert", starts=0)
    assert wrong.residuals.noisiness.verdict == "structure"
    assert "structure, not noise" in wrong.residuals.sentences[0] and "darker" in wrong.residuals.worst_region
    assert right.colour_difference["mean"] < 1 < 5 < wrong.colour_difference["mean"]
    assert wrong.residuals.maps["half_difference"].median_relative[0, 0] < -0.3


def test_everything_is_in_what_is_written(right):
    import json

    import tomli_w

    from gonio.data.serialise import plain

    written = right.to_dict()
    assert written["residuals"]["maps"]["incident_outgoing"]["count"] and written["colour_difference"]["pixels"] > 100
    assert "evidence" not in written and written["counts"]["used"] == right.samples
    json.dumps(plain(written), allow_nan=False)
    tomli_w.dumps(right.to_material_dict("right"))
    assert dataclasses.replace(right, notes=[]).residuals.noisiness == right.residuals.noisiness


def test_masked_missing_and_negative_are_counted_apart():
    table = table_of("lambert(rho=0.3)")
    valid = np.flatnonzero(table.flag.ravel() == Flag.VALID)
    for k, flag in enumerate((Flag.SATURATED, Flag.SHADOWED, Flag.NOT_MEASURED)):
        table.flag.ravel()[valid[k::50]] = flag
    table.f.ravel()[valid[10::50]] *= -1
    left = valid.size - sum(valid[k::50].size for k in range(3))
    near = np.minimum(*(w.z for w in ISOTROPIC.directions())) > np.cos(np.radians(60))
    counts = fit(table, "lambert", theta_max=np.radians(60)).counts
    usable = (table.flag.ravel() == Flag.VALID) & near
    assert counts["used"] == np.count_nonzero(usable) and counts["left_out"] == left - counts["used"]
    assert counts["saturated"] == valid[::50].size and counts["shadowed"] == valid[1::50].size
    assert counts["missing"] == valid[2::50].size
    assert counts["negative"] == np.count_nonzero(usable & (table.f.ravel() < 0)) > 0


def test_numbers_that_go_together_are_listed():
    table = table_of("0.6*ggx(alpha=0.3, f0=0.1)+lambert(rho=.2)", noise=0.01)
    result = fit(table, "lambert + ggx(f0=?)", theta_max=np.radians(56), starts=0)
    (pair, *_) = result.correlated
    assert {pair["a"], pair["b"]} == {"ggx.f0", "ggx.scale"} and pair["correlation"] < -0.95

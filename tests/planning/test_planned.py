"""Plans: what they promise holds, they keep their time and the instrument's limits, and `gonio measure` runs them."""

import dataclasses
import json

import numpy as np
import pytest

import gonio
from gonio.__main__ import main
from gonio.data import layouts
from gonio.data.hdf5.writer import open_table
from gonio.instrument import Instrument, Pace, measure
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import Direction
from gonio.planning.design import gram
from gonio.planning.limit import least_variance
from gonio.planning.planner import Planner
from gonio.planning.prior import prior_of
from gonio.planning.shots import Shots, ordered
from gonio.planning.wanted import quantities
from gonio.planning.ways import ways_of

GLOSSY = "lambert(rho=0.3) + 0.5 * ggx(alpha=0.1)"
COUNTING = Instrument(photons=1e4, dark=10.0, shadow=0.1)


@pytest.fixture(scope="module")
def glossy():
    return gonio.plan(GLOSSY, COUNTING, budget=600.0)


def scattered_shots(n):
    rng = np.random.default_rng(3)
    angles = np.stack([rng.uniform(0, 1.4, n), rng.uniform(0, 6, n), rng.uniform(0, 1.4, n), rng.uniform(0, 6, n)])
    return Shots(angles, rng.uniform(0.1, 2.0, n))


def test_a_plan_keeps_its_time_and_the_instruments_limits(glossy):
    assert glossy.hours * 3600 == pytest.approx(600, abs=0.5)
    angles, seconds = glossy.shots
    assert COUNTING.pace.path_seconds(angles, seconds) == pytest.approx(600, abs=0.5)
    table = measure(GLOSSY, COUNTING, glossy.layout, seconds=seconds)
    assert (table.flag == 0).all() and (seconds > 0).all()
    assert glossy.residual <= 1e-3 * glossy.scale


def test_the_plan_knows_each_number_better_than_the_best_regular_scan_by_its_own_criterion(glossy):
    free = [n for n in glossy.numbers if "albedo" not in n.name]
    assert [n.name for n in free] == ["lambert.rho", "ggx.alpha", "ggx.scale"]
    assert glossy.advantage > 3  # variances, which go with one over the hours


def test_promised_uncertainties_are_the_scatter_of_a_closed_form_fit():
    # Of a Lambertian the best estimate is a weighted mean: the scatter of many measurements needs no solver.
    instrument, times = Instrument(photons=1e3, dark=20.0, noise=0.01), 1000
    planned = gonio.plan("lambert(rho=0.4)", instrument, budget=30.0)
    many = layouts.scattered(*np.tile(planned.shots.angles, times))
    table = measure("lambert(rho=0.4)", instrument, many, seconds=np.tile(planned.shots.seconds, times))
    f, weight = (a.reshape(times, -1) for a in (table.f, 1 / table.u_f**2))
    estimates = np.pi * np.sum(weight * f, axis=1) / np.sum(weight, axis=1)
    u = planned.numbers[0].standard_uncertainty
    assert np.std(estimates) == pytest.approx(u, rel=0.1) and np.mean(estimates) == pytest.approx(0.4, abs=0.15 * u)
    calibrated = gonio.plan("lambert(rho=0.4)", dataclasses.replace(instrument, calibration=0.02), budget=30.0)
    assert calibrated.numbers[0].standard_uncertainty == pytest.approx(np.hypot(u, 0.02 * 0.4), rel=1e-3)


def test_order_changes_no_information_and_never_lengthens_the_way():
    planner, shots = Planner(prior_of(GLOSSY, None), COUNTING), scattered_shots(60)
    best = ordered(shots, COUNTING.pace)
    before, after = (COUNTING.pace.path_seconds(s.angles, s.seconds) for s in (shots, best))
    assert after < 0.7 * before
    np.testing.assert_allclose(planner.covariance(best), planner.covariance(shots), rtol=1e-9)
    again = ordered(best, COUNTING.pace)
    assert COUNTING.pace.path_seconds(*again) <= after + 1e-9


def test_repeated_directions_are_read_one_after_another():
    shots = scattered_shots(5)
    shuffled = np.random.default_rng(0).permutation(np.repeat(np.arange(5), 4))
    repeated = Shots(shots.angles[:, shuffled], shots.seconds[shuffled])
    best = ordered(repeated, Pace())
    assert np.count_nonzero(np.abs(np.diff(best.angles, axis=1)).sum(0)) == 4
    assert sorted(best.seconds) == sorted(repeated.seconds)


def test_a_target_is_met_and_not_by_far():
    planned = gonio.plan(GLOSSY, COUNTING, target=0.001, wanted=["alpha", "rho"])
    worst = max(n.standard_uncertainty / n.value for n in planned.numbers[:2])
    assert 0.9e-3 < worst <= 1e-3
    with pytest.raises(GonioError, match="out of reach"):
        gonio.plan("lambert(rho=0.4)", dataclasses.replace(COUNTING, calibration=0.05), target=0.01)


def test_what_was_read_already_is_not_read_again():
    lambertian = measure("lambert(rho=0.4)", COUNTING, gonio.plan("lambert(rho=0.4)", COUNTING, budget=60.0).layout)
    best = {"model": "lambert", "budget": 60.0, "space_filling": 0.0}  # what fills the range goes elsewhere by now
    fresh = gonio.plan(lambertian, COUNTING, **best).numbers[0].standard_uncertainty
    more = gonio.plan(None, COUNTING, continued=lambertian, **best).numbers[0]
    rows = np.sqrt(np.sum(1 / (np.pi * lambertian.u_f) ** 2))
    assert more.standard_uncertainty == pytest.approx((fresh**-2 + rows**2) ** -0.5, rel=0.02)


def test_a_rival_is_told_apart_by_what_its_best_fit_leaves():
    planned = gonio.plan(GLOSSY, COUNTING, budget=600.0, against="lambert + beckmann")
    table = measure(GLOSSY, COUNTING, planned.layout, seconds=planned.shots.seconds)
    left_over = 2 * gonio.fit(table, "lambert + beckmann").cost  # χ² of noise, and of the separation
    assert np.sqrt(left_over) == pytest.approx(planned.separation, rel=0.05)
    assert planned.advantage > 9
    assert planned.advantage == pytest.approx((planned.separation / planned.numbers[0].regular) ** 2)
    with pytest.raises(GonioError, match="no readings of this time tell them apart"):
        gonio.plan("lambert(rho=0.4)", COUNTING, budget=60.0, against="eon")


def test_directions_that_cannot_tell_numbers_apart_are_refused():
    with pytest.raises(GonioError, match=r"do not determine lambert1\.rho, lambert2\.rho together"):
        gonio.plan("lambert(rho=0.3) + lambert(rho=0.2)", COUNTING, budget=600.0)
    for wrong, reason in (({"budget": 600.0, "target": 0.1}, "one of both"), ({"budget": -1.0}, "the budget is"),
                          ({"budget": 5.0}, "too short"), ({"budget": 9.0, "wanted": ["x"]}, "no number x"),
                          ({"budget": 600.0, "ranges": {"alpha": (0.3, 0.1)}}, "the range of alpha")):  # fmt: skip
        with pytest.raises(GonioError, match=reason):
            gonio.plan(GLOSSY, COUNTING, **wrong)


def test_the_command_writes_a_path_that_measure_runs(tmp_path, capsys):
    (tmp_path / "lab.toml").write_text("gonio_instrument = 1\ncount_rate = 1e4\nsettling = 0.5\ntheta_o = [0, 70]\n")
    csv, png, table = (str(tmp_path / name) for name in ("p.csv", "p.png", "t.h5"))
    described = ["--instrument", str(tmp_path / "lab.toml")]
    given = ["plan", GLOSSY, "--budget", "10min", *described, "--for", "albedo", "--range", "alpha=0.05:0.3"]
    assert main([*given, "-o", csv, "--picture", png, "--json", str(tmp_path / "p.json")]) == 0
    out = capsys.readouterr().out
    assert "albedo at 60°" in out and "Kiefer-Wolfowitz" in out and "10 min" in out
    assert main(["measure", GLOSSY, *described, "--scan", csv, "-o", table]) == 0
    read, stored = open_table(table), json.loads((tmp_path / "p.json").read_text())
    assert (read.flag == 0).all() and read.layout.size == len(stored["shots"]["seconds"])
    assert read.provenance["counting"]["seconds"] == pytest.approx(sum(stored["shots"]["seconds"]))
    assert np.degrees(read.layout.angles()[2]).max() <= 70
    assert main([*given, "-o", csv]) == 2 and "--force" in capsys.readouterr().err


def test_gram_matrices_of_shots_add_up():
    rows = np.random.default_rng(5).normal(size=(1, 6, 1, 3))
    parts = gram(rows[:, :2], np.ones(2)) + gram(rows[:, 2:], np.ones(4))
    np.testing.assert_allclose(parts, gram(rows, np.ones(6)))


@pytest.mark.parametrize(
    ("lit", "sides"), [("front", {(1, 1), (1, -1)}), ("both", {(1, 1), (1, -1), (-1, -1), (-1, 1)})]
)
def test_a_plan_of_a_sheet_goes_wherever_it_sends_light_and_keeps_its_promise(lit, sides):
    sheet = "thin_sheet(rho=0.3, tau=0.4)"
    instrument = Instrument(photons=1e3, noise=0.01)
    planned = gonio.plan(sheet, instrument, budget=300.0, lit=lit)
    angles, seconds = planned.shots
    read = {(int(a), int(b)) for a, b in np.sign(np.cos(angles[[0, 2]])).T}
    assert read == sides
    assert {"albedo at 0°", "transmittance at 0°"} <= {n.name for n in planned.numbers}
    table = measure(sheet, instrument, planned.layout, seconds=seconds, seed=2)
    reflected = np.cos(angles[0]) * np.cos(angles[2]) > 0
    for name, level, which in (("rho", 0.3, reflected), ("tau", 0.4, ~reflected)):
        f, weight = (a.ravel()[which] for a in (table.f, 1 / table.u_f**2))
        u = next(n for n in planned.numbers if n.name == f"thin_sheet.{name}").standard_uncertainty
        assert np.pi / np.sqrt(weight.sum()) == pytest.approx(u, rel=0.02)
        assert np.pi * np.sum(weight * f) / weight.sum() == pytest.approx(level, abs=4 * u)


def test_refracted_light_is_looked_for_where_snells_law_sends_it():
    way = ways_of(gonio.material("rough_dielectric(alpha=0.1, eta=1.5)").brdf)[1]
    light = np.radians([[0.0, 30.0, 80.0], [0.0, 10.0, 50.0]])
    theta, phi = way.sent(light, Direction(*np.array([[0.0] * 3, [0.0] * 3, [1.0] * 3])))
    np.testing.assert_allclose(np.sin(theta), np.sin(light[0]) / 1.5, atol=1e-12)
    np.testing.assert_allclose(np.cos(phi[1:] - light[1, 1:]), -1, atol=1e-12)
    np.testing.assert_allclose(way.unfolded(np.array([[0.3], [0.0], [0.2], [1.0]]))[2], np.pi - 0.2)


def test_radiance_through_a_sheet_is_wanted_by_its_transmittance(tmp_path):
    """τ/π of the light behind: in proportion to τ, and dark where nothing goes through."""
    path = tmp_path / "window.toml"
    light, view = "[[light]]\ntheta = [90, 180]\nfills = true\n", "[[view]]\ntheta = 30\n"
    path.write_text(f"gonio_scene = 1\ntolerance = 0.1\n{light}{view}")
    prior = prior_of("lambert_transmission(tau=0.4)", None)
    wanted = quantities(prior, prior.p, [f"scene:{path}"])
    assert wanted.values == pytest.approx(0.4 / np.pi / 2, rel=0.02)
    np.testing.assert_allclose(np.abs(wanted.slopes), wanted.values[:, None] / 0.4, rtol=1e-9)
    with pytest.raises(GonioError, match="is dark in the scene 'window'"):
        gonio.plan("lambert(rho=0.3)", budget=300.0, wanted=[f"scene:{path}"])


@pytest.mark.parametrize(
    ("subject", "options", "message"),
    [
        ("lambert(rho=0.3)", {"lit": "back"}, "sends no light on that comes from behind"),
        ("thin_sheet(rho=0.3, tau=0.4)", {"lit": "below"}, "give front, back or both"),
    ],
)
def test_what_a_plan_cannot_take_of_what_transmits_is_said(subject, options, message):
    with pytest.raises(GonioError, match=message):
        gonio.plan(subject, budget=300.0, **options)


def test_no_design_goes_below_the_limit_and_a_lambertians_is_known():
    # One number: the best is to count all the time where a second tells most, in one shot.
    planner = Planner(prior_of("lambert(rho=0.4)", None), COUNTING)
    one = [planner.mean_variance(planner.covariance(Shots(a[:, None], np.array([60.0 - COUNTING.pace.settling]))))
           for a in planner.candidates.angles.T[::50]]  # fmt: skip
    limit = least_variance(planner, 60.0)
    assert 0.98 * min(one) <= limit <= min(one) * (1 + 1e-9)
    assert np.isnan(least_variance(Planner(planner.prior, dataclasses.replace(COUNTING, calibration=0.02)), 60.0))


def test_a_plan_is_good_for_the_corners_of_its_ranges():
    prior = prior_of("0.8 * ggx(alpha_x=0.06, alpha_y=0.3)", None, {"alpha_x": (0.03, 0.1)})
    corners = {tuple(np.round(d, 9)) for d in prior.draws[1:]}
    assert prior.spread == {"ggx.alpha_x": (0.03, 0.1), "ggx.alpha_y": (pytest.approx(0.1), pytest.approx(0.9))}
    assert len(corners) == 4 and prior.ranged and prior.shares.sum() == pytest.approx(1)
    many = prior_of(" + ".join(f"0.1 * ggx(alpha={a})" for a in (0.05, 0.1, 0.2, 0.3)), None)
    widths = many.draws[:, [n.endswith("alpha") for n in many.names]]
    assert len(widths) == 9 and (widths[1] < widths[0]).all() and (widths[2] > widths[0]).all()

"""Coefficients of light below the surface from profiles: recovery, uncertainty, and what is left open."""

import dataclasses

import jax
import numpy as np
import pytest

import gonio
from gonio.data.channels import Channels
from gonio.data.profile import Profile
from gonio.fitting.subsurface.profile_fit import fit_profile
from gonio.instrument.offsets_scan import measure_profile
from gonio.models.errors import GonioError

TRUTH = {"sigma_a": 0.02, "sigma_s": 1.5}
MATERIAL = "dipole(sigma_a=0.02, sigma_s=1.5, eta=1.3)"
OFFSETS = np.array([-6.0, -2.0, -0.5, 0.0, 0.5, 2.0, 6.0, 12.0])
SPOTS = {"illuminated_radius": 0.5, "viewed_radius": 0.3}
MODEL = "dipole(eta=1.3)"


@pytest.fixture(scope="module")
def exact():
    return measure_profile(MATERIAL, gonio.Instrument(**SPOTS), OFFSETS)


def numbers(fit):
    return {p.name.split(".")[1]: p for p in fit.parameters if p.status != "fixed"}


def test_an_exact_profile_gives_its_material_back(exact):
    fit = fit_profile(exact, MODEL)
    assert fit.converged and fit.metrics["relative_rms"] < 1e-6
    assert {n: p.value for n, p in numbers(fit).items()} == pytest.approx(TRUTH, rel=1e-5)


def test_the_finite_spots_are_taken_into_account(exact):
    points = dataclasses.replace(exact, offsets=OFFSETS, illuminated_radius=1e-3, viewed_radius=1e-3)
    biased = numbers(fit_profile(points, MODEL))
    assert abs(biased["sigma_s"].value / TRUTH["sigma_s"] - 1) > 0.02


def with_noise(profile, rng):
    u = np.sqrt(profile.value / (1e6 * np.pi * 0.25))  # of a million photons on the lit spot
    return dataclasses.replace(profile, value=profile.value + u * rng.standard_normal(u.shape), u=u)


def test_noisy_profiles_are_within_their_uncertainties(exact):
    z, rng = [], np.random.default_rng(0)
    for _ in range(6):
        profile = with_noise(exact, rng)
        fit = fit_profile(profile, MODEL)
        assert fit.converged
        z += [(p.value - TRUTH[n]) / p.standard_uncertainty for n, p in numbers(fit).items()]
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.5 and np.abs(z).max() < 4.5


def test_a_gain_or_a_dark_signal_moves_a_fit_as_far_as_it_says(exact):
    profile = dataclasses.replace(with_noise(exact, np.random.default_rng(0)), provenance={})
    before = fit_profile(profile, MODEL)
    assert "which nothing states" in before.judgement.sentence
    for row in before.common_errors:
        dark = row["equal"] / (np.pi * SPOTS["illuminated_radius"] ** 2)
        value = profile.value + dark if row["name"] == "dark" else profile.value * (1 + row["equal"])
        moved, name = (
            numbers(fit_profile(dataclasses.replace(profile, value=value), MODEL)),
            row["number"].split(".")[1],
        )
        old = numbers(before)[name]
        assert abs(moved[name].value - old.value) / old.standard_uncertainty == pytest.approx(1.0, abs=0.05)
    stated = fit_profile(dataclasses.replace(profile, provenance={"instrument": {"calibration": 0.02}}), MODEL)
    assert stated.judgement.verdict == "fair" and "± 2 % moves" in stated.judgement.sentence


@pytest.mark.thorough
def test_a_model_that_does_not_follow_an_exact_profile_is_not_called_good():
    """The same dipole by another index: its residuals are not noise, and what was assumed is said."""
    profile = measure_profile(MATERIAL, gonio.Instrument(**SPOTS), np.geomspace(0.1, 20, 20))
    wrong = fit_profile(profile, "dipole")
    assert wrong.judgement.verdict != "good" and "structure" in wrong.judgement.sentence
    assert any("eta is taken as 1" in note for note in wrong.notes)
    assert fit_profile(profile, MODEL).judgement.verdict == "good"


@pytest.mark.parametrize("precision", [True, False])
def test_readings_that_the_model_cannot_follow_have_an_optimum_too(exact, precision):
    """Residuals of a fifth of the readings, where steps as long as the linear model says never settle."""
    distance = np.abs(OFFSETS)[:, None] + 0.3
    power_law = dataclasses.replace(exact, value=0.1 / (distance + distance**3), u=np.full_like(exact.u, np.nan))
    with jax.enable_x64(precision):
        fit = fit_profile(power_law, MODEL)
    assert fit.converged and fit.metrics["relative_rms"] > 0.05


def test_what_readings_leave_open_is_named(exact):
    same = dataclasses.replace(exact, offsets=1 + 1e-9 * np.abs(OFFSETS), value=0 * exact.value + 0.01)
    fit = fit_profile(same, MODEL)
    assert any("not determined" in s or "only the combination" in s for s in fit.undetermined)
    assert numbers(fit)["sigma_s"].status == "undetermined"
    assert "sigma_s·(1 − g)" in fit_profile(exact, "dipole(eta=1.3, g=?)").undetermined[0]


def test_no_absorption_is_a_bound():
    clear = measure_profile("dipole(sigma_a=0, sigma_s=1.5, eta=1.3)", gonio.Instrument(**SPOTS), OFFSETS)
    clear = with_noise(clear, np.random.default_rng(1))
    absorption = numbers(fit_profile(clear, MODEL))["sigma_a"]
    assert absorption.status == "at lower bound" and absorption.interval95[0] == 0 < absorption.interval95[1] < 0.01


def test_a_fitted_material_is_written_and_read(exact, tmp_path):
    fit = fit_profile(exact, "dipole(sigma_a=0.02, eta=1.3)")
    assert numbers(fit).keys() == {"sigma_s"}
    read = gonio.material(fit.save(tmp_path / "fit.toml"))
    assert read.expression == fit.material.expression and read.meta["fit"]["converged"]


def test_quantities_of_a_fit_have_the_uncertainty_by_its_covariance(exact, tmp_path):
    """By the two numbers that the file keeps: against a Monte Carlo of their normal law, in σs' and σa themselves."""
    fit = fit_profile(with_noise(exact, np.random.default_rng(3)), MODEL)
    fit.save(tmp_path / "fit.toml")
    of_fit = {q.name: q for q in gonio.quantities(str(tmp_path / "fit.toml"), only=["subsurface"]).quantities}
    known = fit.covariance_by_channel[0]
    assert known["numbers"] == [0, 1]
    draws = np.random.default_rng(0).multivariate_normal(
        [p.value for p in numbers(fit).values()], known["covariance"], 4000
    )
    for name, values in {
        "absorption coefficient σa": draws[:, 0],
        "transport mean free path": 1 / draws.sum(axis=1),
        "diffusion length": 1 / np.sqrt(3 * draws[:, 0] * draws.sum(axis=1)),
    }.items():
        assert of_fit[name].u == pytest.approx(np.std(values), rel=0.06), name
    for q in of_fit.values():
        assert 0 < q.u < 0.05 * abs(q.value), q.name


@pytest.mark.parametrize(
    ("model", "why"),
    [
        ("lambert(rho=0.3)", "no model of light below the surface"),
        ("dipole(albedo=0.5, mfp=1)", "leave albedo out"),
        ("dipole(sigma_a=[1, 2])", "one each"),
    ],
)
def test_other_models_are_refused(exact, model, why):
    with pytest.raises(GonioError, match=why):
        fit_profile(exact, model)


def test_a_profile_fits_no_brdf_and_a_table_no_profile(exact):
    with pytest.raises(GonioError, match="BSSRDF"):
        gonio.fit(gonio.measure("grey_card", scan="in-plane"), "dipole")


def dipole_by_hand(r, absorption, scattering):
    """Jensen et al. 2001, eq. 4, of a matched index, where A = 1."""
    extinction = absorption + scattering
    sigma, total = np.sqrt(3 * absorption * extinction), 0.0
    for z in (1 / extinction, (1 + 4 / 3) / extinction):
        d = np.hypot(r, z)
        total = total + z * (1 + sigma * d) * np.exp(-sigma * d) / d**3
    return scattering / extinction / (4 * np.pi) * total


def profile_of(r, value, u):
    """A profile that point spots read."""
    columns = [np.asarray(a, float)[:, None] for a in (value, u)]
    flag = np.zeros((len(r), 1), np.uint8)
    return Profile(np.asarray(r, float), *columns, flag, Channels.grey())


@pytest.mark.parametrize("stated", [True, False])
def test_intervals_hold_hardly_absorbing_materials(stated):
    """The bound of no absorption is active in many draws: its interval and that of the scattering hold the truth."""
    truth, held, number = {"sigma_a": 2e-3, "sigma_s": 1.2}, 0, 24
    r = np.geomspace(0.1, 1.5, 8) if stated else np.geomspace(0.2, 12, 8)
    exact = dipole_by_hand(r, *truth.values())
    sd = 0.01 * exact if stated else np.full(8, 0.003 * exact.max())
    rng, bounds = np.random.default_rng(5), 0
    for _ in range(number):
        profile = profile_of(r, exact + sd * rng.standard_normal(8), sd if stated else np.full(8, np.nan))
        free = numbers(fit_profile(profile, "dipole(eta=1)"))
        bounds += free["sigma_a"].status == "at lower bound"
        inside = [p.interval95[0] <= truth[n] <= p.interval95[1] for n, p in free.items()]
        held += sum(inside)
    assert bounds > 3 and held >= 2 * number - 5


def test_where_the_slope_is_by_the_root_of_the_absorption():
    """Normalised diffusion near α' = 1, where its total falls with √σa: what fits without absorption allows some."""
    material = "normalised_diffusion(sigma_a=0.005, sigma_s=0.4)"
    profile = measure_profile(material, gonio.Instrument(), np.geomspace(0.3, 10, 6))
    sd, rng = 0.01 * profile.value.max(), np.random.default_rng(2)
    for _ in range(4):
        noisy = profile.value + sd * rng.standard_normal(profile.value.shape)
        read = dataclasses.replace(profile, value=noisy, u=np.full(noisy.shape, sd))
        free = numbers(fit_profile(read, "normalised_diffusion(eta=1)"))
        assert free["sigma_a"].interval95[0] <= 0.005 <= free["sigma_a"].interval95[1]
        assert free["sigma_s"].interval95[0] <= 0.4 <= free["sigma_s"].interval95[1]


def test_two_readings_of_two_numbers_test_nothing():
    r = np.array([0.5, 4.0])
    exact = dipole_by_hand(r, 0.05, 1.0)
    fit = fit_profile(profile_of(r, 1.05 * exact, 0.01 * exact), "dipole(eta=1)")
    assert fit.judgement.verdict == "fair" and "as many free numbers as readings" in fit.judgement.sentence
    assert any(row["name"] == "gain" for row in fit.common_errors) and "rounding" not in fit.judgement.sentence

"""Pages about light below a surface: a profile with its fit, a translucent material, and what is refused."""

import json

import numpy as np
import pytest

import gonio
from gonio.instrument.offsets_scan import measure_profile, spot_means
from gonio.models.errors import GonioError
from gonio.models.subsurface.spots import kept_share
from support.undrawn import undrawn

MATERIAL = "dipole(sigma_a=0.02, sigma_s=1.5, eta=1.3)"
SPOTS = {"illuminated_radius": 0.5, "viewed_radius": 0.3}
OFFSETS = [-6.0, -2.0, -0.5, 0.0, 0.5, 2.0, 6.0, 12.0]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with a profile as HDF5 and CSV, and a fit of it."""
    folder = tmp_path_factory.mktemp("profiles")
    profile = measure_profile(
        MATERIAL, gonio.Instrument(photons=1e7, **SPOTS), OFFSETS, seed=1, output=folder / "p.h5"
    )  # fmt: skip
    measure_profile(MATERIAL, gonio.Instrument(photons=1e7, **SPOTS), OFFSETS, seed=1, output=folder / "p.csv")
    gonio.fit_profile(profile, "dipole(eta=1.3)").save(folder / "fit.toml")
    return folder


@pytest.fixture(scope="module")
def page(files):
    path = gonio.report([files / "p.h5", files / "fit.toml"], files / "p.html")
    return path.read_text(), json.loads(path.with_suffix(".json").read_text())["subjects"]


def test_the_page_of_a_profile_has_certificate_fit_and_pictures(page):
    text, (subject,) = page
    assert subject["kind"] == "profile" and subject["certificate"]["overall"] == "pass"
    (fit,) = subject["fits"]
    statuses = {p["name"]: p["status"] for p in fit["parameters"]}
    assert statuses == {"dipole.sigma_a": "determined", "dipole.sigma_s": "determined", "dipole.eta": "fixed"}
    assert [f["id"].partition("-1-")[2] for f in subject["figures"]] == ["profile", "profile-residuals-1", "edge-loss"]
    assert "Light below the surface" in text and "SHA-256" in text


def test_its_numbers_are_those_of_the_model_as_the_spots_read_it(page, files):
    _, (subject,) = page
    model = gonio.material(files / "fit.toml").brdf.bssrdf
    figures = {f["id"].partition("-1-")[2]: f["data"] for f in subject["figures"]}
    profile = gonio.open_profile(files / "p.h5")
    mean = spot_means(model, profile.offsets, *SPOTS.values())[0]
    residual = ((mean - profile.value) / profile.u)[:, 0]
    assert figures["profile-residuals-1"]["sets"][0]["residual"] == pytest.approx(residual, rel=1e-3)
    rows = [r for g in subject["quantities"]["groups"] for r in g["rows"] if r["name"] == "edge loss"]
    assert [r["value"] for r in rows] == pytest.approx(1 - kept_share(model, *SPOTS.values()).value, rel=1e-9)


def test_a_csv_keeps_the_name_by_which_its_fit_finds_it(files):
    subjects = [gonio.open_profile(files / "p.csv"), str(files / "fit.toml")]
    with undrawn():
        assert "model fitted" in gonio.report(subjects, check=False)


def test_a_translucent_material_shows_its_profile_too():
    values = gonio.report("dipole(sigma_a=[0.1, 1], sigma_s=1, eta=1.3)", check=False)
    assert "edge-loss" in values and "diffusion length" in values


def test_fits_of_another_kind_and_truths_are_refused(files, page):
    lambert = gonio.fit(gonio.measure("grey_card", scan="in-plane"), "lambert")
    with pytest.raises(GonioError, match="fit is of"):
        gonio.report(files / "p.h5", fits=[lambert])
    with pytest.raises(GonioError, match="and no table"):
        gonio.measure(files / "p.h5", scan="in-plane")


def test_what_has_no_positive_reading_or_no_distance_has_a_page(files):
    profile = gonio.open_profile(files / "p.h5")
    for offsets, value in (([0.0], [[0.1]]), ([0.0, 1.0], [[0.0], [-1e-9]])):
        few = gonio.Profile(
            np.array(offsets), np.array(value), np.zeros((len(offsets), 1)), np.zeros((len(offsets), 1), np.uint8),
            profile.channels, 0.5, 0.5,
        )  # fmt: skip
        with undrawn():
            assert "not testable" in gonio.report(few)

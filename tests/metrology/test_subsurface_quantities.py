"""Quantities of light below a surface: of a model by closed forms, of a profile by its readings, refusals."""

import dataclasses

import numpy as np
import pytest

import gonio
from gonio.instrument.offsets_scan import measure_profile
from gonio.metrology.profile_quantities import profile_quantities
from gonio.models.errors import GonioError

CHANNELS = "normalised_diffusion(sigma_a=[0.02, 0.2], sigma_s=1.5, eta=1.3)"
SIDE = np.geomspace(0.05, 60, 60)


def of(result, name, place=None):
    return np.array([q.value for q in result.quantities if q.name == name and place in (None, q.place)])


def test_lengths_totals_and_radii_of_a_model_by_their_closed_forms():
    made = gonio.quantities(CHANNELS, only=["subsurface"])
    absorption, scattering = np.array([0.02, 0.2]), 1.5
    assert of(made, "reduced albedo α′") == pytest.approx(scattering / (absorption + scattering), rel=1e-12)
    assert of(made, "diffusion length") == pytest.approx(1 / np.sqrt(3 * absorption * (absorption + scattering)))
    share = of(made, "∫∫R dA")
    s = (1.85 - share + 7 * np.abs(share - 0.8) ** 3) * (absorption + scattering)
    for part, name in ((0.5, "radius of 50 %"), (0.9, "radius of 90 %")):
        r = of(made, name)
        assert 1 - np.exp(-s * r) / 4 - 0.75 * np.exp(-s * r / 3) == pytest.approx(part, abs=1e-6)
    passed = 1 - (0.3 / 2.3) ** 2
    assert of(made, "total reflectance") == pytest.approx(share * passed**2, rel=1e-9)


def test_readings_alone_give_the_total_and_the_radii_within_their_bounds():
    profile = measure_profile(CHANNELS, offsets=np.concatenate([-SIDE, SIDE]))
    rows, undecided = profile_quantities(profile)
    truth = gonio.quantities(CHANNELS, only=["subsurface"])
    assert not undecided
    for name in ("total reflectance", "radius of 50 %", "radius of 90 %"):
        for q, true in zip([q for q in rows if q.name == name], of(truth, name), strict=True):
            assert abs(q.value - true) <= q.bound < (0.05 if q.unit == "1" else true), name


def test_what_few_readings_leave_open_is_undecided():
    profile = measure_profile(CHANNELS, offsets=[1.0, 2.0, 3.0])
    assert {u.name for u in gonio.quantities(profile).undecided} == {"radius of 50 %", "radius of 90 %"}
    two = dataclasses.replace(measure_profile(CHANNELS, offsets=[1.0, 2.0]))
    assert not gonio.quantities(two).quantities


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"budget": True}, "no budget"), ({"geometries": ["0:45"]}, "no geometries"),
        ({"fit": "lambert(rho=0.3)"}, "no model of light below"), ({"only": ["glos"]}, "no group"),
        ({"fit": "none.toml"}, "does not exist"),
    ],
)  # fmt: skip
def test_what_a_profile_has_not_is_refused(options, why):
    profile = measure_profile("marble", offsets=[1.0, 2.0, 4.0])
    with pytest.raises(GonioError, match=why):
        gonio.quantities(profile, **options)

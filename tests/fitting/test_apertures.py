"""Fits of readings that are averages over apertures."""

import dataclasses
import math

import numpy as np
import pytest

from gonio.data.table import Table
from gonio.fitting import fit
from gonio.fitting.apertures import half_angles_of, wide_notes
from gonio.instrument import Instrument, measure, scan
from gonio.models.errors import GonioError
from support.marks import thorough

MATERIAL = "lambert(rho=0.3) + 1*ggx(alpha=0.15, f0=0.04)"
MODEL = "lambert + ggx(f0=0.04)"
DEGREE = math.pi / 180


def measured(source_deg: float, detector_deg: float, photons: float | None = 1e7, seed: int = 3) -> Table:
    instrument = Instrument(
        source_half_angle=source_deg * DEGREE, detector_half_angle=detector_deg * DEGREE, photons=photons
    )
    return measure(MATERIAL, instrument, scan("isotropic", step=7.5 * DEGREE), seed=seed)


def alpha_of(result) -> tuple[float, float]:
    p = next(p for p in result.parameters if p.name == "ggx.alpha")
    return (p.value - 0.15) / p.standard_uncertainty, p.value


@pytest.mark.parametrize(("source", "detector"), [(0.0, 0.3), (0.0, 2.0), (0.5, 0.7)])
def test_a_fit_of_averages_is_unbiased_and_one_of_centres_says_how_far_it_is_off(source: float, detector: float):
    table = measured(source, detector)
    averaged, ignored = (fit(table, MODEL, starts=1, aperture=how) for how in ("average", "ignore"))
    off, right = alpha_of(averaged)
    _, wrong = alpha_of(ignored)
    assert abs(off) < 3 and abs(averaged.metrics["reduced_chi2"] - 1) < 0.1
    assert averaged.apertures and averaged.apertures["averaged"] and averaged.apertures["neglected"] < 0.4
    assert not any("centres" in note for note in averaged.notes)
    assert ignored.apertures and not ignored.apertures["averaged"]
    assert any("ggx" in note and "centres" in note for note in ignored.notes)
    assert averaged.apertures["at_the_centres"]["name"] == "ggx.alpha"
    assert averaged.apertures["at_the_centres"]["shift"] == pytest.approx(wrong - right, rel=1e-6)
    if detector < 1:
        assert ignored.apertures["at_the_centres"]["shift"] == pytest.approx(wrong - right, rel=0.1)
    assert "apertures" in averaged.to_dict()


def test_a_lobe_narrower_than_both_discs_is_fitted_without_bias():
    """By nodes of each disc with those of the other, it was 4 standard uncertainties off."""
    instrument = Instrument(source_half_angle=2 * DEGREE, detector_half_angle=2 * DEGREE, photons=1e7)
    table = measure("lambert(rho=0.3) + 1*ggx(alpha=0.03, f0=0.04)", instrument, scan("isotropic", step=9 * DEGREE))
    result = fit(table, MODEL, starts=1)
    p = next(p for p in result.parameters if p.name == "ggx.alpha")
    assert abs(p.value - 0.03) < 3 * p.standard_uncertainty
    assert result.apertures and result.apertures["neglected"] < 0.4 and not any("fine" in n for n in result.notes)


@pytest.mark.parametrize("options", [{"robust": "tukey"}, *thorough({"loss": "cbrt"}, {"relative_noise": 1e-3})])
def test_every_way_to_weigh_takes_averages(options: dict):
    """Readings without noise: whatever the weights, the numbers are the material's; at the centres they are not."""
    table = measured(0.0, 1.5, photons=None)
    values = [alpha_of(fit(table, MODEL, starts=1, aperture=how, **options))[1] for how in ("average", "ignore")]
    assert abs(values[0] - 0.15) < 1e-5 < 1e-4 < values[1] - 0.15


def test_without_apertures_nothing_changes_by_a_bit():
    table = measured(0.0, 0.0)
    points = dataclasses.replace(table, source_solid_angle=None, receiver_solid_angle=None)
    results = [fit(t, MODEL, starts=1, aperture=how) for t in (table, points) for how in ("average", "ignore")]
    assert all(r.apertures is None for r in results)
    for r in results[1:]:
        assert [p.value for p in r.parameters] == [p.value for p in results[0].parameters]
        assert r.cost == results[0].cost


def test_a_model_without_free_numbers_is_compared_as_readings_are():
    table = measured(0.0, 1.5)
    chi2 = [fit(table, MATERIAL, aperture=how).metrics["reduced_chi2"] for how in ("average", "ignore")]
    assert abs(chi2[0] - 1) < 0.1 and chi2[1] > 2


def test_the_model_selected_over_apertures_is_that_of_the_material():
    """At the centres, three lobes and a metal's Fresnel factor were selected."""
    selected = fit(measured(0.0, 1.0), starts=1)
    assert selected.requested == MODEL and abs(selected.metrics["reduced_chi2"] - 1) < 0.1


def test_half_angles_come_from_solid_angles_or_else_from_the_provenance():
    table = measured(0.5, 1.0, photons=None)
    np.testing.assert_allclose(half_angles_of(table), np.radians([0.5, 1.0]), rtol=1e-12)
    unstated = dataclasses.replace(table, source_solid_angle=None, receiver_solid_angle=None)
    np.testing.assert_allclose(half_angles_of(unstated), np.radians([0.5, 1.0]), rtol=1e-12)
    assert half_angles_of(dataclasses.replace(unstated, provenance={})) == (0.0, 0.0)
    assert half_angles_of(dataclasses.replace(table, receiver_solid_angle=2 * math.pi))[1] == 0.0


def test_an_aperture_that_is_not_averaged_over_is_said():
    table = Table.from_arrays([0.3, 0.6], [0.0, 0.0], [0.2, 0.4], [0.0, 1.0], [0.1, 0.1])
    for stated, known in ((60, False), (30, True), (10**400, None), (float("nan"), None), (-1, None), ("wide", None)):
        odd = dataclasses.replace(table, provenance={"instrument": {"detector_half_angle_deg": stated}})
        assert half_angles_of(odd)[1] == pytest.approx(math.radians(stated) if known else 0.0)
        assert bool(wide_notes(odd)) == (known is False)


def test_an_unknown_way_is_refused():
    with pytest.raises(GonioError, match="aperture 'centre'"):
        fit(MATERIAL, MODEL, aperture="centre")

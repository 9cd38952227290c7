"""Readings on the page: as readings, with their uncertainties; nothing is drawn of what was not measured."""

import dataclasses

import numpy as np
import pytest

import gonio
from gonio.data import layouts
from gonio.data.table import Channels, Table, whole_table_of_values
from gonio.reports.document import assemble
from gonio.reports.subject import assign_fits, fit_of, split_fits, subject_of
from support.fit_tables import table_of
from support.undrawn import undrawn

SIGNED = np.array([-60, -30, 0, 15, 25, 30, 35, 45, 60, 75.0])
F = 0.05 + np.exp(-(((SIGNED - 30) / 8) ** 2))
POLAR = np.radians(np.arange(0, 81, 10.0))


def few(**options):
    """Ten readings in the plane of incidence, as a list."""
    return Table.from_arrays(
        30, 0, np.abs(SIGNED), np.where(SIGNED > 0, 180.0, 0.0), F, 0.05 * F, degrees=True, name="few", **options
    )


def section(table, fits=(), certificates=False):
    """(values of a table's section, its figures by slug)."""
    s = subject_of(table, 0)
    assign_fits([s], [fit_of(f) for f in fits])
    if certificates:
        s.certificate = gonio.check(table)
    document = assemble([s], "t", None, [])
    values = document.values["subjects"][0]
    return values, {f["id"].removeprefix("subject-1-"): f for f in values["figures"]}


@pytest.mark.parametrize("grid", [False, True])
def test_readings_in_a_plane_are_points_with_bars_and_a_list(grid):
    t = few()
    if grid:
        layout = layouts.in_plane(np.radians([30.0]), np.radians(SIGNED))
        t = whole_table_of_values(layout, F[None], u_f=0.05 * F[None, :, None], name="few")
    values, figures = section(t)
    usual = {"polar-linear", "polar-log", "plane-linear", "plane-log", "readings-30", "map-scale"}
    assert set(figures) <= usual | {"scatter"}
    drawn = figures["plane-linear"]["data"]["readings"][0]
    np.testing.assert_allclose(drawn["theta_o_deg"], SIGNED)
    np.testing.assert_allclose(drawn["f_per_sr"], F, rtol=1e-5)
    np.testing.assert_allclose(drawn["u_f_per_sr"], 0.05 * F, rtol=1e-5)
    assert "standard uncertainties" in figures["plane-linear"]["caption"]
    rows = values["readings"]["rows"]
    assert len(rows) == 10 and sorted(r["f_per_sr"][0] for r in rows) == pytest.approx(sorted(F), rel=1e-5)
    assert "drawn" in values["notes"][0]


def test_scatter_is_drawn_with_its_law_where_f_falls():
    """Of an ABg surface A/(B + x^g), whose numbers come out; of a Lambertian there is nothing to see."""
    layout = layouts.in_plane(np.radians([10.0, 40.0]), np.radians(np.arange(-80, 81, 4.0)))
    _, figures = section(table_of("abg(a=0.01, b=0.001, g=1.8)", layout))
    data = figures["scatter"]["data"]
    assert [data["laws"][f"ABg {n}"] for n in "ABg"] == pytest.approx([0.01, 0.001, 1.8], rel=1e-3)
    assert [s["theta_i_deg"] for s in data["sets"]] == [10, 40] and "ABg" in figures["scatter"]["caption"]
    assert "scatter" not in section(table_of("lambert(rho=0.5)", layout))[1]


def test_readings_out_of_a_plane_stand_over_the_angle_that_varies():
    turn = np.arange(0, 181, 20.0)
    t = Table.from_arrays(45, 0, 20, turn, 0.1 + turn / 1000, degrees=True, name="cone")
    _, figures = section(t)
    assert figures["readings"]["data"]["angle"] == "delta_phi_deg"
    (drawn,) = figures["readings"]["data"]["sets"]
    np.testing.assert_allclose(drawn["angle_deg"], turn, atol=1e-4)
    assert not {"spheres", "slice-readings", "lobe"} & set(figures)


def test_spectra_of_few_directions_are_drawn_whole():
    wavelengths = np.arange(400, 801, 1.0)
    f = np.outer(np.linspace(0.1, 0.3, 10), 1 + np.sin(wavelengths / 50) / 2)
    t = Table.from_arrays(
        30, 0, np.abs(SIGNED), np.where(SIGNED > 0, 180.0, 0.0), f, degrees=True, wavelengths_nm=wavelengths, name="s"
    )
    values, figures = section(t)
    drawn = figures["spectra"]["data"]
    assert len(drawn["wavelengths_nm"]) == 401 and len(drawn["sets"]) == 7
    np.testing.assert_allclose(drawn["sets"][0]["f_per_sr"], f[0], rtol=1e-5)
    assert values["readings"]["all_channels"] == 401 and len(values["readings"]["channels"]) == 6


def test_pictures_of_a_grid_are_blank_beyond_it():
    t = table_of("lambert(rho=.3) + ggx(alpha=.4)", layouts.isotropic(POLAR, POLAR, np.radians(np.arange(0, 360, 20))))
    values, figures = section(t)
    shown = np.array(figures["slice-readings"]["data"]["f_per_sr"], float)
    angles = np.meshgrid(*(figures["slice-readings"]["data"][k] for k in ("theta_h_deg", "theta_d_deg")), indexing="ij")
    theta = np.degrees(np.arccos(np.cos(np.radians(angles[0])) * np.cos(np.radians(angles[1]))))
    assert np.isnan(shown[theta > 80.5]).all() and np.isfinite(shown[theta < 79.5]).all()
    assert "Blank: not read" in figures["slice-readings"]["caption"] and "blank" in values["notes"][0]
    assert values["readings"] is None


def test_spectra_are_in_colour_and_say_how():
    layout = layouts.isotropic(POLAR, POLAR, np.radians(np.arange(0, 360, 30)))
    t = table_of("lambert(rho=[.1,.2,.6,.9])", layout)
    for wavelengths, words in (((450.0, 530.0, 600.0, 680.0), "CIE 1931 2° observer, illuminant D65"),
                               ((900.0, 950.0, 1000.0, 1064.0), "as grey")):  # fmt: skip
        spectral = dataclasses.replace(t, channels=Channels.of_wavelengths(wavelengths))
        assert words in section(spectral)[1]["spheres"]["caption"]


def test_a_few_reciprocal_pairs_are_listed():
    theta_i, theta_o = np.meshgrid([0.0, 20.0, 40.0], [0.0, 20.0, 40.0], indexing="ij")
    f = 0.1 + theta_i / 1000
    t = Table.from_arrays(theta_i, 0, theta_o, 180, f, 0.01 * f, degrees=True, name="nine")
    values, _ = section(t, certificates=True)
    rows = values["pairs"]["rows"]
    assert len(rows) == 3
    for row in rows:
        a, b = row["f_per_sr"], row["exchanged_per_sr"]
        assert row["difference_percent"] == pytest.approx(200 * (a - b) / (a + b), rel=1e-3)
        assert row["difference_over_u"] == pytest.approx((a - b) / (0.01 * np.hypot(a, b)), rel=1e-3)
    t = Table.from_arrays([10, 50], 0, [50, 10], 180, [0.1, 0.11], degrees=True, name="two")
    (row,) = section(t, certificates=True)[0]["pairs"]["rows"]
    assert abs(row["difference_percent"]) == pytest.approx(200 * 0.01 / 0.21, rel=1e-3)
    assert row["difference_over_u"] is None and section(few(), certificates=True)[0]["pairs"] is None


@pytest.fixture(scope="module")
def fitted():
    layout = layouts.isotropic(POLAR, POLAR, np.radians(np.arange(0, 360, 20)))
    t = table_of("lambert(rho=.3) + .4*ggx(alpha=.4)", layout, noise=0.01, name="paint")
    t.u_f = 0.01 * np.nan_to_num(np.abs(t.f))
    return t, [gonio.fit(t, m, starts=1) for m in ("lambert + ggx", "lambert")]


@pytest.fixture(scope="module")
def both_fits(fitted):
    """The section of the table with both fits, and the page of it."""
    t, results = fitted
    with undrawn():
        return *section(t, results), gonio.report([t, *results], check=False)


def test_several_fits_of_a_table_stand_side_by_side(both_fits):
    values, figures, text = both_fits
    assert [f["asked"] for f in values["fits"]] == ["lambert + ggx", "lambert"]
    assert {"residuals-half", "residuals-half-2", "plane-log-2", "slice-model-2", "map-30-2"} <= set(figures)
    first, second = (
        np.array(figures[s]["data"]["median_percent"], float) for s in ("residuals-half", "residuals-half-2")
    )
    assert np.nanmedian(np.abs(first)) < 1 < 5 < np.nanmedian(np.abs(second))
    assert text.count("fit 2, lambert") > 3 and text.count('<h2 id="subject-') == 1


def test_one_sentence_says_whether_a_fit_is_good(both_fits):
    values, _, text = both_fits
    good, failed = (f["judgement"] for f in values["fits"])
    assert (
        good["verdict"] == "good"
        and good["sentence"].startswith("A good fit: it converged; ")
        and "(reduced χ²" in good["sentence"]
    )
    assert failed["verdict"] == "failed" and "times the stored uncertainties" in failed["sentence"]
    assert text.index(good["sentence"].split("(")[0]) < text.index("<h2 id=")


def test_a_fit_is_judged_by_its_numbers_not_by_what_its_file_says(fitted):
    t, (_, failed) = fitted
    fit = failed.material.meta["fit"] | {"judgement": {"verdict": "good", "sentence": "A good fit."}}
    claimed = dataclasses.replace(failed.material, meta={"fit": fit})
    values, _ = section(t, [claimed])
    assert values["fits"][0]["judgement"]["verdict"] == "failed"


def test_fitted_materials_of_other_tables_stay_subjects(fitted):
    t, results = fitted
    subjects, fits = split_fits([dataclasses.replace(t, name="other"), results[0], "lambert(rho=0.5)"])
    assert (len(subjects), len(fits)) == (3, 0)
    subjects, fits = split_fits([t, results[0], "lambert(rho=0.5)"])
    assert (len(subjects), len(fits)) == (2, 1)


def test_steps_of_a_long_page_are_told(monkeypatch):
    from gonio.reports import build

    lines = []
    monkeypatch.setattr(build, "SILENT", 0.0)
    with undrawn():
        gonio.report(["lambert(rho=0.5)", "lambert(rho=0.1)"], log=lines.append)
    assert len(lines) == 6
    assert lines[0].startswith("evaluating 1 of 2, lambert(rho=0.5)") and "drawing 2 of 2" in lines[-1]

"""Nuisance numbers: a fit finds the instrument's errors and is no longer off by them; what it cannot tell it keeps."""

import math

import numpy as np
import pytest

import gonio
from gonio.__main__ import main
from gonio.instrument import Instrument, measure
from gonio.instrument.scans import scan
from gonio.metrology.nuisance import fit_with_nuisance
from gonio.models.errors import GonioError

GRID = scan("isotropic", step=math.radians(15), theta_max=math.radians(75))
TRUTH, MODEL = "lambert(rho=0.3) + 0.5 * ggx(alpha=0.3)", "lambert + ggx"
ANGLES = ("tilt_x", "tilt_y", "theta_i", "theta_o", "phi")


@pytest.fixture(scope="module")
def table():
    instrument = Instrument(photons=1e8, misalignment=math.radians(0.2), calibration=0.01)
    return measure(TRUTH, instrument, GRID, seed=4)


@pytest.fixture(scope="module")
def fitted(table):
    return gonio.fit(table, MODEL, nuisance=[*ANGLES, "gain"])


def test_the_errors_of_the_instrument_come_out_with_their_uncertainties(table, fitted):
    true = table.provenance["systematic"]
    for row in fitted.nuisance[:5]:
        z = (row["value"] - true[f"{row['name']}_deg"]) / row["standard_uncertainty"]
        assert abs(z) < 4 and row["standard_uncertainty"] < 0.3 * row["stated"] == pytest.approx(0.06), row


def test_the_numbers_are_no_longer_off_by_them_and_the_gain_keeps_its_prior(fitted):
    numbers = {p.name: p for p in fitted.parameters}
    alpha, rho = numbers["ggx.alpha"], numbers["lambert.rho"]
    assert abs(alpha.value - 0.3) < 4 * alpha.standard_uncertainty < 1e-3
    gain = fitted.nuisance[5]
    assert gain["standard_uncertainty"] == pytest.approx(gain["stated"], rel=1e-3) and abs(gain["value"]) < 0.02
    assert rho.standard_uncertainty == pytest.approx(0.01 * rho.value, rel=0.05)  # which the albedo cannot be told from
    assert fitted.metrics["reduced_chi2"] == pytest.approx(1, abs=0.2) and fitted.exit_status == 0
    assert np.sqrt(np.diagonal(fitted.covariance)) == pytest.approx(
        [p.standard_uncertainty for p in fitted.parameters if p.status != "fixed"]
    )


def test_what_cannot_be_held_or_weighed_is_refused(table):
    with pytest.raises(GonioError, match="nothing states the uncertainty of dark"):
        fit_with_nuisance(table, MODEL, ["dark"])
    with pytest.raises(GonioError, match="did you mean 'tilt'"):
        fit_with_nuisance(table, MODEL, ["titl"])
    with pytest.raises(GonioError, match="table with uncertainties"):
        fit_with_nuisance(measure(TRUTH, Instrument(), GRID), MODEL, ["gain"], uncertainty={"gain": "1 %"})
    with pytest.raises(GonioError, match="give nuisance too"):
        gonio.fit(table, MODEL, uncertainty={"gain": "1 %"})
    with pytest.raises(GonioError, match="at most one model"):
        gonio.fit(table, MODEL, nuisance="tilt, gain", per_channel=True)
    with pytest.raises(TypeError, match="did you mean 'loss'"):
        gonio.fit(table, MODEL, los="log")


def test_the_command_line_writes_them_into_the_material(table, tmp_path, capsys):
    table.save(tmp_path / "t.h5")
    call = ["fit", str(tmp_path / "t.h5"), "-m", MODEL, "-o", str(tmp_path / "f.toml")]
    assert main([*call, "--nuisance", "tilt,theta_i,theta_o,phi,dark", "--uncertainty", "dark=0.01 %"]) == 0
    assert "dark signal" in capsys.readouterr().out
    assert [row["name"] for row in gonio.material(tmp_path / "f.toml").meta["fit"]["nuisance"]] == [*ANGLES, "dark"]
    for bad in (["--uncertainty", "gain=1 %"], ["--nuisance", "gain", "--per-channel"], ["--nuisance", "glare"]):
        assert main([*call, "--force", *bad]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_large_errors_come_out_as_they_are_however_little_was_known_of_them():
    """Exact readings of Lambert's laws on both sides, by hand: (1 + gain) f cosθi'/cosθi + dark/(π cosθi)."""
    theta_i, theta_o, phi = (a.ravel() for a in np.meshgrid(np.arange(0, 71, 10), [10, 50, 130, 170], [0, 90, 200]))
    f = np.where(theta_o < 90, 0.3, 0.4) / np.pi
    tilt, gain, dark = -0.4, 0.05, 0.008  # the normal is turned by the tilt about y, so that light along x comes from
    lit = [np.cos(np.radians(theta_i - turned)) for turned in (0, tilt)]
    reading = (1 + gain) * f * lit[1] / lit[0] + dark / (np.pi * lit[0])
    table = gonio.Table.from_arrays(theta_i, 0, theta_o, phi, reading, 1e-3 * f, degrees=True)
    stated = {"tilt": "0.5 deg", "gain": "5 %", "dark": "1 %"}
    result = gonio.fit(table, "lambert + lambert_transmission(tau=0.4)", nuisance=list(stated), uncertainty=stated)
    rows = {row["name"]: row for row in result.nuisance}
    for name, true in (("tilt_y", tilt), ("gain", 100 * gain), ("dark", 100 * dark)):
        row = rows[name]
        assert abs(row["value"] - true) < 0.2 * row["standard_uncertainty"] < 0.02 * row["stated"], row
    rho = next(p for p in result.parameters if p.name == "lambert.rho")
    assert abs(rho.value - 0.3) < 0.2 * rho.standard_uncertainty

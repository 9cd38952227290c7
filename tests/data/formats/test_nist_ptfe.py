"""NIST's PTFE file: its counts, its azimuth convention, its wavelengths."""

import numpy as np
import pytest

from gonio.data.formats.nist_ptfe import read_nist
from gonio.models.errors import GonioError
from support import helpers

HEAD = "lambda,thetai,phi,thetar,phir,f_r11,f_r12/f_r11\n"


def test_the_real_file_has_four_wavelengths_at_the_same_geometries():
    path = helpers.shared("data", "nist_ptfe", "PTFE.data.csv")
    table = read_nist(path)
    assert table.channels.wavelengths_nm == (351.0, 532.0, 633.0, 1064.0)
    assert table.layout.size == 1824 and table.counts()["valid"] == 7296
    red = read_nist(path, wavelength_nm=633)
    np.testing.assert_array_equal(red.f[:, 0], table.f[:, 2])
    lines = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=range(6))
    np.testing.assert_array_equal(red.f[:, 0], lines[lines[:, 0] == 0.633, 5])
    assert "phi_r - phi_i" in table.provenance["assumptions"][1]


def test_oblique_light_is_scattered_forward():
    table = read_nist(helpers.shared("data", "nist_ptfe", "PTFE.data.csv"))
    theta_i, phi_i, theta_o, phi_o = table.layout.angles()
    oblique = (theta_i > np.radians(59)) & (theta_o > np.radians(59))
    away = np.cos(phi_o - phi_i)
    forward, back = (table.f[oblique & (side > np.cos(0.5))].mean(0) for side in (-away, away))
    assert np.all(forward > 1.3 * back)


def test_the_convention_of_the_angles(tmp_path):
    (tmp_path / "p.csv").write_text(HEAD + "0.633,-30,0,30,0,0.3,0\n0.633,-30,10,40,130,0.4,0\n")
    table = read_nist(tmp_path / "p.csv")
    wi, wo = table.layout.directions()
    np.testing.assert_allclose([wi.x[0] + wo.x[0], wi.y[0] + wo.y[0], wi.z[0] - wo.z[0]], 0, atol=1e-15)
    theta_i, phi_i, theta_o, phi_o = np.degrees(table.layout.angles())
    np.testing.assert_allclose([theta_i[1], phi_i[1], theta_o[1], (phi_o - phi_i)[1] % 360], [30, 10, 40, 60])
    assert table.provenance["ignored_columns"] == ["f_r12/f_r11"]


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        (HEAD + "0.633,-30,0,30,0,0.3,0\n", {"wavelength_nm": 500}, "choose one of 633 nm"),
        (HEAD + "0.633,-30,0,30,0,0.3,0\n0.5,-30,0,31,0,0.3,0\n", {}, "choose one with wavelength_nm"),
        (HEAD + "0.633,-30,0,30,0,x,0\n", {}, "line 2: f_r11 is 'x'"),
        (HEAD + "0.633,-30,0,95,0,0.3,0\n", {}, "line 2: thetar = 95"),
        ("lambda,thetai\n1,2\n", {}, "no NIST PTFE file"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, text, options, said):
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(GonioError, match=said):
        read_nist(tmp_path / "p.csv", **options)

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
    assert table.provenance["understood"] == ["theta_i is negative: the mirror side is phi_r = phi_i"]


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


def rows_of(theta_i, mirror, seed=0, count=60, forward=1.0):
    """Oblique readings of a surface that scatters forward; phi_r - phi_i is `mirror` on the mirror side."""
    rng = np.random.default_rng(seed)
    polar, phi_i, difference = rng.uniform(55, 75, (2, count)), rng.uniform(0, 360, count), rng.uniform(0, 360, count)
    f = 0.3 + 0.1 * forward * np.cos(np.radians(difference - mirror))
    signed = np.sign(theta_i(rng, count)) * polar[0]
    columns = np.stack([np.full(count, 0.532), signed, phi_i, polar[1], phi_i + difference, f, 0 * f], -1)
    return "".join(",".join(f"{x:.6f}" for x in row) + "\n" for row in columns)


def forward_over_back(table):
    _, phi_i, _, phi_o = table.layout.angles()
    f, away = table.f[:, 0], np.cos(phi_o - phi_i)
    return f[away < -0.7].mean() / f[away > 0.7].mean()


@pytest.mark.parametrize(
    ("theta_i", "mirror", "told"),
    [
        (lambda _, n: -np.ones(n), 0, "negative"),
        (lambda _, n: np.ones(n), 180, "positive"),
        (lambda rng, n: rng.choice([-1, 1], n), 0, "both signs"),
        (lambda rng, n: rng.choice([-1, 1], n), 180, "both signs"),
    ],
)
def test_the_sign_of_theta_i_tells_the_mirror_side(tmp_path, theta_i, mirror, told):
    (tmp_path / "p.csv").write_text(HEAD + rows_of(theta_i, mirror))
    table = read_nist(tmp_path / "p.csv")
    assert forward_over_back(table) > 1.3 and told in table.provenance["understood"][0]
    assert "warnings" not in table.provenance


def test_readings_that_speak_against_the_sign_are_told(tmp_path):
    (tmp_path / "p.csv").write_text(HEAD + rows_of(lambda _, n: np.ones(n), 0))
    assert "sign of theta_i" in read_nist(tmp_path / "p.csv").provenance["warnings"][0]


def test_two_signs_and_no_lobe_are_asked(tmp_path):
    (tmp_path / "p.csv").write_text(HEAD + rows_of(lambda rng, n: rng.choice([-1, 1], n), 0, forward=0.0))
    with pytest.raises(GonioError, match="both signs"):
        read_nist(tmp_path / "p.csv")


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

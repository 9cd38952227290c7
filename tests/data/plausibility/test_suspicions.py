"""Numbers that speak against what they are taken for are told; honest ones are not."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.formats.csv.table_file import read_csv, write_csv
from gonio.data.plausibility.suspicions import suspicions
from gonio.data.table import whole_table_of_values

GRID = layouts.isotropic(np.radians([0, 20, 40, 60]), np.radians(np.r_[0:85:10]), np.radians(np.r_[0:360:30]))
THETA_I, PHI_I, THETA_O, PHI_O = GRID.angles()


def lobe(width, diffuse, gloss, back=False):
    """A reciprocal surface: a diffuser and a lobe about the mirror direction, or back to the light."""
    x, y = np.sin(THETA_I) + np.sin(THETA_O) * np.cos(PHI_O), np.sin(THETA_O) * np.sin(PHI_O)
    x = x - 2 * np.sin(THETA_I) if back else x
    return diffuse / np.pi + gloss / (np.pi * width**2) * np.exp(-(x**2 + y**2) / width**2)


HONEST = {
    "diffuse white": lobe(0.3, 1.0, 0.0),
    "glossy": lobe(0.1, 0.3, 0.5),
    "black with a lobe": lobe(0.2, 0.01, 0.8),
    "metal": lobe(0.05, 0.0, 0.9),
}


def of(f, grid=GRID):
    return suspicions(whole_table_of_values(grid, f), True, True)


@pytest.mark.parametrize("f", HONEST.values(), ids=HONEST)
def test_honest_tables_are_not_suspected(f):
    noisy = f * (1 + 0.05 * np.random.default_rng(0).standard_normal(f.shape))
    assert of(f) == of(noisy) == []


@pytest.mark.parametrize("f", [f for name, f in HONEST.items() if name != "metal"])
def test_values_with_a_cosine_are_suspected_by_exchanged_pairs(f):
    assert "--quantity brdf_cos," in of(f * np.cos(THETA_O))[0]
    assert "--quantity brdf_cos_i," in of(f * np.cos(THETA_I))[0]


@pytest.mark.parametrize("reflectance", [0.99, 0.6])
def test_reflectance_factors_return_more_than_came(reflectance):
    assert "reflectance_factor" in of(np.pi * lobe(0.3, reflectance, 0.0))[0]
    plane = layouts.in_plane(np.radians([0, 30]), np.radians(np.r_[-80:81:10]))
    assert "reflectance_factor" in of(np.full(plane.shape, reflectance), plane)[0]


def test_small_angles_are_suspected_to_be_radians_once():
    small = layouts.isotropic(*(np.radians(np.degrees(a) / 57.3) for a in GRID.axes.values()))
    (sentence,) = of(np.full(small.shape, 0.1), small)
    assert "--angles radians" in sentence
    assert suspicions(whole_table_of_values(small, np.full(small.shape, 0.1))) == []


@pytest.mark.parametrize("azimuths", [[0, 180], range(0, 360, 30)], ids=["in plane", "around"])
def test_azimuths_in_radians_beside_polar_angles_in_degrees_are_suspected(azimuths):
    polar, turn = np.radians([10, 30, 60]), np.radians(np.asarray(azimuths, float))
    honest, wrong = (layouts.isotropic(polar, polar, a) for a in (turn, np.radians(turn)))
    assert "write [rad]" in of(np.full(wrong.shape, 0.1), wrong)[0]
    assert of(np.full(honest.shape, 0.1), honest) == suspicions(
        whole_table_of_values(wrong, 0.1 * np.ones(wrong.shape))
    )


def test_a_file_that_ends_within_a_number_is_told(tmp_path):
    rows = [f"30,0,{theta},180,{0.1 + theta / 700:.9f}" for theta in range(10)]
    text = "\n".join(["theta_i,phi_i,theta_o,phi_o,f", *rows])
    warnings = {}
    for name, content in {"whole": text, "ended": text[:-6] + "\n", "cut": text[:-6]}.items():
        (tmp_path / "t.csv").write_text(content)
        warnings[name] = read_csv(tmp_path / "t.csv").provenance.get("warnings", [])
    assert "cut off" in warnings["cut"][0] and warnings["whole"] == warnings["ended"] == []


def test_the_dark_has_no_brightest_direction():
    """Neither zeros nor noise about zero go back to the light: directions at random, few of them near either mirror."""
    rng = np.random.default_rng(7)
    for _ in range(20):
        polar, azimuths = rng.uniform(0, 1.4, (2, 150)), rng.uniform(0, 2 * np.pi, (2, 150))
        somewhere = layouts.scattered(polar[0], azimuths[0], polar[1], azimuths[1])
        for f in (np.zeros(150), rng.normal(0, 1e-5, 150)):
            assert suspicions(whole_table_of_values(somewhere, f)) == []


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_peak_that_is_cut_off_is_told_and_a_rounded_one_is_not(noise):
    f = lobe(0.5, 0.01, 0.8) * (1 + noise * np.random.default_rng(3).standard_normal(GRID.shape).ravel())
    assert "saturated" in of(np.minimum(f, np.quantile(f, 0.9)))[0]
    rounded = [float(f"{value:.1e}") for value in f]
    assert of(np.array(rounded)) == of(np.round(f, 2)) == []


def test_light_that_comes_back_is_told():
    assert "off by 180" in of(lobe(0.2, 0.1, 0.5, back=True))[0]


def test_what_the_file_or_the_caller_says_is_not_suspected(tmp_path):
    table = whole_table_of_values(GRID, np.ones(GRID.shape))
    write_csv(tmp_path / "t.csv", table)
    assert "warnings" not in read_csv(tmp_path / "t.csv").provenance
    lines = (tmp_path / "t.csv").read_text().splitlines()
    (tmp_path / "u.csv").write_text("\n".join(line for line in lines if line[0] != "#"))
    assert "reflectance_factor" in read_csv(tmp_path / "u.csv").provenance["warnings"][0]
    assert "warnings" not in read_csv(tmp_path / "u.csv", quantity="brdf").provenance

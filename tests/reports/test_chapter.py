"""The chapter as experiments: each against the textbook, numbers that may be changed, bad ones refused."""

import math

import numpy as np
import pytest

import gonio
from gonio.__main__ import main
from gonio.figures.disc import at_wavelengths, lit_disc
from gonio.models.errors import GonioError
from gonio.reports.chapter import light, surface
from gonio.reports.chapter.experiment import AGREES, DIFFERS, Result
from gonio.reports.chapter.numbers import Numbers, assigned, numbers_of, read_numbers


def test_the_whole_chapter_is_one_page_whose_results_agree(tmp_path, capsys):
    """All eleven experiments, by the command of a student who changes numbers and, to compile less, surfaces."""
    page = tmp_path / "page.html"
    changes = ("theta_i=60", "rays=2e4", "material=lambert(rho=0.3)", "interface=thin_sheet(rho=0.3, tau=0.4)")
    words = [word for change in changes for word in ("--set", change)] + ["-o", str(page)]
    assert main(["demo", "chapter", *words]) == 0
    out, text = capsys.readouterr().out, page.read_text()
    assert out.count("differs") == 1 and "minnaert" in out  # the liar alone
    assert out.count("agrees") > 12 and "Done in" in out
    assert all(f"figure 12.{k}" in text for k in range(1, 7)) and "follow the chapter's order of subjects" in text
    assert "(changed)" in text and 'src="data:image/png' in text
    for name in ("patch_tilt", "disc_theta_i", "absorption"):
        assert f'id="number-{name}"' in text
    assert "http" not in text.replace("http-equiv", "")
    assert main(["demo", "chapter", "-o", str(page)]) == 2 and "exists" in capsys.readouterr().err


def test_light_alone_for_other_numbers():
    n = Numbers(rays=20_000, patch_tilt=70, patch_distance=0.3, cap=80, aperture=0.5, seed=4)
    for experiment in (light.patch(n), light.detector(n), light.two_apertures(n)):
        assert {r.verdict for r in experiment.results} - {""} == {AGREES}


def test_the_ratio_depends_on_the_lamp_and_the_slope_does_not():
    results = surface.differentials(Numbers(ambient=2, material="lambert(rho=0.5)", photons=1e8)).results
    weak, full, slope = (r.value for r in results)
    assert weak > 10 * full > 10 * slope
    assert slope == pytest.approx(0.5 / math.pi, abs=results[-1].error)


def test_hours_grow_with_the_cube_of_the_step():
    few, many = (surface.hours(Numbers(step=s)).results[0].value for s in (10.0, 5.0))
    assert many / few == pytest.approx(8, rel=0.01)


def test_a_result_is_shown_at_the_digits_of_its_error():
    r = Result("x", 1.23456789, 0.002, "1", 1.3)
    assert r.texts == ("1.2346", "0.002", "1.3") and r.verdict == DIFFERS
    assert Result("x", 3.0, math.inf, "1").texts[1] == "no bound"


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"theta": 3}, "no number 'theta'"),
        ({"theta_i": 95}, "from 0 to 89"),
        ({"theta_i": math.nan}, "give a number"),
        ({"photons": True}, "give a number"),
        ({"material": 3}, "give a material"),
    ],
)
def test_bad_numbers_are_refused(changes, complaint):
    with pytest.raises(GonioError, match=complaint):
        numbers_of(changes)


def test_bad_words_files_and_pages_are_refused(tmp_path, capsys):
    for words in (["theta_i"], ["theta_i=ten"]):
        with pytest.raises(GonioError):
            assigned(words)
    file = tmp_path / "n.toml"
    file.write_text("gonio_chapter = 1\ntheta_i = 45\nmaterial = 'gold'\n")
    assert read_numbers(file) == {"theta_i": 45, "material": "gold"}
    file.write_text("gonio_chapter = 1\ntheta = 45\n")
    assert main(["demo", "chapter", "--numbers", str(file), "-o", str(tmp_path / "a.html")]) == 2
    assert main(["demo", "chapter", "-o", str(tmp_path / "a.txt")]) == 2
    assert main(["demo", "--set", "theta_i=3"]) == 2
    errors = capsys.readouterr().err
    assert "theta" in errors and ".html" in errors and "gonio demo chapter" in errors
    assert sorted(p.name for p in tmp_path.iterdir()) == ["n.toml"]


def test_a_disc_is_dark_but_for_its_mirror_image_and_rainbows():
    disc = gonio.material("compact_disc")
    lit = lit_disc(disc, side=48)
    rgb = lit.rgba[..., :3].astype(int)
    inside = lit.rgba[..., 3] > 0
    colourful = inside & (np.ptp(rgb, axis=-1) > 60)
    assert 0.02 < colourful.sum() / inside.sum() < 0.3 and (rgb[inside].max(axis=-1) < 20).mean() > 0.5
    # What is left of the middle and right of it are mirror images, as lamp and eye stand in the middle.
    np.testing.assert_allclose(rgb, rgb[:, ::-1], atol=1)
    with pytest.raises(GonioError, match="below the disc"):
        lit_disc(disc, lamp=(0, 0, -1))
    with pytest.raises(GonioError, match="no wavelengths"):
        lit_disc(gonio.material("lambert(rho=0.5)"))


def test_a_spectrum_between_its_wavelengths():
    gold = gonio.material("gold")
    model = at_wavelengths(gold, np.array([450.9, 500.0]))
    assert float(model.eta[0]) == 1.38 and 0.43 < float(model.eta[1]) < 1.04
    disc = at_wavelengths(gonio.material("compact_disc"), np.array([390.0, 800.0]))
    np.testing.assert_allclose(disc.wavelength, [0.39, 0.8], rtol=1e-12)

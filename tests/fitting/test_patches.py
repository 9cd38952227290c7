"""Fits of files whose values are means over patches of directions, beside the models that the files were made of."""

import numpy as np
import pytest

import gonio
from gonio.data import write
from support.fit_tables import free, values


@pytest.mark.parametrize(
    ("truth", "model", "expected"),
    [
        ("0.5*lambert(rho=0.6) + 0.4*ggx(alpha=0.25, f0=1)", "lambert + ggx", (0.3, 0.25, 0.4)),
        (
            "thin_sheet(rho=0.2, tau=0.1) + 0.4*transmitted(base=ggx(alpha=0.35, f0=0.9))",
            "thin_sheet + transmitted(base=ggx)",
            (0.2, 0.1, 0.35, 0.36),
        ),
    ],
)
def test_a_fit_of_means_over_patches_finds_what_they_are_means_of(tmp_path, truth, model, expected):
    """Each number within its uncertainty and the file's own error, about .4 %; at the middles they are far off."""
    write(tmp_path / "sheet.xml", gonio.material(truth), basis="quarter")
    result = gonio.fit(tmp_path / "sheet.xml", model)
    u = np.array([p.standard_uncertainty for p in free(result).values()])
    numbers, expected = values(result), np.array(expected)
    assert (np.abs(numbers - expected) < 4 * u + 0.008 * expected).all() and (u < 0.03 * expected).all()
    assert any("averaged over the patches" in note for note in result.notes)
    middles = gonio.fit(tmp_path / "sheet.xml", model, aperture="ignore")
    assert any("compared at their middles" in note for note in middles.notes)
    assert np.max(np.abs(values(middles) / expected - 1)) > 0.2


def test_a_fit_for_a_scene_says_that_it_compares_at_the_middles(tmp_path):
    write(tmp_path / "sheet.xml", gonio.material("lambert(rho=0.3)"), basis="quarter")
    result = gonio.fit(tmp_path / "sheet.xml", "lambert", scene="low_sun_car")
    assert any("compared at their middles" in note for note in result.notes)


def test_a_lobe_too_narrow_for_its_patches_is_said_and_its_uncertainties_hold_the_truth(tmp_path):
    write(tmp_path / "sheet.xml", gonio.material("0.5*lambert(rho=0.6) + 0.4*ggx(alpha=0.01, f0=1)"), basis="quarter")
    result = gonio.fit(tmp_path / "sheet.xml", "lambert + ggx")
    alpha = next(p for p in result.parameters if p.name == "ggx.alpha")
    assert any("patches" in note for note in result.notes)
    assert alpha.status == "undetermined" or abs(alpha.value - 0.01) < 4 * alpha.standard_uncertainty


@pytest.mark.thorough
def test_a_model_is_selected_on_means_brought_to_the_middles_of_their_patches(tmp_path):
    """Left there, they ask for lobes that the surface does not have."""
    write(tmp_path / "sheet.xml", gonio.material("0.5*lambert(rho=0.6) + 0.4*ggx(alpha=0.2, f0=1)"))
    result = gonio.fit(tmp_path / "sheet.xml")
    assert result.requested == "lambert + ggx" and result.metrics["relative_rms"] < 0.05

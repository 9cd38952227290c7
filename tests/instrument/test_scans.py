"""Scans by name: the right grids, and a sentence for what cannot be."""

import math

import numpy as np
import pytest

from gonio.data import layouts
from gonio.instrument import scans
from gonio.models.errors import GonioError


def test_the_default_isotropic_scan_reaches_85_degrees_and_closes_in_azimuth():
    grid = scans.scan("isotropic")
    assert grid.shape == (18, 18, 72)
    assert grid.axes["theta_i"][-1] == pytest.approx(math.radians(85), abs=1e-12)
    assert math.pi in grid.axes["delta_phi"] or np.abs(grid.axes["delta_phi"] - math.pi).min() < 1e-12
    assert grid.axes["delta_phi"][-1] == pytest.approx(math.radians(355))
    assert grid.readable().all()


def test_options_change_the_grids():
    assert scans.scan("spherical", step=math.radians(30), theta_max=math.radians(60)).shape == (3, 12, 3, 12)
    grid = scans.scan("isotropic", step=math.radians(20), phi_step=math.radians(90), theta_max=math.radians(89))
    np.testing.assert_allclose(np.degrees(grid.axes["theta_o"]), [0, 20, 40, 60, 80], atol=1e-12)
    assert grid.axes["delta_phi"].size == 4
    grid = scans.scan("in_plane", theta_i=[1.0, 0.5], step=math.radians(5))
    assert grid.axes["theta_i"].tolist() == [0.5, 1.0] and grid.shape == (2, 35)
    np.testing.assert_allclose(grid.axes["theta_o"], -grid.axes["theta_o"][::-1], atol=1e-15)


@pytest.mark.parametrize(("name", "turned"), [("isotropic", 1), ("spherical", 15)])
def test_scans_that_leave_mirror_directions_out_say_so(name, turned):
    """An odd number of azimuths has none across from each; normal incidence needs none."""
    for phi_step, left_out in ((24, True), (36, False), (90, False)):
        grid = scans.scan(name, step=math.radians(30), phi_step=math.radians(phi_step))
        remark = scans.mirror_remark(grid)
        assert (remark is not None) == left_out
        assert remark is None or f"the mirror direction of {2 * turned} of {2 * turned} incidences" in remark
    for whole in ("merl", "half-difference", "in-plane"):
        assert scans.mirror_remark(scans.scan(whole)) is None


def test_half_difference_scans_are_merls_grid_with_other_counts():
    assert scans.scan("merl") == layouts.merl()
    assert scans.scan("half-difference", step=math.radians(1)) == layouts.merl()
    assert scans.scan("half-difference").shape == (18, 18, 36)
    turned = scans.scan("half_difference", step=math.radians(15), phi_step=math.radians(60))
    assert turned.dims == ("theta_h", "theta_d", "phi_d", "phi_h") and turned.shape == (6, 6, 12, 6)


def test_scans_of_the_other_hemisphere_mirror_the_usual_one_and_leave_out_the_horizon():
    for name in ("isotropic", "in-plane", "spherical"):
        usual = scans.scan(name, step=math.radians(15))
        for hemisphere, lit, sides in (
            ("reflection", "back", {(-1, -1)}),
            ("transmission", None, {(1, -1)}),
            ("transmission", "back", {(-1, 1)}),
            ("both", None, {(1, 1), (1, -1)}),
            ("both", "both", {(1, 1), (1, -1), (-1, 1), (-1, -1)}),
        ):
            grid = scans.scan(name, step=math.radians(15), hemisphere=hemisphere, lit=lit)
            assert grid.sides == sides and grid.readable().all()
            assert np.abs(grid.cosines()).min() > math.cos(math.radians(85.01))
            for pair in sides:
                part, _ = grid.folded(*pair)
                for of_part, of_usual in zip(part.axes.values(), usual.axes.values(), strict=True):
                    np.testing.assert_allclose(of_part, of_usual, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("isotropc", {}, "unknown; give isotropic"),
        ("merl", {"step": 0.1}, "scan merl has no step; its directions are fixed"),
        ("half-difference", {"theta_max": 1.0}, "has no theta_max; it takes step, phi_step"),
        ("isotropic", {"step": math.radians(7)}, "does not divide 360°; give one that does, such as 7.05882°"),
        ("isotropic", {"step": -1.0}, "above 0"),
        ("isotropic", {"step": math.nan}, "above 0"),
        ("isotropic", {"step": 0.0}, "above 0"),
        ("isotropic", {"theta_max": 2.0}, r"theta_max is 114.592° \(2 rad\); .* π/2 rad \(90°\)"),
        ("spherical", {"step": math.radians(0.05)}, "more than 2.15e\\+09; give a larger step"),
        ("in-plane", {"theta_i": [7.0]}, "theta_i"),
        ("in-plane", {"theta_i": []}, "theta_i"),
        ("merl", {"hemisphere": "both"}, "half vectors hold reflection from the front alone; give isotropic"),
        ("isotropic", {"hemisphere": "down"}, "hemisphere is 'down'; give reflection, transmission or both"),
        ("isotropic", {"lit": "both"}, "lit from both sides reads both hemispheres"),
    ],
)
def test_what_cannot_be_scanned_is_refused_in_a_sentence(name, options, message):
    with pytest.raises(GonioError, match=message) as error:
        scans.scan(name, **options)
    assert "\n" not in str(error.value)


def test_a_list_of_directions_is_a_scan(tmp_path):
    path = tmp_path / "directions.csv"
    path.write_text("theta_i,phi_i,theta_o,phi_o\n10,20,30,200\n0,0,60,359\n45,180,45,0\n")
    grid = scans.scan(path)
    assert grid.name == "scattered" and grid.size == 3
    expected = np.radians([[10, 0, 45], [20, 0, 180], [30, 60, 45], [200, 359, 0]])
    np.testing.assert_allclose([*grid.axes.values()], expected, atol=1e-14)
    with pytest.raises(GonioError, match="fixed"):
        scans.scan(path, step=0.1)

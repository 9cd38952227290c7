"""What quantities say of readings in one plane, and of a fit of them: how further, and what U does not hold."""

import numpy as np
import pytest

import gonio
from gonio.data import layouts
from gonio.data.table import Table, whole_table_of_values

ANGLES = np.arange(0.0, 85.0, 5.0)


@pytest.fixture(scope="module")
def plane():
    f = gonio.material("lambert(rho=0.4)").f(45, 0, ANGLES, 180, degrees=True)
    f = f * (1 + 0.002 * np.random.default_rng(3).standard_normal(f.shape))
    return Table.from_arrays(45, 0, ANGLES, 180, f, u_f=0.002 * f, degrees=True, name="tile")


def test_readings_in_a_plane_say_that_a_fit_reaches_further(plane):
    made = gonio.quantities(plane)
    assert {"albedo", "gloss 60°"} <= {u.name for u in made.undecided}
    assert any("gonio fit TABLE" in note for note in made.notes)
    assert not any("gonio fit TABLE" in note for note in gonio.quantities(plane, only=["multi-angle"]).notes)


def test_what_the_fit_reaches_says_that_a_calibration_is_not_in_it(plane):
    fitted = gonio.fit(plane, "lambert")
    made = gonio.quantities(fitted)
    r8 = next(q for q in made.quantities if q.name == "8°:di")
    assert abs(r8.value - 0.4) < 4 * r8.uncertainty and r8.uncertainty < 0.002 * 0.4  # smaller than any gain's
    assert any("calibration" in note and "--budget --fit" in note for note in made.notes)
    of_gain = gonio.quantities(plane, budget=True, fit=fitted, uncertainty={"gain": "0.5 %"})
    k = next(k for k, q in enumerate(of_gain.quantities) if q.name == "albedo of the fit")
    assert of_gain.budget.standard[k] == pytest.approx(0.005 * 0.4, rel=0.1)


def test_exact_models_have_no_such_remark():
    assert not any("calibration" in note for note in gonio.quantities("lambert(rho=0.4)", only=["albedo"]).notes)


def test_what_one_azimuth_of_the_light_does_not_show_is_told():
    brushed = gonio.material("lambert(rho=0.2) + ggx(alpha_x=0.4, alpha_y=0.15, f0=0.8)")
    turned = np.radians(50.0)
    for first, note in ((0, "the surface is not isotropic"), (20, "taken as its mirror image")):
        theta = np.radians(np.arange(first, 61, 20.0))
        layout = layouts.isotropic(theta, np.radians(np.arange(0, 86, 5.0)), np.radians(np.arange(0, 181, 15.0)))
        theta_i, phi_i, theta_o, phi_o = layout.angles()
        f = brushed.f(theta_i, phi_i + turned, theta_o, phi_o + turned).reshape(layout.shape)
        notes = gonio.quantities(whole_table_of_values(layout, f), only=["albedo"]).notes
        assert sum(note in n for n in notes) == 1

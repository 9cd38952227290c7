"""Readings that decide on energy: at the mirror directions that a table leaves out; and read there, they do decide."""

import numpy as np
import pytest

import gonio
from gonio.cli.program import main
from gonio.data import layouts
from gonio.models.errors import GonioError
from support.check_tables import degrees, model_table, property_of

INCIDENT = degrees(10, 61, 25)
LAYOUT = layouts.isotropic(INCIDENT, degrees(2.5, 88, 5), degrees(0, 360, 10))
SURFACE, MODEL = "lambert(rho=0.4) + 0.3 * ggx(alpha=0.2)", "lambert + ggx"
LIAR = "lambert(rho=0.4) + 0.9 * beckmann(alpha=0.002)"


@pytest.fixture(scope="module")
def table():
    return model_table(SURFACE, LAYOUT)


def energy(table, **options):
    return property_of("energy", table, **options)


def test_the_mirror_directions_that_were_left_out_are_planned_and_decide(table):
    plan = gonio.plan_energy(table, model=MODEL)
    theta_i, phi_i, theta_o, phi_o = plan.shots.angles
    np.testing.assert_allclose(np.sort(theta_i), INCIDENT, atol=1e-5)
    np.testing.assert_allclose(theta_o, theta_i, atol=1e-5)
    np.testing.assert_allclose(np.cos(phi_o - phi_i), -1, atol=1e-9)
    assert (plan.before.verdict, plan.after.verdict) == ("undecided", "pass")
    assert energy(table, model=MODEL).verdict == "undecided"
    read = gonio.measure(SURFACE, scan=plan.layout)
    judged = energy(table, further=read, model=MODEL)
    assert judged.verdict == "pass" and "narrower" not in judged.assumes
    assert abs(judged.bound - plan.after.bound) < 1e-3


def test_a_lobe_that_hid_there_is_not_passed():
    table = model_table(LIAR, LAYOUT)
    plan = gonio.plan_energy(table, model="lambert")
    assert plan.after.verdict == "pass"
    assert energy(table, further=gonio.measure(LIAR, scan=plan.layout), model="lambert").verdict != "pass"


def test_what_cannot_be_planned_is_refused_in_a_sentence(table, tmp_path, capsys):
    table.save(tmp_path / "t.h5")
    out = str(tmp_path / "path.csv")
    for wrong, words in (
        (["--budget", "1h", str(tmp_path / "t.h5")], "has no --budget"),
        ([], "needs the table"),
        ([SURFACE], "table"),
    ):
        assert main(["plan", *wrong, "--for", "energy", "-o", out]) == 2
        assert words in capsys.readouterr().err and not (tmp_path / "path.csv").exists()
    decided = layouts.isotropic(INCIDENT, degrees(0, 89, 5), LAYOUT.axes["delta_phi"])
    with pytest.raises(GonioError, match="is decided"):
        gonio.plan_energy(model_table("lambert(rho=0.4)", decided))


@pytest.mark.parametrize("subject", ["thin_sheet(rho=0.3, tau=0.2) + 0.3 * transmitted(base=ggx(alpha=0.2))"])
def test_of_a_sheet_the_directions_straight_through_are_planned_too_and_decide(subject):
    polar = np.concatenate([degrees(2.5, 88, 5), np.pi - degrees(2.5, 88, 5)[::-1]])
    light = np.array([*degrees(10, 61, 25), np.radians(145)])
    table = model_table(subject, layouts.isotropic(light, polar, degrees(0, 360, 20)))
    model = "thin_sheet + transmitted(base=ggx)"
    plan = gonio.plan_energy(table, model=model)
    theta_i, phi_i, theta_o, phi_o = plan.shots.angles
    assert set(np.round(np.degrees(theta_i)).astype(int)) == {10, 35, 60, 145}
    mirror, through = np.isclose(theta_o, theta_i, atol=1e-5), np.isclose(theta_o, np.pi - theta_i, atol=1e-5)
    assert (mirror | through).all() and through.sum() >= 4
    np.testing.assert_allclose(np.cos(phi_o - phi_i), -1, atol=1e-9)
    assert (plan.before.verdict, plan.after.verdict) == ("undecided", "pass")
    read = gonio.measure(subject, scan=plan.layout)
    assert energy(table, further=read, model=model).verdict == "pass"
    with pytest.raises(GonioError, match="measure where the table was read"):
        front = layouts.isotropic(light[:3], degrees(2.5, 88, 5), degrees(0, 360, 20))
        gonio.check(model_table(subject, front), further=gonio.measure(subject, scan=behind(plan.layout)))


def behind(layout):
    angles = np.array(layout.angles())
    return layouts.scattered(*angles[:, np.cos(angles[2]) < 0])

"""Readings that decide on energy: at the mirror directions that a table leaves out; and read there, they do decide."""

import numpy as np
import pytest

import gonio
from gonio.cli.program import main
from gonio.data import layouts
from gonio.models.errors import GonioError
from support.check_tables import degrees, model_table

INCIDENT = degrees(10, 61, 25)
LAYOUT = layouts.isotropic(INCIDENT, degrees(2.5, 88, 5), degrees(0, 360, 10))
SURFACE, MODEL = "lambert(rho=0.4) + 0.3 * ggx(alpha=0.2)", "lambert + ggx"
LIAR = "lambert(rho=0.4) + 0.9 * beckmann(alpha=0.002)"


@pytest.fixture(scope="module")
def table():
    return model_table(SURFACE, LAYOUT)


def energy(table, **options):
    return gonio.check(table, **options)["energy"]


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

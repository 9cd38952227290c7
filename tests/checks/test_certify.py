import math

import numpy as np
import pytest

from gonio.checks.certify import check
from gonio.data.subject import load_material
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build
from support.check_tables import model_table


def test_what_names_a_model_is_checked_as_one():
    expression = "lambert(rho=0.5)"
    for subject in (expression, load_material(expression), build(expression)):
        certificate = check(subject)
        assert certificate.kind == "model" and certificate.overall == "pass"
        names = ["reciprocity", "energy", "positivity", "symmetry", "isotropy", "pole", "horizon"]
        assert [p.name for p in certificate.properties] == names


def test_strict_counts_what_is_otherwise_reported_only():
    table = model_table("lambert(rho=0.5)")
    table.f[3, 1, 0] = table.f[1, 3, 0] = -1e-3
    loose, strict = (check(table, tolerances={"positivity": 1e-4}, strict=s) for s in (False, True))
    assert loose["positivity"].verdict == "fail"
    assert (loose.overall, strict.overall) == ("pass", "fail")


def test_tolerances_are_replaced_by_name():
    assert check("1.05 * lambert(rho=1)").exit_status == 1
    assert check("1.05 * lambert(rho=1)", tolerances={"energy": 0.1}).exit_status == 0


@pytest.mark.parametrize("tolerances", [{"colour": 1}, {"energy": -1}, {"energy": math.nan}, {"energy": math.inf}])
def test_bad_tolerances_are_refused(tolerances):
    with pytest.raises(GonioError):
        check("lambert(rho=0.5)", tolerances=tolerances)


@pytest.mark.parametrize("subject", ["no such thing", 3, None])
def test_what_is_no_subject_is_refused(subject):
    with pytest.raises(GonioError):
        check(subject)


def test_a_channel_is_named_once_where_one_band_is_both_the_strongest_and_the_worst():
    # In one band and channel light from further above is brighter by 2 %: no single pair shows it, the band does.
    def tilted(f, theta_i, phi_i, theta_o, phi_o):
        in_band = np.round(np.degrees(np.maximum(theta_i, theta_o))) == 40
        return 0.2 * (1 + in_band * 0.01 * np.sign(theta_o - theta_i) * [0, 1, 0])

    table = model_table("lambert(rho=0.5)", change=tilted, stated=0.01)
    reciprocity = check(table)["reciprocity"]
    assert reciprocity.where["theta_from"] == 40
    assert reciprocity.where["channel"] == reciprocity.facts["strongest_at"]["channel"] == table.channels.names[1]

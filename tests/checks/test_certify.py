import math

import numpy as np
import pytest

from gonio.checks.certify import check
from gonio.data import layouts
from gonio.data.subject import load_material
from gonio.data.table import whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build


def test_what_names_a_model_is_checked_as_one():
    expression = "lambert(rho=0.5)"
    for subject in (expression, load_material(expression), build(expression)):
        certificate = check(subject)
        assert certificate.kind == "model" and certificate.overall == "pass"
        names = ["reciprocity", "energy", "positivity", "symmetry", "isotropy", "pole", "horizon"]
        assert [p.name for p in certificate.properties] == names


def test_strict_counts_what_is_otherwise_reported_only():
    d = np.radians
    layout = layouts.isotropic(d(np.arange(0, 86, 10)), d(np.arange(0, 86, 10)), d(np.arange(0, 360, 30)))
    table = whole_table_of_values(layout, grid_values(build("lambert(rho=0.5)"), layout))
    table.f[3, 1, 0] = -1e-3
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
    d = np.radians
    layout = layouts.isotropic(d(np.arange(0, 86, 10)), d(np.arange(0, 86, 10)), d(np.arange(0, 360, 30)))
    # In one band and channel light from further above is brighter by 2 %: no single pair shows it, the band does.
    theta_i, _, theta_o, _ = (np.degrees(a).reshape(layout.shape) for a in layout.angles())
    tilt = np.where(np.round(np.maximum(theta_i, theta_o)) == 40, 0.01 * np.sign(theta_o - theta_i), 0.0)
    f = 0.2 * (1 + tilt[..., None] * [0, 1, 0])
    table = whole_table_of_values(layout, f, u_f=0.01 * f)
    reciprocity = check(table)["reciprocity"]
    assert reciprocity.where["theta_from"] == 40
    assert reciprocity.where["channel"] == reciprocity.facts["strongest_at"]["channel"] == table.channels.names[1]

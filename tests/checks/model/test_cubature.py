import numpy as np
import pytest

from gonio.checks.model.cubature import cubature_albedo
from gonio.models.expression.builder import build
from support.liars import Foreign


@pytest.mark.parametrize(("alpha", "albedo"), [(0.5, 0.6878485151), (0.25, 0.9158124303), (0.1, 0.9883040566)])
def test_cubature_without_a_map_meets_the_closed_form(alpha, albedo):
    value, bound = cubature_albedo(Foreign(build(f"ggx(alpha={alpha})")), 0.0, 0.0)
    assert abs(value[0] - albedo) <= bound[0] + 1e-9 and bound[0] < 1e-6


def test_cubature_bounds_hold_where_it_runs_out_of_cells():
    # α = 1 with height-correlated masking: E = 1 − μ ln(1 + 1/μ); a narrow lobe at grazing for the other.
    mu = np.cos(np.radians(89.9))
    value, bound = cubature_albedo(Foreign(build("ggx(alpha=1)")), np.radians(89.9), 0.0)
    assert abs(value[0] - (1 - mu * np.log(1 + 1 / mu))) <= bound[0]

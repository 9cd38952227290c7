"""Positivity, the horizon, and tables without readings."""

import numpy as np
import pytest

from gonio.checks.certify import check
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.horizon import table_horizon
from gonio.checks.table.positivity import table_positivity
from gonio.data import layouts
from gonio.data.flags import Flag
from support.check_tables import degrees, model_table

TO_85 = layouts.isotropic(degrees(0, 86, 5), degrees(0, 86, 5), degrees(0, 360, 30))
PAINT = "0.5 * ggx(alpha=0.4) + lambert(rho=0.3)"


def test_negative_readings_are_counted_and_judged_beyond_their_noise():
    table = model_table("lambert(rho=0.5)")
    table.f[3, 4, :] = -0.01
    positivity = table_positivity(TableEvidence(table), 0.001)
    assert positivity.facts["negative"] == 12 and positivity.verdict == "fail"
    table.u_f = np.full(table.f.shape, 0.01)
    assert table_positivity(TableEvidence(table), 0.001).verdict == "pass"


@pytest.mark.parametrize("surface", ["rough_slab(alpha=0.037)", "lambert(rho=0.01) + beckmann(alpha=0.2)"])
def test_the_steep_flank_of_a_lobe_is_no_jump_at_the_horizon(surface):
    layout = layouts.isotropic(degrees(0, 81, 20), degrees(0, 83, 7.5), degrees(7.5, 360, 15))
    assert table_horizon(TableEvidence(model_table(surface, layout)), 0.5).verdict != "fail"


def test_a_ring_that_is_off_shows_at_the_horizon():
    assert table_horizon(TableEvidence(model_table(PAINT, TO_85)), 0.5).verdict == "pass"
    blocked = model_table(PAINT, TO_85, lambda f, ti, pi, to, po: np.where(to > np.radians(84), 0.3 * f, f))
    horizon = table_horizon(TableEvidence(blocked), 0.5)
    assert horizon.verdict == "fail" and horizon.residual == pytest.approx(-np.log(0.3), abs=0.3)
    assert horizon.where["theta_o"] == pytest.approx(85)
    # Readings whose noise is as large as the jump leave it open.
    assert table_horizon(TableEvidence(model_table(PAINT, TO_85, stated=2.0)), 0.5).verdict == "undecided"


def test_nothing_valid_passes_nowhere():
    table = model_table("lambert(rho=0.5)")
    table.flag[...] = Flag.SATURATED
    verdicts = [p.verdict for p in check(table).properties]
    assert verdicts[:4] == ["not testable", *["undecided"] * 3]
    assert set(verdicts[4:]) <= {"undecided", "not applicable"}

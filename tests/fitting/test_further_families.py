"""Families of lobes beyond those that a selection tries: found where a surface has them, and not made up."""

import pytest

from gonio.fitting.fit_table import fit
from gonio.fitting.further_families import in_further_families
from support.fit_tables import table_of


@pytest.mark.parametrize(
    ("truth", "selected", "families"),
    [
        ("lambert(rho=0.3) + 0.2*gtr(alpha=0.3, gamma=3, f0=0.5)", "lambert + ggx(f0=?)", ("lambert", "gtr")),
        ("lambert(rho=0.3) + 0.2*ggx(alpha=0.3, f0=0.5)", "lambert + ggx(f0=?)", ("lambert", "ggx")),
    ],
)
def test_a_lobe_of_another_family_is_found_where_there_is_one(truth, selected, families):
    table = table_of(truth)
    best = in_further_families(table, fit(table, selected))
    assert best.exact and tuple(name for name in ("lambert", "ggx", "gtr") if name in best.requested) == families

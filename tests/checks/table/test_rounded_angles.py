"""The rounding of angles, on which a file, a unit or a precision decides, changes no verdict."""

import dataclasses

import numpy as np
import pytest

import gonio
from gonio.data.layouts import isotropic
from gonio.data.table import Table, whole_table_of_values

TURNS = np.radians(np.arange(0, 360, 30.0))


def noisy(last: float) -> Table:
    """A diffuser in noise, that no ring of readings is like another, with nodes at the limits of what is judged."""
    polar = np.radians(np.arange(0, last + 1, 15.0))
    layout = isotropic(polar, polar, TURNS)
    f = 0.1 * np.exp(0.01 * np.random.default_rng(5).normal(size=layout.shape))
    return whole_table_of_values(layout, f)


def moved(table: Table, by: float) -> Table:
    """Polar angles but the normal's turned by some radians."""
    theta = table.layout.axes["theta_i"]
    polar = np.where(theta > 0, theta + by, theta)
    return dataclasses.replace(table, layout=isotropic(polar, polar, TURNS))


@pytest.mark.parametrize("last", [60.0, 75.0])
def test_a_certificate_is_the_same_whichever_way_angles_were_rounded(last):
    table = noisy(last)
    certificates = [gonio.check(moved(table, by)).to_dict()["properties"] for by in (0.0, 1e-12, -1e-12, -1e-7)]
    for others in certificates[1:]:
        for one, other in zip(certificates[0], others, strict=True):
            assert (one["name"], one["verdict"]) == (other["name"], other["verdict"])
            assert (one["residual"] or 0) == pytest.approx(other["residual"] or 0, rel=1e-4, abs=1e-9)
        medians = certificates[0][0]["series"]["median"]
        np.testing.assert_allclose(others[0]["series"]["median"], medians, rtol=1e-4)

"""Readings that scatter more than they state: shown where they do, and never by what f bends."""

import numpy as np
import pytest

import gonio
from gonio.data import layouts
from gonio.data.layouts import Layout
from gonio.data.plausibility.understated_uncertainty import as_scattered, understated_uncertainty
from gonio.data.table import Table, whole_table_of_values
from support.tables import list_in_planes

POLAR = np.radians(np.arange(0, 86, 5))
GRID = layouts.isotropic(POLAR, np.radians(np.arange(0, 86, 6)), np.radians(np.arange(0, 360, 20)))
PLANE = layouts.in_plane(np.radians([0, 15, 30, 45, 60]), np.radians(np.arange(-85, 86, 2.0)))
RELATIVE, FLOOR = 0.004, 1e-4


def surface(theta_i, phi_i, theta_o, phi_o, width):
    """f of a diffuser and a lobe of this width about the mirror direction."""
    x = np.sin(theta_i) * np.cos(phi_i) + np.sin(theta_o) * np.cos(phi_o)
    y = np.sin(theta_i) * np.sin(phi_i) + np.sin(theta_o) * np.sin(phi_o)
    return 0.02 + np.exp(-(x**2 + y**2) / width**2)


def read(layout: Layout, times: float, width: float, seed: int = 1) -> Table:
    """Two channels, of which the second scatters by `times` what both store."""
    f = surface(*layout.angles(), width).reshape(-1, 1) * [1.0, 0.5]
    u_f = np.hypot(RELATIVE * f, FLOOR)
    noise = u_f * np.random.default_rng(seed).standard_normal(f.shape)
    f, u_f = (a.reshape(*layout.shape, 2) for a in (f + noise * [1.0, times], u_f))
    return whole_table_of_values(layout, f, u_f=u_f)


@pytest.mark.parametrize("layout", [GRID, PLANE, list_in_planes()], ids=["grid", "plane", "list"])
def test_scatter_beyond_what_is_stored_shows_in_its_channel(layout):
    factor = understated_uncertainty(read(layout, 3.0, 0.6))
    assert factor[0] == 1.0 and factor[1] == pytest.approx(3.0, rel=0.25)
    table = read(layout, 3.0, 0.6)
    assert table.u_f is not None
    np.testing.assert_allclose(as_scattered(table, factor).u_f, np.asarray(table.u_f) * factor)


@pytest.mark.parametrize("width", [0.03, 0.1, 0.3])
@pytest.mark.parametrize("layout", [GRID, PLANE, list_in_planes()], ids=["grid", "plane", "list"])
def test_what_a_lobe_bends_is_no_scatter(layout, width):
    for seed in range(3):
        assert understated_uncertainty(read(layout, 1.0, width, seed)) == pytest.approx(1.0)


def test_readings_without_noise_or_uncertainty_show_nothing():
    table = read(GRID, 0.0, 0.3)
    assert (understated_uncertainty(table) == 1).all()
    table.u_f = None
    assert (understated_uncertainty(table) == 1).all()


def test_quantities_are_as_uncertain_as_their_readings_scatter():
    """White, read with five times the stated noise: the albedo's U grows by as much, and a note says so."""
    rng, f = np.random.default_rng(4), np.full((*GRID.shape, 1), 0.9 / np.pi)
    tables = [
        whole_table_of_values(GRID, f + t * 0.01 * f * rng.standard_normal(f.shape), u_f=0.01 * f) for t in (1.0, 5.0)
    ]
    stated, scattered = (gonio.quantities(table, only="albedo") for table in tables)
    ratios = [b.u / a.u for a, b in zip(stated.quantities, scattered.quantities, strict=True) if a.u > 0]
    assert ratios == pytest.approx([5.0] * len(ratios), rel=0.2) and ratios
    assert any("scatter about their neighbours" in note for note in scattered.notes)
    assert not any("scatter about their neighbours" in note for note in stated.notes)

"""Standard uncertainties of f between readings, and of fits, against functions that are known everywhere."""

import jax
import numpy as np
import pytest

import gonio
from gonio.data import layouts
from gonio.data.table import whole_table_of_values
from support.marks import thorough
from support.window_xml import document, numbers, scattering

NOISE = 0.01


def lobe(theta_i, phi_i, theta_o, phi_o, width=0.3):
    """A wide lobe about the mirror direction over a matte ground: isotropic and reciprocal."""
    tilt = np.hypot(
        np.sin(theta_i) * np.cos(phi_i) + np.sin(theta_o) * np.cos(phi_o),
        np.sin(theta_i) * np.sin(phi_i) + np.sin(theta_o) * np.sin(phi_o),
    ) / (np.cos(theta_i) + np.cos(theta_o))
    return 0.1 + 0.4 / (1 + (tilt / width) ** 2) ** 2


def brushed(theta_i, phi_i, theta_o, phi_o):
    """Reciprocal, and not the same when it is turned."""
    return (
        0.2
        + 0.15 * np.cos(2 * phi_i) * np.cos(2 * phi_o) * np.sin(theta_i) * np.sin(theta_o)
        + 0.1 * (np.cos(2 * phi_i) * np.sin(theta_i) ** 2 + np.cos(2 * phi_o) * np.sin(theta_o) ** 2)
    )


def some_directions(seed, number=400, most=60.0):
    rng = np.random.default_rng(seed)
    theta_i, theta_o = np.radians(most) * np.sqrt(rng.random((2, number)))
    return theta_i, np.zeros(number), theta_o, rng.uniform(0, 2 * np.pi, number)


def held(f, u, true, value):
    """Share of the known intervals f ± 2u that hold the truth."""
    known = np.isfinite(u)
    assert known.mean() > 0.8 and f.shape == u.shape
    return np.mean(np.abs(value - true)[known] <= 2 * u[known])


@pytest.fixture(scope="module")
def grid():
    angles = np.radians(np.arange(0, 61, 10.0)), np.radians(np.arange(0, 76, 5.0)), np.radians(np.arange(0, 360, 15.0))
    layout = layouts.isotropic(*angles)
    f = lobe(*layout.angles())
    read = f * (1 + NOISE * np.random.default_rng(0).standard_normal(f.shape))
    return whole_table_of_values(layout, read.reshape(layout.shape), u_f=NOISE * f.reshape(*layout.shape, 1))


def test_intervals_between_the_nodes_of_a_grid_hold_the_truth(grid):
    angles = some_directions(1)
    f = gonio.material(grid).f(*angles)
    assert held(f, gonio.standard_uncertainty(grid, *angles), lobe(*angles)[:, None], f) >= 0.95


def test_intervals_beside_missing_readings_hold_the_truth(grid):
    f = np.where(np.random.default_rng(5).random(grid.layout.shape) < 0.1, np.nan, np.asarray(grid.f)[..., 0])
    table, angles = whole_table_of_values(grid.layout, f, u_f=np.asarray(grid.u_f)), some_directions(6)
    f = gonio.material(table).f(*angles)
    assert held(f, gonio.standard_uncertainty(table, *angles), lobe(*angles)[:, None], f) >= 0.95


def test_a_reading_has_its_own_uncertainty(grid):
    theta_i, phi_i, theta_o, phi_o = (a[::371] for a in grid.layout.angles())
    u = gonio.standard_uncertainty(grid, theta_i, phi_i, theta_o, phi_o)
    np.testing.assert_allclose(u.ravel(), np.asarray(grid.u_f).ravel()[::371], rtol=1e-6)


def test_a_reading_without_an_uncertainty_is_not_exact(grid):
    """Nothing lies between it and itself; beside it there is what interpolation may miss."""
    table = whole_table_of_values(grid.layout, np.asarray(grid.f)[..., 0])
    u = gonio.standard_uncertainty(table, 20, 0, [25, 27], 45, degrees=True)
    assert np.isnan(u[0, 0]) and u[1, 0] > 0


def test_readings_that_scatter_more_than_they_state_are_as_uncertain_as_they_scatter(grid):
    table = whole_table_of_values(grid.layout, np.asarray(grid.f)[..., 0], u_f=np.asarray(grid.u_f) / 4)
    u = gonio.standard_uncertainty(table, 20, 0, [25, 40], 45, degrees=True)
    stated = gonio.standard_uncertainty(grid, 20, 0, [25, 40], 45, degrees=True)
    np.testing.assert_allclose(u, stated, rtol=0.3)


def test_the_rounding_of_a_value_is_in_its_uncertainty():
    """Of a matte surface next to nothing else is left; values are of single precision unless JAX is told otherwise."""
    true = 0.0971 / np.pi
    polar = np.radians(np.linspace(0, 85, 7))
    layout = layouts.half_difference(polar**2 / polar[-1], polar, np.radians(np.arange(0, 180, 10.0)))
    noise = 1e-8 * np.random.default_rng(0).standard_normal(layout.shape)
    table, angles = whole_table_of_values(layout, true * (1 + noise)), some_directions(3)
    with jax.enable_x64(False):
        off = np.abs(gonio.material(table).f(*angles) - true)
        u = gonio.standard_uncertainty(table, *angles)
    assert held(off, u, 0.0, off) > 0.99


def test_what_was_not_read_has_none(grid):
    u = gonio.standard_uncertainty(grid, [30, 70], 0, [20, 80], [0, 90], degrees=True)
    assert u.shape == (2, 1) and np.isfinite(u[0, 0]) and np.isnan(u[1, 0])


def test_a_lobe_may_hide_where_the_mirror_direction_was_left_out():
    polar = np.radians([0.0, 20.0, 40.0]), np.radians([10.0, 30.0, 50.0]), np.radians(np.arange(0, 360, 30.0))
    layout = layouts.isotropic(*polar)
    table = whole_table_of_values(layout, np.full(layout.shape, 0.1), u_f=np.full((*layout.shape, 1), 0.001))
    u = gonio.standard_uncertainty(table, 20, 0, [20, 25, 45], [180, 180, 90], degrees=True)
    assert np.isnan(u[0, 0]) and np.isfinite(u[2, 0])


@pytest.mark.parametrize(("surface", "clustered"), [(lobe, False), (brushed, True), *thorough((lobe, True))])
def test_intervals_between_the_readings_of_a_list_hold_the_truth(surface, clustered):
    """Also of readings close together along one angle and far apart along another, and where turning is no symmetry."""
    if clustered:  # more than are kriged
        polar = np.radians(np.arange(0, 61, 15.0)), np.radians(np.arange(0, 76, 7.5))
        read = [a.ravel() for a in np.meshgrid(polar[0], [0.0], polar[1], np.radians(np.arange(0, 360, 4.8)))]
    else:
        read = some_directions(2, 100, 75.0)
    table = gonio.Table.from_arrays(*read, surface(*read))
    angles = some_directions(3)
    f = gonio.material(table).f(*angles)
    assert held(f, gonio.standard_uncertainty(table, *angles), surface(*angles)[:, None], f) >= 0.93


def test_what_all_readings_share_is_in_each_value(grid):
    f = lobe(*grid.layout.angles()).reshape(grid.layout.shape)
    table = whole_table_of_values(grid.layout, f, u_f=0.05 * f[..., None])
    angles = some_directions(4, 50)
    u, f = gonio.standard_uncertainty(table, *angles), gonio.material(table).f(*angles)
    assert (u > 0.045 * f)[np.isfinite(u)].all()


def test_a_fit_has_what_its_numbers_make_of_f(grid):
    result = gonio.fit(grid, "lambert")
    rho = result.parameters[0]
    u = gonio.standard_uncertainty(result, [0.1, 0.7], 0, [[0.2], [0.4], [1.2]], 1.0)
    assert u.shape == (3, 2, 1)
    np.testing.assert_allclose(u, rho.standard_uncertainty / np.pi, rtol=1e-6)
    assert np.isnan(gonio.standard_uncertainty("lambert(rho=0.5)", 0.1, 0, 0.2, 0)).all()


def test_patches_of_a_window_bound_nothing_between_their_middles(tmp_path):
    (tmp_path / "sheet.xml").write_text(document({"Reflection Front": numbers(scattering(0, 0.3))}), encoding="utf-8")
    table = gonio.open(tmp_path / "sheet.xml")
    assert np.isnan(gonio.standard_uncertainty(table, 10, 0, [5, 30], 0, degrees=True)).all()

"""A table as a material: second order in the step of the grid, exact at the nodes, honest where nothing was read."""

import dataclasses

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.interpolation.inverse_distance import MAX_SAMPLES, scattered_material
from gonio.data.interpolation.multilinear import as_material, coarsened, interpolation
from gonio.data.table import Channels, whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical

TURN = 2 * np.pi


class Smooth(AbstractBRDF):
    """Reciprocal, isotropic, a broad peak at the mirror direction; two channels."""

    def formula(self, wi, wo):
        import jax.numpy as jnp

        mirror = wi.z * wo.z - wi.x * wo.x - wi.y * wo.y
        return jnp.stack([0.2 + jnp.exp(4.0 * (mirror - 1.0)), 0.3 + 0.1 * wi.z * wo.z])


def polar(n):
    return np.linspace(0, np.pi / 2, n + 1)


def azimuth(n, period=TURN):
    return np.linspace(0, period, n, endpoint=False)


GRIDS = {
    "isotropic": lambda n: layouts.isotropic(polar(n), polar(n), azimuth(2 * n)),
    "half a circle": lambda n: layouts.isotropic(polar(n), polar(n), np.linspace(0, np.pi, n + 1)),
    "merl": lambda n: layouts.merl(counts=(n, n, 2 * n)),
    "full half_difference": lambda n: layouts.half_difference(polar(n), polar(n), azimuth(2 * n)),
    "anisotropic half_difference": lambda n: layouts.half_difference(polar(n), polar(n), azimuth(n, np.pi), azimuth(3)),
    "spherical": lambda n: layouts.spherical(polar(n // 2), azimuth(n), polar(n // 2), azimuth(n)),
}


def table_of(grid):
    return whole_table_of_values(grid, grid_values(Smooth(), grid))


def random_pairs(n=2000, seed=0, lowest=0.35):
    rng = np.random.default_rng(seed)
    z, phi = rng.uniform(lowest, 1, (2, n)), rng.uniform(0, TURN, (2, n))
    s = np.sqrt(1 - z**2)
    return tuple(Direction(s[k] * np.cos(phi[k]), s[k] * np.sin(phi[k]), z[k]) for k in (0, 1))


@pytest.mark.parametrize("name", ["isotropic", "merl", "anisotropic half_difference", "spherical"])
def test_interpolation_converges_at_second_order(name):
    wi, wo = random_pairs()
    truth = np.asarray(evaluate(Smooth(), wi, wo))
    errors = []
    for n in (12, 24):
        values = np.asarray(evaluate(as_material(table_of(GRIDS[name](n))), wi, wo))
        errors.append(np.sqrt(np.mean((values - truth) ** 2, axis=0)))
    assert np.all(errors[1] < 0.02)
    np.testing.assert_array_less(np.log2(errors[0] / errors[1]), 2.5)
    np.testing.assert_array_less(1.6, np.log2(errors[0] / errors[1]))


@pytest.mark.parametrize("name", GRIDS)
def test_it_is_exact_at_its_nodes_and_says_how_it_works(name):
    table = table_of(GRIDS[name](12))
    block = table.samples(2000, theta_max=np.radians(89))
    values = np.asarray(evaluate(as_material(table), block.wi, block.wo))
    np.testing.assert_allclose(values, block.f, atol=1e-9)
    assert ("mirror image" in interpolation(table)) == (name == "half a circle")
    assert ("sqrt(theta_h)" in interpolation(table)) == (name == "merl")
    assert as_material(table).isotropic == (name not in ("spherical", "anisotropic half_difference"))


def test_half_the_nodes_err_four_times_as_much_on_a_smooth_material():
    table = table_of(GRIDS["isotropic"](24))
    wi, wo = random_pairs()
    coarse = coarsened(table)
    truth, whole, half = (np.asarray(evaluate(m, wi, wo)) for m in (Smooth(), as_material(table), as_material(coarse)))
    errors = [np.sqrt(np.mean((values - truth) ** 2)) for values in (whole, half)]
    assert coarse.layout.shape == (13, 13, 24) and 1.6 < np.log2(errors[1] / errors[0]) < 2.5


def test_cells_without_a_value_take_no_part():
    grid = layouts.isotropic(polar(6), polar(6), azimuth(8))
    table = whole_table_of_values(grid, np.where(np.arange(8) % 2 == 0, 0.5, np.nan) + np.zeros(grid.shape))
    table.f[:2, :2] = np.nan
    table.flag[:2, :2] = Flag.NOT_MEASURED
    theta = np.radians([50, 50, 40, 2])
    wi = Direction(np.sin(theta), 0 * theta, np.cos(theta))
    phi = np.radians([10, 45, 170, 5])
    wo = Direction(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))
    values = np.asarray(evaluate(as_material(table), wi, wo))[:, 0]
    np.testing.assert_allclose(values, [0.5, 0.0, 0.5, 0.0], atol=1e-12)


def test_each_channel_has_its_own_cells():
    table = table_of(GRIDS["isotropic"](12))
    table.flag[..., 1] = Flag.SATURATED
    table.f[..., 1] = np.nan
    wi, wo = random_pairs(50)
    values = np.asarray(evaluate(as_material(table), wi, wo))
    assert (values[:, 1] == 0).all() and (values[:, 0] > 0.1).all()


def test_in_the_plane_and_out_of_it():
    grid = layouts.in_plane(polar(40), np.linspace(-np.pi / 2, np.pi / 2, 81))
    brdf = as_material(table_of(grid))
    theta_i, theta_o, turn = (
        np.array([0.3, 0.5, 0.0, 0.4]),
        np.array([0.4, -0.6, 0.2, 0.5]),
        np.array([0.7, 2.0, 1.0, 1.0]),
    )
    wi = Direction(np.sin(theta_i) * np.cos(turn), np.sin(theta_i) * np.sin(turn), np.cos(theta_i))
    side = np.where(np.arange(4) == 3, turn + 1.0, turn)
    wo = Direction(-np.sin(theta_o) * np.cos(side), -np.sin(theta_o) * np.sin(side), np.cos(theta_o))
    values, truth = (np.asarray(evaluate(m, wi, wo)) for m in (brdf, Smooth()))
    np.testing.assert_allclose(values[:3], truth[:3], rtol=2e-3)
    assert np.isnan(values[3]).all()


def test_below_the_horizon_it_is_dark():
    wi, wo = random_pairs(20)
    brdf = as_material(table_of(GRIDS["isotropic"](12)))
    for pair in ((wi, wo._replace(z=-wo.z)), (wi._replace(z=-wi.z), wo)):
        assert (np.asarray(evaluate(brdf, *pair)) == 0).all()


@pytest.mark.parametrize("isotropic", [True, False])
def test_scattered_samples_are_reciprocal_and_exact_at_the_samples(isotropic):
    rng = np.random.default_rng(0)
    theta = np.arccos(rng.uniform(0.3, 1, (2, 1500)))
    phi = rng.uniform(0, TURN, (2, 1500))
    grid = layouts.scattered(theta[0], 0 * phi[0] + 1.0 if isotropic else phi[0], theta[1], phi[1])
    table = table_of(grid)
    brdf = scattered_material(table)
    block = table.samples()
    for pair in ((block.wi, block.wo), (block.wo, block.wi)):
        np.testing.assert_allclose(evaluate(brdf, *pair), block.f, rtol=1e-9)
    wi, wo = random_pairs(1500, lowest=0.4)
    error = np.asarray(evaluate(brdf, wi, wo)) / np.asarray(evaluate(Smooth(), wi, wo)) - 1
    assert np.sqrt(np.mean(error**2)) < (0.03 if isotropic else 0.1)


def test_what_cannot_be_interpolated_is_refused():
    n = MAX_SAMPLES + 1
    many = layouts.scattered(*np.full((4, n), 0.3))
    with pytest.raises(GonioError, match="too many to interpolate"):
        as_material(whole_table_of_values(many, np.ones(n)))
    for grid in (layouts.in_plane([0.1], [0.2]), layouts.scattered([0.1], [0], [0.1], [0])):
        with pytest.raises(GonioError, match="no valid reading"):
            as_material(whole_table_of_values(grid, np.full(grid.shape, np.nan)))


def test_a_formats_own_interpolant_is_used():
    table = dataclasses.replace(
        table_of(GRIDS["merl"](12)), interpolant=lambda coarse=False: 2.0 * Smooth() if coarse else Smooth()
    )
    assert isinstance(as_material(table), Smooth) and "own rule" in interpolation(table)
    wi, wo = random_pairs()
    np.testing.assert_allclose(evaluate(as_material(coarsened(table)), wi, wo), 2 * evaluate(Smooth(), wi, wo))


@pytest.mark.parametrize("light", [40.0, 137.0, 200.0])
def test_light_of_one_azimuth_stands_for_all_whichever_it_is(light):
    theta, phi = np.radians([0, 20, 40, 60]), np.radians(np.arange(0, 360, 30))
    layout = layouts.spherical(theta, np.radians([light]), theta, phi)
    delta = phi - np.radians(light)
    sines = np.multiply.outer(np.sin(theta), np.sin(theta))
    f = 0.2 + 0.1 * np.multiply.outer(sines, np.cos(delta))
    table = whole_table_of_values(layout, f[:, None, ..., None], Channels.grey())
    for azimuth in np.radians([0.0, 10.0, light]):  # of other light, at the same differences from it
        wi, wo = from_spherical(theta[2], azimuth), from_spherical(theta[3], azimuth + delta[5])
        assert float(evaluate(as_material(table), wi, wo)[..., 0]) == pytest.approx(f[2, 3, 5], rel=1e-6)

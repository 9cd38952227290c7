"""Layouts: their cells' directions against the definitions of the angles, and what they refuse."""

import math

import jax
import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.tabulate import grid_values
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import Direction, to_half_difference
from gonio.models.geometry.sides import FRONT, HORIZON

TURN = np.radians([0.0, 70.0, 180.0, 300.0])
POLAR = np.radians([0.0, 20.0, 85.0, 90.0])
LAYOUTS = {
    "spherical": layouts.spherical(POLAR, TURN, POLAR, TURN),
    "isotropic": layouts.isotropic(POLAR, POLAR, TURN),
    "half_difference": layouts.half_difference(POLAR, POLAR[:3], TURN),
    "anisotropic half_difference": layouts.half_difference(POLAR[:2], POLAR[:3], TURN[:2], TURN),
    "in_plane": layouts.in_plane(POLAR, np.r_[-POLAR[:0:-1], POLAR]),
    "mirror": layouts.mirror(POLAR, np.radians([0.0, 20.0, 85.0, 150.0]), TURN),
    "anisotropic mirror": layouts.mirror(POLAR, np.radians([0.0, 20.0, 85.0]), TURN, TURN[:3]),
    "straight": layouts.straight(POLAR, np.radians([0.0, 20.0, 85.0, 150.0]), TURN),
    "turned": layouts.turned(POLAR, TURN, np.radians([0.0, 20.0, 85.0, 130.0]), TURN),
    "scattered": layouts.scattered(POLAR, TURN, POLAR[::-1], TURN[::-1]),
}
each_layout = pytest.mark.parametrize("grid", LAYOUTS.values(), ids=LAYOUTS)


def polar(theta, phi):
    return np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)


@each_layout
def test_directions_have_the_stated_angles(grid):
    theta_i, phi_i, theta_o, phi_o = grid.angles()
    wi, wo = grid.directions()
    np.testing.assert_allclose(wi, polar(theta_i, phi_i), atol=1e-15)
    np.testing.assert_allclose(wo, polar(theta_o, phi_o), atol=1e-15)
    np.testing.assert_allclose(np.sum(np.square(wi), 0), 1.0, rtol=1e-15)
    for azimuth in (phi_i, phi_o):
        assert azimuth.min() >= 0 and azimuth.max() < 2 * np.pi
    np.testing.assert_array_equal(np.broadcast_shapes(theta_i.shape), (grid.size,))


@each_layout
@pytest.mark.parametrize("cut", [slice(0, None), slice(3, 9), slice(2, -1), slice(-1, None)], ids=str)
def test_a_range_of_cells_is_a_part_of_all(grid, cut):
    start, stop, _ = cut.indices(grid.size)
    for part, whole in zip(grid.directions(start, stop), grid.directions(), strict=True):
        np.testing.assert_allclose(part, np.array(whole)[:, start:stop], atol=1e-16)
    for part, whole in zip(grid.cosines(start, stop), grid.directions(), strict=True):
        np.testing.assert_allclose(part, whole.z[start:stop], atol=1e-16)
    np.testing.assert_array_equal(grid.readable(start, stop), grid.readable()[start:stop])
    for part, whole in zip(grid.angles(start, stop), grid.angles(), strict=True):
        np.testing.assert_array_equal(part, whole[start:stop])
    cells = np.random.default_rng(0).permutation(grid.size)[cut]
    for some, whole in zip(grid.angles_at(cells), grid.angles(), strict=True):
        np.testing.assert_allclose(some, whole[cells], atol=1e-15)


def test_half_difference_cells_have_the_stated_half_difference_angles():
    grid = layouts.half_difference([0.2, 0.7, 1.2], [0.1, 0.8], [0.0, 2.0, 5.0], [0.3, 4.0])
    back = to_half_difference(*grid.directions())
    asked = np.meshgrid(*grid.axes.values(), indexing="ij")
    for name, angle in zip(("theta_h", "phi_h", "theta_d", "phi_d"), back, strict=True):
        expected = asked[list(grid.axes).index(name)].ravel()
        np.testing.assert_allclose(np.cos(angle - expected), 1.0, atol=1e-14)


def test_specular_is_at_delta_phi_pi_and_at_positive_in_plane_angles():
    for grid in (layouts.isotropic([0.4], [0.4], [np.pi]), layouts.in_plane([0.4], [0.4])):
        wi, wo = grid.directions()
        np.testing.assert_allclose([wi.x + wo.x, wi.y + wo.y, wi.z - wo.z], 0, atol=1e-15)
    wi, wo = layouts.in_plane([0.4], [-0.4]).directions()
    np.testing.assert_allclose(wi, wo, atol=1e-15)


def test_what_is_on_the_horizon_cannot_be_read_nor_what_is_below_it_on_half_angles():
    grid = layouts.isotropic([0.0, np.pi / 2], [0.3, np.pi / 2, 2.0], [0.0])
    assert grid.readable().tolist() == [True, False, True, False, False, False]
    rounded = layouts.isotropic([0.0], np.array([0.3, np.pi / 2], np.float32), [0.0])
    assert rounded.readable().tolist() == [True, False] and rounded.sides == FRONT
    touching = layouts.half_difference([np.pi / 4], [np.pi / 4], [0.0, np.pi / 2, np.pi])
    assert touching.readable().tolist() == [False, True, False]


@pytest.mark.parametrize("theta_i", [[0.0, 1.0], [2.0, np.pi], [0.5, 3.0]])
@pytest.mark.parametrize("theta_o", [[0.3, 1.2], [1.8, 3.0], [1.0, np.pi]])
def test_the_parts_of_a_grid_are_its_cells_mirrored_into_the_front(theta_i, theta_o):
    """Each cell is in one part, at the same azimuth and the same distance from the plane of the sample."""
    grids = [layouts.isotropic(theta_i, theta_o, [0.0, 2.0]), layouts.spherical(theta_i, [1.0], theta_o, [0.5, 3.0])]
    signed = sorted({*theta_o, *(-t for t in theta_o if t < 3.1)})
    grids += [layouts.in_plane(theta_i, signed), layouts.scattered(theta_i, [1.0, 2.0], theta_o, [0.5, 3.0])]
    for grid in grids:
        numbers, directions, found = np.arange(grid.size).reshape(grid.shape), np.array(grid.directions()), []
        assert grid.sides == {(a, b) for a, b in np.sign(directions[:, 2]).T.astype(int).tolist()}
        for light, detector in grid.sides:
            part, index = grid.folded(light, detector)
            cells = numbers[index].ravel()
            assert part.sides == FRONT and part.name == grid.name
            mirrored = directions[:, :, cells] * np.array([[1, 1, light], [1, 1, detector]])[..., None]
            np.testing.assert_allclose(part.directions(), mirrored, atol=1e-15)
            found += cells.tolist()
        assert sorted(found) == list(range(grid.size))


def test_half_angles_hold_reflection_alone():
    assert layouts.merl(counts=(4, 4, 4)).sides == FRONT
    assert layouts.mirror([0.5], [0.0, 3.0], [0.0, 1.0]).sides == FRONT


def test_merls_grid_is_the_published_one():
    grid = layouts.merl()
    assert grid.shape == (90, 90, 180) and grid.size == 1_458_000 and grid.periods["phi_d"] == math.pi
    np.testing.assert_allclose(np.degrees(grid.axes["theta_h"][[0, 1, 89]]), [0, 90 / 8100, 7921 / 90], rtol=1e-14)
    np.testing.assert_allclose(np.degrees(grid.axes["theta_d"]), np.arange(90), rtol=1e-14)
    np.testing.assert_allclose(np.degrees(grid.axes["phi_d"]), np.arange(180), rtol=1e-14)
    centre = layouts.merl("centre")
    np.testing.assert_allclose(np.degrees(centre.axes["phi_d"][:2]), [0.5, 1.5], rtol=1e-14)
    np.testing.assert_allclose(np.degrees(centre.axes["theta_h"][0]), 90 / 180**2, rtol=1e-14)
    assert layouts.merl(counts=(4, 4, 360), phi_d_range=2 * math.pi).periods["phi_d"] == 2 * math.pi


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: layouts.LAYOUTS["in_plane"]({"theta_i": [0.0]}), "give it theta_i, theta_o"),
        (lambda: layouts.in_plane([], [0.0]), "at least one angle"),
        (lambda: layouts.in_plane([[0.1]], [0.0]), "shape"),
        (lambda: layouts.in_plane([0.1, math.nan], [0.0]), "nan rad"),
        (lambda: layouts.in_plane(["x"], [0.0]), "not a list of numbers"),
        (lambda: layouts.in_plane([30.0, 60.0], [0.0]), "30 rad, outside 0 to 3.14159"),
        (lambda: layouts.isotropic([0.2, 0.1], [0.1], [0.0]), "not strictly increasing"),
        (lambda: layouts.isotropic([0.1], [0.1], [-0.1]), "outside 0 to 6.28319"),
        (lambda: layouts.half_difference([1.7], [0.1], [0.0]), "outside 0 to 1.5708"),
        (lambda: layouts.scattered([0.1], [0.1], [0.1, 0.2], [0.1]), "theta_o 2"),
        (lambda: layouts.merl("middle"), "'middle'"),
    ],
)
def test_a_layout_that_makes_no_sense_is_refused(make, said):
    with pytest.raises(GonioError, match=said):
        make()


def test_equal_layouts_are_equal_and_frozen():
    assert layouts.merl() == layouts.merl() != layouts.merl("centre")
    assert layouts.in_plane([0.1], [0.2]) != layouts.isotropic([0.1], [0.2], [0.0])
    with pytest.raises(ValueError, match="read-only"):
        layouts.merl().axes["phi_d"][0] = 1.0


class Lopsided(AbstractBRDF):
    """No symmetry at all, two channels: what a kernel gets wrong shows."""

    def formula(self, wi, wo):
        import jax.numpy as jnp

        return jnp.stack([1.0 + wi.x + 2 * wo.y + 3 * wi.y * wo.x, 2.0 + wi.z * wo.z + wo.x])


@each_layout
def test_the_grid_kernel_agrees_with_the_directions(grid):
    wi, wo = grid.directions()
    expected = np.stack([1.0 + wi.x + 2 * wo.y + 3 * wi.y * wo.x, 2.0 + wi.z * wo.z + wo.x], -1)
    expected[np.minimum(*grid.cosines()) <= HORIZON] = 0.0  # the model reflects alone
    expected = expected.reshape(*grid.shape, 2)
    three_rows = 3 * grid.row_size
    np.testing.assert_allclose(grid_values(Lopsided(), grid, block_cells=three_rows), expected, atol=1e-14)
    np.testing.assert_allclose(grid_values(Lopsided(), grid, 1, 3, three_rows), expected[1:3], atol=1e-14)


GRIDDED = {name: grid for name, grid in LAYOUTS.items() if grid.gridded}
each_grid = pytest.mark.parametrize("grid", GRIDDED.values(), ids=GRIDDED)
REGULAR = np.radians([20.0, 40.0, 60.0])
ROUND = np.radians(np.arange(0.0, 360.0, 45.0))
REGULAR_GRIDS = {
    "turned": layouts.turned(REGULAR, ROUND, REGULAR, ROUND),
    "spherical": layouts.spherical(REGULAR, ROUND, REGULAR, ROUND),
    "isotropic": layouts.isotropic(REGULAR, REGULAR, ROUND),
    "half_difference": layouts.half_difference(REGULAR, REGULAR, ROUND, ROUND),
    "in_plane": layouts.in_plane(REGULAR, np.r_[-REGULAR[::-1], REGULAR]),
}


@each_grid
def test_coordinates_are_the_angles_of_the_cells(grid):
    wi, wo = grid.directions()
    angles = jax.vmap(grid.coordinates)(wi, wo)
    for name, angle in zip(grid.axes, np.meshgrid(*grid.axes.values(), indexing="ij"), strict=True):
        off = np.asarray(angles[name]) - angle.ravel()
        period = grid.periods[name]
        off = off if period is None else (off + period / 2) % period - period / 2
        # An azimuth is lost where its direction is the normal, and an exchange where wi = wo.
        known = np.minimum(np.hypot(wi.x, wi.y), np.hypot(wo.x, wo.y)) > 1e-9
        if "theta_m" in grid.axes:
            known &= np.asarray(angles["theta_m"]) > 1e-9
        if grid.in_half_vectors:
            known = np.hypot(wi.x + wo.x, wi.y + wo.y) > 1e-9
            known &= np.hypot(np.hypot(wi.x - wo.x, wi.y - wo.y), wi.z - wo.z) > 1e-9
        np.testing.assert_allclose(off[known], 0, atol=1e-7)
    assert np.all(grid.covers(wi, wo))


@pytest.mark.parametrize("grid", REGULAR_GRIDS.values(), ids=REGULAR_GRIDS)
def test_related_cells_have_the_related_directions(grid):
    cells = np.arange(grid.size)
    (wi, wo), angle = grid.directions(), ROUND[2]
    exchanged = grid.exchanged(cells)
    some = exchanged >= 0
    assert some.all()
    a, b = grid.directions_at(exchanged)
    turn = np.arctan2(a.y, a.x) - np.arctan2(wo.y, wo.x) if not grid.has_azimuth_of_light else np.zeros(grid.size)
    for w, partner in ((wo, a), (wi, b)):  # up to a turn about the normal, where the light has one azimuth
        c, s = np.cos(turn), np.sin(turn)
        np.testing.assert_allclose([w.x * c - w.y * s, w.x * s + w.y * c, w.z], partner, atol=1e-12)
    if grid.mirror_map() is not None:
        a, b = grid.directions_at(grid.mirrored(cells))
        for w, image in ((wi, a), (wo, b)):
            np.testing.assert_allclose([w.x, -w.y, w.z], image, atol=1e-12)
    if grid.turning_axes:
        a, b = grid.directions_at(grid.turned(cells, angle))
        for w, image in ((wi, a), (wo, b)):
            np.testing.assert_allclose([-w.y, w.x, w.z], image, atol=1e-12)


def test_what_a_layout_cannot_hold_is_marked():
    assert layouts.merl().exchanged(np.arange(3)) is None and layouts.merl().reciprocal_by_construction
    assert layouts.isotropic([0.1], [0.1], [0.0, 3.0]).mirrored(np.arange(2)) is None
    one = layouts.spherical([0.1], [0.0], [0.1, 0.2], [0.0])
    assert one.one_light_azimuth and one.exchanged(np.arange(2)).tolist() == [0, -1]
    assert LAYOUTS["scattered"].solid_angles(*LAYOUTS["scattered"].directions()) is None
    assert not LAYOUTS["in_plane"].covers(*(Direction(*w) for w in ([0.6, 0.0, 0.8], [0.0, 0.6, 0.8])))


def test_a_layout_shows_its_axes_in_a_few_lines():
    for grid in LAYOUTS.values():
        assert grid.name in repr(grid) and len(repr(grid).splitlines()) <= 5

"""Materials and tables in the hands of a user: plain arrays in, plain arrays out, mistakes refused in one sentence."""

import itertools
import math

import numpy as np
import pytest

import gonio
from gonio.data.flags import Flag
from gonio.data.layouts import spherical_angles
from gonio.data.table import whole_table_of_values
from gonio.models.errors import GonioError
from support.tables import LAYOUTS, assert_same, random_table

COLOURED = "lambert(rho=[0.3, 0.2, 0.1]) + ggx(alpha=0.2, f0=0.04)"
GREY = "lambert(rho=0.5)"
HALF_PI = math.pi / 2
RNG = np.random.default_rng(0)


def value(theta_i, theta_o):
    return gonio.material(COLOURED).f(theta_i, 0.0, theta_o, np.pi)


@pytest.mark.parametrize("shapes", [((), ()), ((3,), (3,)), ((4, 1), (3,)), ((2, 1, 1), (1, 3, 2))])
def test_values_have_the_broadcast_shape_and_a_channel_axis(shapes):
    theta_i, theta_o = (RNG.uniform(0, 1.4, s) for s in shapes)
    f = value(theta_i, theta_o)
    assert f.shape == (*np.broadcast_shapes(*shapes), 3)
    for index in np.ndindex(f.shape[:-1]):  # as many directions as channels mix nothing up
        one = [np.broadcast_to(a, f.shape[:-1])[index] for a in (theta_i, theta_o)]
        np.testing.assert_allclose(f[index], value(*one), rtol=1e-12)
    assert gonio.material(GREY).f(theta_i, 0, theta_o, 0).shape == (*f.shape[:-1], 1)


def test_degrees_are_degrees():
    m, angles = gonio.material(COLOURED), np.array([10.0, 20.0, 40.0])
    in_radians = m.f(np.radians(angles), 0, math.radians(30), math.radians(170))
    np.testing.assert_allclose(m.f(angles, 0, 30, 170, degrees=True), in_radians)
    u1, u2 = RNG.random((2, 50))
    drawn = m.sample(math.radians(20), math.radians(5), u1, u2)
    np.testing.assert_allclose(m.sample(20, 5, u1, u2, degrees=True), np.degrees(drawn))
    np.testing.assert_allclose(m.albedo(angles, degrees=True).value, m.albedo(np.radians(angles)).value)


def test_the_sampler_estimates_the_albedo():
    m, n = gonio.material(COLOURED), 200
    u1, u2 = ((g.ravel() + 0.5) / n for g in np.meshgrid(range(n), range(n)))
    theta_o, phi_o = m.sample(0.5, 0.2, u1, u2)
    weight = np.maximum(np.cos(theta_o), 0) / m.pdf(0.5, 0.2, theta_o, phi_o)
    albedo = m.albedo(0.5, 0.2)
    assert albedo.value.shape == albedo.bound.shape == (3,) and albedo.bound.max() < 1e-6
    # The stratified estimate converges as 1/n; its own halves tell how far.
    np.testing.assert_allclose((m.f(0.5, 0.2, theta_o, phi_o) * weight[:, None]).mean(0), albedo.value, rtol=2 / n)


def test_gradients_are_differences_of_values():
    step, at = 1e-6, (0.4, 0.0, [0.3, 0.5], 3.0)
    text = "lambert(rho=[{}, 0.2, 0.1]) + {} * ggx(alpha={}, f0=0.04)"
    start = [0.3, 0.7, 0.2]
    gradient = gonio.material(text.format(*start)).gradient(*at)
    assert set(gradient) == {"lambert.rho", "ggx.scale", "ggx.alpha", "ggx.f0"}
    for k, name in enumerate(("lambert.rho", "ggx.scale", "ggx.alpha")):
        moved = [[v + s * step * (j == k) for j, v in enumerate(start)] for s in (1, -1)]
        up, down = (gonio.material(text.format(*v)).f(*at) for v in moved)
        channels = slice(0, 1) if k == 0 else slice(None)
        np.testing.assert_allclose(gradient[name][:, channels], ((up - down) / (2 * step))[:, channels], rtol=1e-7)
    np.testing.assert_allclose(gradient["lambert.rho"], 1 / math.pi, rtol=1e-12)
    assert gonio.material(random_table(LAYOUTS["isotropic"])).gradient(*at) == {}


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ((60.0, 0, 0, 0), "theta_i has the angle 60 radians.*degrees=True"),
        ((0, 180.0, 0, 0), "phi_i has the angle 180 radians.*degrees=True"),
        ((-0.1, 0, 0, 0), "theta_i has the angle -0.1 radians"),
        ((0, 0, 3.2, 0), "theta_o has the angle 3.2 radians, outside 0 to 180 degrees"),
        ((np.nan, 0, 0, 0), "theta_i has the angle nan"),
        (([0.1, 0.2], 0, [0.1, 0.2, 0.3], 0), r"do not broadcast: theta_i \(2,\).*theta_o \(3,\)"),
        (("x", 0, 0, 0), "theta_i is no array of numbers"),
        (([[0.1], [0.1, 0.2]], 0, 0, 0), "theta_i is no array of numbers"),
        ((1j, 0, 0, 0), "theta_i is no array of numbers"),
    ],
)
def test_wrong_angles_and_shapes_are_refused(arguments, reason):
    m = gonio.material(GREY)
    for method in (m.f, m.pdf, m.gradient):
        with pytest.raises(GonioError, match=reason):
            method(*arguments)


def test_what_cannot_be_is_refused_elsewhere_too():
    m = gonio.material(GREY)
    with pytest.raises(GonioError, match="190 degrees, outside 0 to 180 degrees; give angles in there"):
        m.f(190, 0, 0, 0, degrees=True)
    with pytest.raises(GonioError, match="u1 leaves"):
        m.sample(0.1, 0, 1.5, 0.5)
    with pytest.raises(GonioError, match="reaches the horizon"):
        m.albedo(HALF_PI)


@pytest.mark.parametrize("kind", ["<f4", ">f4", ">f8"])
def test_half_a_turn_in_single_precision_is_behind_the_sample(kind):
    """Single precision rounds π up."""
    table = gonio.Table.from_arrays(np.zeros(1, kind), 0, np.array([np.pi], kind), 0, np.array([0.25], kind))
    assert table.layout.angles()[2] == math.pi and table.f[0, 0] == 0.25
    assert gonio.material("thin_sheet(rho=0.3, tau=0.4)").f(0, 0, np.array([np.pi], kind), 0) > 0


def test_a_material_is_saved_and_read_again(tmp_path):
    m = gonio.material(COLOURED)
    assert gonio.material(m.save(tmp_path / "m.toml")).expression == m.expression
    with pytest.raises(GonioError, match="exists already"):
        m.save(tmp_path / "m.toml")
    with pytest.warns(DeprecationWarning, match="called expression"):
        assert m.spelling == m.expression


def test_a_table_of_arrays_holds_the_readings():
    theta_o = np.array([10.0, 30.0, 90.0])
    f = np.array([[0.1, 0.2], [0.3, np.inf], [0.5, 0.6]])
    table = gonio.Table.from_arrays(
        20, 0, theta_o, -90, f, u_f=[[0.01, np.nan]] * 3, degrees=True, wavelengths_nm=[450, 633.0], name="mine"
    )
    assert table.name == "mine" and table.channels.wavelengths_nm == (450.0, 633.0)
    assert table.dims == ("sample", "channel") and table.shape == (3, 2)
    _, wo = table.layout.directions()
    np.testing.assert_allclose(spherical_angles(*wo), [np.radians(theta_o), np.full(3, 1.5 * np.pi)], atol=1e-15)
    flags = [[Flag.VALID] * 2, [Flag.VALID, Flag.INVALID], [Flag.BELOW_HORIZON] * 2]
    np.testing.assert_array_equal(table.flag, flags)
    np.testing.assert_array_equal(table.f[:2], np.where(np.isinf(f), np.nan, f)[:2])
    np.testing.assert_array_equal(table.u_f, [[0.01, np.nan]] * 3)
    grid = gonio.Table.from_arrays([[0.1], [0.2]], 0, [0.1, 0.2, 0.3], 0, 1.0)
    assert grid.shape == (6, 1) and grid.channels.names == ("grey",)


@pytest.mark.parametrize(
    ("f", "options", "reason"),
    [
        ([1, 2, 3], {}, "f has shape.*the angles make"),
        ([1, 2], {"u_f": [1, 2, 3]}, "u_f has shape"),
        ([1, 2], {"u_f": -1}, "negative"),
        ([1, 2], {"wavelengths_nm": [450, 550]}, "layout and channels make"),
        ([[1, 2], [1, 2]], {"channels": ["a"]}, "layout and channels make"),
        (["a", "b"], {}, "f is no array of numbers"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(f, options, reason):
    with pytest.raises(GonioError, match=reason):
        gonio.Table.from_arrays(0.1, 0, [0.1, 0.2], 0, f, **options)
    with pytest.raises(GonioError, match="degrees=True"):
        gonio.Table.from_arrays(0.1, 0, [10, 20], 0, [1, 2])
    with pytest.raises(TypeError, match="did you mean 'channels'"):
        gonio.Table.from_arrays(0.1, 0, 0.1, 0, 1, chanels=["a"])


@pytest.mark.parametrize(
    ("name", "u_f"), list(zip(LAYOUTS, itertools.cycle(["stored", "exact", "unknown"]), strict=False))
)
def test_a_table_goes_through_xarray_unchanged(name, u_f, tmp_path):
    xarray = pytest.importorskip("xarray")
    table = random_table(LAYOUTS[name], u_f=u_f)
    dataset = table.to_xarray()
    assert_same(gonio.Table.from_xarray(dataset), table)
    table.save(tmp_path / "t.h5")
    with xarray.open_dataset(tmp_path / "t.h5", engine="h5netcdf") as opened:
        xarray.testing.assert_identical(dataset, opened)
    assert dataset.f.dims == table.dims and dataset.attrs["layout"] == table.layout.name
    with pytest.raises(GonioError, match=r"^the dataset"):
        gonio.Table.from_xarray(dataset.drop_vars("flag"))


def test_a_table_is_saved_in_the_format_of_the_name(tmp_path):
    grid = LAYOUTS["isotropic"]
    table = whole_table_of_values(grid, RNG.random((*grid.shape, 3)))
    for suffix in ("h5", "csv"):
        trip = table.save(tmp_path / f"t.{suffix}")
        assert trip.max_absolute == 0 and trip.lost == 0
        with pytest.raises(GonioError, match="exists already"):
            table.save(tmp_path / f"t.{suffix}")
    with pytest.raises(GonioError, match=r"ends in '\.xyz'; give \.h5 \(HDF5\), .* or \.csv \(CSV\)"):
        table.save(tmp_path / "t.xyz")


def test_what_a_mask_hides_is_no_number():
    hidden, angles = np.array([False, True, False]), np.array([0.1, 0.2, 0.3])
    f, u = np.ma.array([0.1, 0.2, 0.3], mask=hidden), np.ma.array([0.1, 0.2, 0.3], mask=hidden[::-1] | hidden)
    table = gonio.Table.from_arrays(angles, 0, angles, 0, f, u_f=u)
    np.testing.assert_array_equal(table.flag[...].ravel() != Flag.VALID, hidden)
    np.testing.assert_array_equal(np.isnan(table.u_f[...].ravel()), hidden)
    with pytest.raises(GonioError, match="theta_i has the angle nan"):
        gonio.material(GREY).f(np.ma.array(angles, mask=hidden), 0, 0.1, 0)
    unmasked = gonio.material(GREY).f(np.ma.array(angles), 0, 0.1, 0)
    np.testing.assert_array_equal(unmasked, gonio.material(GREY).f(angles, 0, 0.1, 0))

"""Tables of random values on every layout, and what it means that two are the same."""

import numpy as np

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.layouts import Layout
from gonio.data.table import Channels, Table, whole_table_of_values

LAYOUTS = {
    "spherical": layouts.spherical([0.1, 0.5], [0, 1, 2], [0.2, 0.4], [0.0, 3.0]),
    "isotropic": layouts.isotropic([0.1, 0.5], [0.2, 0.4, 1.2], [0.0, 1.5, 3.0]),
    "half_difference": layouts.merl(counts=(4, 5, 6)),
    "anisotropic half_difference": layouts.half_difference([0, 0.3], [0.1, 0.5], [0, 1], [0, 2, 4]),
    "in_plane": layouts.in_plane([0.1, 0.5], [-0.4, 0.0, 0.2]),
    "scattered": layouts.scattered([0.1, 0.5, 0.2], [0, 1, 2], [0.3, 0.3, 0.3], [3, 2, 1]),
}
PROVENANCE = {"material": "lambert(rho=0.5)", "seed": 7, "größe": [1.5, None, "µ"]}


def random_table(grid, dtype=np.float64, u_f="stored", seed=0):
    rng = np.random.default_rng(seed)
    shape = (*grid.shape, 3)
    flag = rng.integers(0, len(Flag), shape).astype(np.uint8)
    flag[~grid.readable().reshape(grid.shape)] = Flag.BELOW_HORIZON
    f = np.where(flag == 0, rng.standard_normal(shape), np.nan).astype(dtype)
    values = {"stored": rng.random(shape).astype(dtype), "exact": np.zeros(shape, dtype), "unknown": None}[u_f]
    channels = Channels(("a", "b", "µ"), (450.0, 550.5, 632.8))
    return Table(grid, f, flag, channels, values, PROVENANCE, 1e-3, None, "a name")


def grey_table(rho: float = 0.25, step: float = 15.0, phi_step: float = 45.0, **options) -> Table:
    """A Lambertian surface on an isotropic grid, steps in degrees."""
    polar = np.radians(np.arange(0, 86, step))
    layout = layouts.isotropic(polar, polar, np.radians(np.arange(0, 360, phi_step)))
    return whole_table_of_values(layout, np.full(layout.shape, rho / np.pi), **options)


def list_in_planes() -> Layout:
    """A list of readings in the plane of incidence, both ways from the normal, in a random order."""
    polar = np.radians(np.arange(0, 86, 5))
    theta_i, theta_o, phi = np.meshgrid(polar[::3], polar, np.radians([0.0, 180.0]), indexing="ij")
    order = np.random.default_rng(2).permutation(theta_i.size)
    return layouts.scattered(*(a.ravel()[order] for a in (theta_i, 0 * theta_i, theta_o, phi)))


def assert_same(a: Table, b: Table):
    assert a.layout == b.layout and a.channels == b.channels and a.provenance == b.provenance and a.name == b.name
    assert (a.source_solid_angle, a.receiver_solid_angle) == (b.source_solid_angle, b.receiver_solid_angle)
    np.testing.assert_array_equal(a.f[...], b.f[...])
    np.testing.assert_array_equal(a.flag[...], b.flag[...])
    assert (a.u_f is None) == (b.u_f is None)
    if a.u_f is not None:
        np.testing.assert_array_equal(a.u_f[...], b.u_f[...])

"""Polarised channels between the readings: exchanged and mirrored directions have other values there."""

import numpy as np
import pytest

import gonio
from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.interpolation.multilinear import as_material, interpolation
from gonio.data.table import whole_table_of_values
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical


def mueller(theta_i, theta_o, phi):
    """m00 and m02, which is odd in the azimuth difference."""
    odd = np.sin(theta_i) * np.sin(theta_o) * np.sin(phi)
    return np.stack([0.1 + 0 * odd, 0.05 * odd], axis=-1)


def values(table, theta_i, theta_o, phi, turn=0.0):
    wi = Direction(*from_spherical(theta_i, turn + 0 * phi, np))
    wo = Direction(*from_spherical(theta_o, turn + phi, np))
    return np.asarray(evaluate(as_material(table), wi, wo))


def somewhere(n, seed, most):
    rng = np.random.default_rng(seed)
    theta_i, theta_o = np.arccos(rng.uniform(0.3, 1, (2, n)))
    return theta_i, theta_o, rng.uniform(0, most, n)


def test_grids_of_one_side_have_the_negative_on_the_other():
    theta, phi = np.radians([5, 30, 60]), np.radians(np.arange(0, 181, 30))
    f = mueller(*np.meshgrid(theta, theta, phi, indexing="ij"))
    table = whole_table_of_values(layouts.isotropic(theta, theta, phi), f, Channels(("m00", "m02")))
    where = np.full(4, np.radians(30)), np.full(4, np.radians(60)), np.radians([30, 330, 120, 240])
    assert np.allclose(values(table, *where), mueller(*where), atol=1e-6)


@pytest.mark.parametrize("most", [np.pi, 2 * np.pi], ids=["one side", "both"])
def test_lists_change_the_sign_too(most):
    a, b, phi = somewhere(80, 0, most)
    table = gonio.Table.from_arrays(a, 0.4, b, phi + 0.4, mueller(a, b, phi), channels=["m00", "m02"])
    where = somewhere(200, 1, 2 * np.pi)
    error = values(table, *where, turn=0.4) - mueller(*where)
    assert np.median(np.abs(error[:, 1])) < 0.006


@pytest.mark.parametrize("most", [np.pi, 2 * np.pi], ids=["one side", "both"])
def test_light_in_another_state_stands_for_no_exchanged_reading(most):
    def f(a, b):
        return 0.1 * np.stack([np.cos(a), np.cos(b)], axis=-1)

    a, b, phi = somewhere(80, 2, most)
    table = gonio.Table.from_arrays(a, 0, b, phi, f(a, b), channels=["s to p", "p to s"])
    x, y, z = somewhere(200, 3, 2 * np.pi)
    assert np.median(np.abs(values(table, x, y, z) / f(x, y) - 1)) < 0.03
    assert "reciprocity" not in interpolation(table)
    alike = gonio.Table.from_arrays(a, 0, b, phi, f(a, b), channels=["s to s", "p to p"])
    assert "reciprocity" in interpolation(alike)

"""What each sample is given by all others is what the inverse-distance mean of a table without it says."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.interpolation.inverse_distance import left_out, scattered_material
from gonio.data.table import Table, whole_table_of_values
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import from_spherical


@pytest.mark.parametrize("isotropic", [True, False])
def test_left_out_is_what_the_others_say(isotropic):
    rng = np.random.default_rng(0)
    theta, phi = rng.uniform(0, 1.4, (2, 40)), rng.uniform(0, 2 * np.pi, (2, 40))
    angles = np.stack([theta[0], 0 * phi[0] + 1.0 if isotropic else phi[0], theta[1], phi[1]])
    f = np.column_stack([1 + np.cos(3 * theta[0]) * np.cos(theta[1]), rng.random(40)])
    block = whole_table_of_values(layouts.scattered(*angles), f).samples()
    means = left_out(block.wi, block.wo, block.f, isotropic)
    for k in (0, 17):
        others = whole_table_of_values(layouts.scattered(*np.delete(angles, k, axis=1)), np.delete(f, k, axis=0))
        here, there = (from_spherical(*angles[n : n + 2, k : k + 1], np) for n in (0, 2))
        np.testing.assert_allclose(evaluate(scattered_material(others), here, there)[0], means[k], rtol=1e-9)


def test_a_channel_without_a_reading_is_as_if_it_had_no_such_sample():
    rng = np.random.default_rng(1)
    angles = rng.uniform(0, 1.4, (4, 12))
    f = rng.random((12, 2))
    flag = np.full(f.shape, Flag.VALID, np.uint8)
    flag[3, 1] = Flag.NOT_MEASURED
    both = scattered_material(Table(layouts.scattered(*angles), f, flag, Channels.of_count(2)))
    fewer = whole_table_of_values(layouts.scattered(*np.delete(angles, 3, axis=1)), np.delete(f[:, 1:], 3, axis=0))
    here, there = (from_spherical(*rng.uniform(0, 1.4, (2, 9)), np) for _ in range(2))
    np.testing.assert_allclose(
        evaluate(both, here, there)[:, 1], evaluate(scattered_material(fewer), here, there)[:, 0], rtol=1e-9
    )

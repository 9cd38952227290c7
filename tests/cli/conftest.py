"""A folder to work in, with a table and directions, as a user has it."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.hdf5.writer import write_table
from gonio.data.table import whole_table_of_values


def grey_table(step: float = 15.0, phi_step: float = 45.0, rho: float = 0.25, **options):
    """A table of a Lambertian surface on an isotropic grid, steps in degrees."""
    polar = np.radians(np.arange(0, 86, step))
    layout = layouts.isotropic(polar, polar, np.radians(np.arange(0, 360, phi_step)))
    return whole_table_of_values(layout, np.full(layout.shape, rho / np.pi), **options)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "d.csv").write_text("theta_i,phi_i,theta_o,phi_o\n30,0,30,180\n0,0,45,10\n")
    write_table(tmp_path / "t.h5", grey_table(name="t"))
    return tmp_path

"""Formats of red, green and blue get them in this order, whatever the channels of a table are called."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.formats.registry import read, write
from gonio.data.material import Material
from gonio.data.table import whole_table_of_values
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build

NODES = np.radians(np.arange(0, 81, 20))
LAYOUT = layouts.isotropic(NODES, NODES, np.radians(np.arange(0, 360, 45)))
VALUES = {"R": 0.3, "G": 0.2, "B": 0.05}
FILES = ("x.bin", "x.ssdd")


def table(channels: Channels, values: list[float]):
    return whole_table_of_values(LAYOUT, np.broadcast_to(values, (*LAYOUT.shape, 3)).copy(), channels, name="t")


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("order", ["RGB", "BGR", "GBR"])
def test_red_green_and_blue_stand_in_their_order(tmp_path, name, order):
    error = write(tmp_path / name, table(Channels(tuple(order)), [VALUES[c] for c in order]))
    assert error.rms_relative < 1e-6
    np.testing.assert_allclose(read(tmp_path / name).samples().f[0], list(VALUES.values()), rtol=1e-6)


@pytest.mark.parametrize("wavelengths", [[450.0, 550.0, 650.0], [650.0, 550.0, 450.0], [550.0, 650.0, 450.0]])
def test_the_longest_wavelength_is_red_and_that_is_said(tmp_path, wavelengths):
    values = [w / 1000 for w in wavelengths]
    error = write(tmp_path / "x.bin", table(Channels.of_wavelengths(wavelengths), values))
    assert error.rms_relative < 1e-6 and "650 nm, 550 nm, 450 nm as R, G, B" in error.note
    np.testing.assert_allclose(read(tmp_path / "x.bin").samples().f[0], [0.65, 0.55, 0.45], rtol=1e-6)


def test_what_is_no_red_green_and_blue_is_refused_or_named(tmp_path):
    with pytest.raises(GonioError, match="X, Y, Z"):
        write(tmp_path / "x.bin", table(Channels(("X", "Y", "Z")), [0.1, 0.2, 0.3]))
    assert "a, b, c as R, G, B" in write(tmp_path / "x.bin", table(Channels(("a", "b", "c")), [0.1, 0.2, 0.3])).note
    model = Material("m", build("lambert(rho=[0.1, 0.2, 0.3])"), None, Channels.of_wavelengths([450.0, 550.0, 650.0]))
    with pytest.raises(GonioError, match="measure it first"):
        write(tmp_path / "y.bin", model)
    assert not (tmp_path / "y.bin").exists()

"""What knows reflection alone says so to what transmits, and leaves nothing behind."""

import math

import pytest

import gonio
from gonio.instrument import scans
from gonio.models.errors import GonioError

SHEET = "thin_sheet(rho=0.3, tau=0.5)"


@pytest.fixture(scope="module")
def table():
    return gonio.measure(SHEET, scan=scans.isotropic(math.radians(30), hemisphere="both"))


@pytest.mark.parametrize(
    "method",
    [
        lambda table, path: gonio.convert(table, path / "t.binary"),
        lambda table, path: gonio.convert(SHEET, path / "t.binary"),
        lambda table, path: gonio.convert(table, path / "t.bsdf"),
        lambda table, path: gonio.convert(SHEET, path / "t.bsdf"),
    ],
)
def test_what_knows_reflection_alone_refuses_what_transmits(table, method, tmp_path):
    with pytest.raises(GonioError, match=r"transmits, and .* knows reflection from the front alone; measure that"):
        method(table, tmp_path)
    assert list(tmp_path.iterdir()) == []

"""Readings behind a sample: by the mirror image of a reflecting one, and by the signal chain's own law."""

import math

import equinox as eqx
import numpy as np
import pytest

import gonio
from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.instrument import scans
from gonio.instrument.instrument import Instrument, Systematic
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build
from gonio.models.geometry.sides import Hemispheres
from tests.support.sheets import Sheet

PAINT = "lambert(rho=0.2) + 0.5 * phong(n=20)"


class Mirrored(AbstractBRDF):
    """What a surface reflects, sent through it instead: to the mirror image behind."""

    base: AbstractBRDF
    side: int = eqx.field(static=True, default=1)

    @property
    def hemispheres(self):
        return Hemispheres.TRANSMISSION

    @property
    def isotropic(self):
        return True

    def formula(self, wi, wo):
        return self.base.f(wi._replace(z=abs(wi.z)), wo._replace(z=abs(wo.z)))


@pytest.mark.parametrize(
    "instrument",
    [
        Instrument(),
        Instrument(source_half_angle=0.02, detector_half_angle=0.03, tolerance=0.05),
        Instrument(systematic=Systematic(theta_i=0.002, phi=-0.01, gain=1.02)),
    ],
    ids=["ideal", "discs", "misaligned"],
)
def test_readings_behind_are_those_of_the_mirror_image_in_front(instrument):
    step = math.radians(30)
    front = gonio.measure(PAINT, instrument, scans.isotropic(step, phi_step=2 * step))
    behind = gonio.measure(
        Mirrored(build(PAINT)), instrument, scans.isotropic(step, phi_step=2 * step, hemisphere="transmission")
    )
    (part,) = behind.parts().values()
    np.testing.assert_allclose(part.f, front.f, rtol=1e-6)
    np.testing.assert_allclose(part.layout.axes["theta_o"], front.layout.axes["theta_o"], atol=1e-15)


def test_the_signal_chain_takes_the_size_of_the_cosine():
    """u² = f/(photons π |cosθi|): the same for light from the front and from behind."""
    sheet, photons = Sheet(0.3, 0.5), 1e4
    grid = layouts.in_plane(np.radians([60.0, 120.0]), np.radians([150.0]))
    table = gonio.measure(sheet, Instrument(photons=photons), grid, seed=3, log=str)
    lit_in_front = float(table.u_f[0, 0, 0])
    assert lit_in_front == pytest.approx(math.sqrt(0.5 / math.pi / (photons * math.pi * 0.5)), rel=1e-9)
    assert abs(table.f[0, 0, 0] - 0.5 / math.pi) < 5 * lit_in_front


def test_a_detector_behind_stands_in_the_light_only_where_both_graze():
    instrument = Instrument(shadow=math.radians(12))
    grid = layouts.isotropic(np.radians([0.0, 85.0]), np.radians([95.0, 180.0]), [0.0, math.pi])
    flag = gonio.measure(Sheet(0.3, 0.5), instrument, grid, log=str).flag[..., 0]
    expected = np.zeros(grid.shape)
    expected[1, 0, 0] = Flag.SHADOWED
    np.testing.assert_array_equal(flag, expected)


def test_where_nothing_is_said_a_scan_goes_where_the_material_scatters():
    step = math.radians(45)
    sheet, remarks = Sheet(0.3, 0.5), []
    assert gonio.measure(Mirrored(build(PAINT)), scan="in-plane").sides == {(1, -1)}
    assert gonio.measure(sheet, scan="in-plane").sides == {(1, 1), (1, -1)}
    assert gonio.measure(sheet, scan="in-plane", hemisphere="reflection").sides == {(1, 1)}  # said, so no remark
    assert gonio.measure(sheet, scan=scans.isotropic(step), log=remarks.append).sides == {(1, 1)}
    behind = scans.isotropic(step, hemisphere="transmission")
    assert gonio.measure(sheet, scan=behind, log=remarks.append).sides == {(1, -1)}
    gonio.measure(PAINT, scan=scans.isotropic(step, hemisphere="both"), log=remarks.append)
    said = [text for text in remarks if "cells" not in text]
    assert "transmits, but the scan leaves its transmission out" in said[0]
    assert "reflects, but the scan leaves its reflection out" in said[1]
    assert "nothing says that the material transmits" in said[2] and len(said) == 3
    with pytest.raises(GonioError, match="leave hemisphere and lit out"):
        gonio.measure(sheet, scan=scans.isotropic(step), hemisphere="both")

"""Quantities of polished surfaces: textbook digits, and a sum of specular and scattered light that is the mirror's."""

import numpy as np
import pytest

import gonio

MIRROR = "rayleigh_rice(wavelength=[0.5, 1.0], eta=1.37, k=7.62, sigma=0.005, tau=20, spectrum=gaussian)"


def test_total_integrated_scatter_of_fifty_angstrom():
    rows = gonio.quantities(MIRROR, only=["albedo"]).quantities
    value = {(q.name, q.place, q.channel): q.value for q in rows}
    assert value["(4πσ cosθi/λ)²", "θi 0°", "500 nm"] == pytest.approx(0.0157914, abs=1e-7)
    assert value["total integrated scatter", "θi 0°", "500 nm"] == pytest.approx(0.0157914, rel=1e-3)
    assert value["total integrated scatter", "θi 0°", "1000 nm"] == pytest.approx(0.0157914 / 4, rel=2e-3)
    assert value["rms height, µm", "up to 1/λ", "500 nm"] == pytest.approx(0.005, rel=1e-12)
    smooth = abs((1.37 + 7.62j - 1) / (1.37 + 7.62j + 1)) ** 2
    specular = value["specular reflectance", "θi 0°", "500 nm"]
    np.testing.assert_allclose(specular, smooth * np.exp(-0.0157914), rtol=1e-6)


def test_other_materials_have_none_of_them():
    assert not any("specular" in q.name for q in gonio.quantities("lambert(rho=0.5)", only=["albedo"]).quantities)

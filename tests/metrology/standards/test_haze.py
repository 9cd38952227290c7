"""Haze and the other quantities of what transmits, in closed form and against rays thrown through a sphere's port."""

import numpy as np
import pytest

from gonio.data.subject import load_material
from gonio.metrology.quantities import quantities
from gonio.metrology.standards.haze import haze
from gonio.metrology.standards.of_models import of_model
from gonio.models.errors import GonioError


@pytest.mark.parametrize("n", [100, 500, 2000])
def test_haze_of_a_cosine_power(n):
    """By angle cos^(n+2) 2.5° [ORACLES]; of a sphere, rays from a disc of 2.7° against a port of 4°."""
    diffuser = load_material(f"cosine_power_transmission(tau=[0.8, 0.4], n={n})")
    by_angle, sphere = (
        [q for q in of_model(diffuser, haze())[0] if q.name == name]
        for name in ("haze beyond 2.5°", "haze of a sphere")
    )
    assert [q.value for q in by_angle] == pytest.approx(2 * [np.cos(np.radians(2.5)) ** (n + 2)], abs=1e-6)
    assert all(q.bound < 5e-6 for q in by_angle)
    u, rays = np.random.default_rng(0).random((4, 400_000)), 400_000
    angle, start = np.arccos(u[0] ** (1 / (n + 2))), np.radians(2.7) * np.sqrt(u[1])
    meets = start**2 + angle**2 + 2 * start * angle * np.cos(2 * np.pi * u[2]) < np.radians(4.0) ** 2
    expected = 1 - meets.mean()
    assert sphere[0].value == pytest.approx(expected, abs=5 * np.sqrt(expected / rays))


def test_quantities_of_a_sheet():
    rows = quantities("thin_sheet(rho=0.3, tau=0.4)", geometries=["30:150:90"]).quantities
    by_name = {(q.name, q.place): q.value for q in rows}
    for theta in (0, 60):
        for name, value in (("albedo", 0.3), ("transmittance", 0.4), ("absorptance", 0.3)):
            assert by_name[name, f"θi {theta}°"] == pytest.approx(value, abs=1e-9)
    assert by_name["transmittance under uniform light", ""] == pytest.approx(0.4, abs=1e-6)
    assert by_name["transmittance factor", "0:180"] == pytest.approx(0.4)
    assert by_name["transmittance factor", "30:150:90"] == pytest.approx(0.4)
    assert by_name["scattering function f cosθo", "30:150:90"] == pytest.approx(0.4 / np.pi * np.sqrt(0.75))
    assert by_name["haze beyond 2.5°", "θi 0°"] == pytest.approx(np.cos(np.radians(2.5)) ** 2, abs=1e-6)
    with pytest.raises(GonioError, match="no geometry"):
        quantities("thin_sheet(rho=0.3, tau=0.4)", geometries=["30:90"])

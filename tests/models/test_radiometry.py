"""The textbook's own results of radiometry, and the laws that its definitions must obey."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gonio.models import radiometry
from gonio.models.geometry import solid_angle

positive = st.floats(1e-3, 1e3)


def test_every_quantity_has_a_symbol_and_a_unit():
    for name in ("flux", "irradiance", "radiant exitance", "radiosity", "radiance", "intensity"):
        assert radiometry.QUANTITIES[name].symbol
    units = {name: q.unit for name, q in radiometry.QUANTITIES.items()}
    assert (units["flux"], units["intensity"], units["radiance"]) == ("W", "W/sr", "W/(m² sr)")
    assert units["irradiance"] == units["radiant exitance"] == units["radiosity"] == "W/m²"


@given(positive)
def test_diffuse_emitter(radiance):
    exitance = radiometry.diffuse_exitance(radiance)
    assert exitance == pytest.approx(radiometry.irradiance(radiance, solid_angle.PROJECTED_HEMISPHERE), rel=1e-15)
    assert exitance == pytest.approx(np.pi * radiance, rel=1e-15)
    assert radiometry.diffuse_radiance(exitance) == pytest.approx(radiance, rel=1e-15)


def test_cap_of_sky_by_quadrature():
    x, w = np.polynomial.legendre.leggauss(30)
    for s in (0.01, 0.5, np.pi / 2):
        theta = s * (x + 1) / 2
        sky = 2 * np.pi * np.sum(w * s / 2 * 7.0 * np.cos(theta) * np.sin(theta))
        assert radiometry.irradiance_of_cap(7.0, s) == pytest.approx(sky, rel=1e-13)


@given(positive, st.floats(1.0, 1e4))
def test_sphere_is_the_cap_that_it_covers(radius, ratio):
    distance = radius * ratio
    sphere = radiometry.irradiance_of_sphere(2.0, radius, distance)
    assert sphere == pytest.approx(float(radiometry.irradiance_of_cap(2.0, np.arcsin(radius / distance))), rel=1e-12)


def test_far_sphere_is_a_point_source():
    # A sphere of radiance L has the intensity L πR²; at any distance, since E falls exactly as 1/d².
    point = radiometry.irradiance_of_point(3.0 * np.pi * 0.1**2, 1.0, 5.0)
    assert radiometry.irradiance_of_sphere(3.0, 0.1, 5.0) == pytest.approx(float(point), rel=1e-14)
    assert radiometry.irradiance_of_point(1.0, -0.5, 5.0) == 0


@given(positive, positive, st.floats(0.01, 1.0), st.floats(0.01, 1.0), positive, positive)
def test_radiance_is_invariant_along_a_ray(area_1, area_2, cos_1, cos_2, distance, radiance):
    """dA₁ cos₁ dω₁ = dA₂ cos₂ dω₂, so the flux gives one radiance, seen from either end."""
    sent = radiometry.etendue(area_1, cos_1, radiometry.solid_angle_of_element(area_2, cos_2, distance))
    received = radiometry.etendue(area_2, cos_2, radiometry.solid_angle_of_element(area_1, cos_1, distance))
    assert sent == pytest.approx(received, rel=1e-14)
    assert radiometry.radiance(radiance * sent, received) == pytest.approx(radiance, rel=1e-14)


@given(st.floats(0.01, 1.5), st.floats(1.0, 3.0), st.floats(0.0, 1.0))
def test_basic_radiance_is_invariant_across_an_interface(theta_1, n_2, transmittance):
    """The flux that is not reflected, over the étendue that Snell's law makes of the beam's."""
    n_1, d_theta = 1.0, 1e-5
    # Snell's invariant n sinθ gives n² cosθ dω the same on both sides: the band between two rays.
    edges = [np.arcsin(n_1 / n_2 * np.sin(theta_1 + e)) for e in (-d_theta, d_theta)]
    sent = solid_angle.projected_band(theta_1 - d_theta, theta_1 + d_theta)
    passed = solid_angle.projected_band(*edges)
    behind = radiometry.radiance_across(5.0, n_1, n_2, transmittance)
    assert behind * passed == pytest.approx(float(transmittance * 5.0 * sent), rel=1e-8)
    assert radiometry.basic_radiance(behind, n_2) == pytest.approx(
        transmittance * radiometry.basic_radiance(5.0, n_1), rel=1e-14
    )


@given(st.floats(0.0, 1.0), positive, st.floats(0.01, 1.0), st.floats(1e-8, 1e-2))
def test_brdf_is_what_a_small_source_gives(f, radiance, cos_i, d_omega):
    out = radiometry.reflected_radiance(f, radiance, cos_i, d_omega)
    found = radiometry.brdf(out, radiometry.irradiance(radiance, cos_i * d_omega))
    assert found == pytest.approx(f, rel=1e-14)


@given(st.floats(0.0, 0.999), positive)
def test_radiosity_of_a_closed_cavity(rho, exitance):
    """In a closed diffuse cavity E = J: radiosity is M/(1 − ρ), the sum over all reflections."""
    cavity = exitance / (1 - rho)
    assert radiometry.radiosity(exitance, rho, cavity) == pytest.approx(cavity, rel=1e-12)
    assert radiometry.radiosity(exitance, 0.0, cavity) == exitance

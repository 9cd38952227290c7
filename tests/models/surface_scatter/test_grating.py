"""Gratings: orders where they stand, scalar efficiencies, the shallow limit, and where they are used beyond it."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import jv

from gonio.data.subject import load_material
from gonio.models.albedo import directional_albedo
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.surface_scatter.bessel import bessel_j
from gonio.models.surface_scatter.perturbation import polarisation_factor

DISC = "grating(wavelength=0.532, period=1.6, depth=0.1, width=0.002{})"
NORMAL = Direction(jnp.asarray(0.0), jnp.asarray(0.0), jnp.asarray(1.0))


def test_bessel_functions_to_their_own_digits():
    m, x = np.array([0, 1, 2, 7, 30, 100.0])[:, None], np.array([1e-6, 0.3, 2.404825557695773, 9, 40, 63])
    with np.errstate(under="ignore"):
        expected = jv(m, x)
    found = np.asarray(bessel_j(jnp.asarray(m), jnp.asarray(x)[None, :]))
    zero = (m == 0) & (np.arange(6) == 2)  # of J_0 itself: 0 to rounding
    np.testing.assert_allclose(np.where(zero, 0, found), np.where(zero, 0, expected), rtol=2e-12)
    assert abs(found[0, 2]) < 1e-15


def test_orders_stand_where_the_textbook_says():
    """1.6 µm at 532 nm and normal incidence: 19.421°, 41.682°, 85.948°; a scan of f cosθ has its peaks there."""
    theta = np.radians(np.arange(0, 90, 0.002))
    f = np.asarray(evaluate(build(DISC.format("")), NORMAL, from_spherical(theta, np.zeros_like(theta), np)))
    inner = f[1:-1]
    peaks = np.degrees(theta[1:-1][(inner > f[:-2]) & (inner >= f[2:]) & (inner > 1e-9 * f.max())])
    np.testing.assert_allclose(peaks, [19.421, 41.682, 85.948], atol=0.3)
    np.testing.assert_allclose(peaks[:2], [19.421, 41.682], atol=0.01)


def test_a_turned_grating_throws_its_orders_on_a_cone():
    """β_o = −β_i + m λ/d across the grooves: the peak is the Gaussian's 1/(2πw²) times the efficiency."""
    model = build(DISC.format(", azimuth=30"))
    wi = from_spherical(jnp.asarray(0.5), jnp.asarray(1.1))
    for order in (-1, 0, 1, 2):
        x = -float(wi.x) + order * 0.532 / 1.6 * np.cos(np.radians(30))
        y = -float(wi.y) + order * 0.532 / 1.6 * np.sin(np.radians(30))
        wo = Direction(*(jnp.asarray(c) for c in (x, y, np.sqrt(1 - x * x - y * y))))
        eta = jv(order, 2 * np.pi / 0.532 * 0.05 * (float(wi.z) + float(wo.z))) ** 2
        assert float(evaluate(model, wi, wo)) * 2 * np.pi * 0.002**2 == pytest.approx(eta, rel=1e-11)


def test_each_order_carries_its_efficiency():
    """The integral about one order: J_m² of the sinusoid, and the closed form of the lamellar profile."""
    for inside, efficiency in (
        ("", lambda m, phase: jv(m, phase / 2) ** 2),
        (
            ", profile=lamellar, duty=0.3",
            lambda m, phase: (
                (2 * np.sin(phase / 2) * np.sin(np.pi * m * 0.3) / (np.pi * m)) ** 2
                if m
                else 1 - 4 * 0.3 * 0.7 * np.sin(phase / 2) ** 2
            ),
        ),
    ):
        model = build(DISC.format(inside))
        cosines = np.sqrt(1 - (np.arange(-3, 4) * 0.532 / 1.6) ** 2)
        phases = 2 * np.pi / 0.532 * 0.1 * (1 + cosines)
        total = sum(efficiency(m, p) for m, p in zip(range(-3, 4), phases, strict=True))
        # The third order stands 0.0025 = 1.25 widths from the rim: what its lobe loses there is left to the bound.
        lost = efficiency(3, phases[0]) * 2 * 0.11
        assert directional_albedo(model, 0.0).value == pytest.approx(total - lost / 2, abs=lost / 2 + 2e-5)


@pytest.mark.parametrize("theta", [0.0, 0.5, 1.2])
def test_the_shallow_limit_is_rayleigh_rices_first_order(theta):
    """k²a² cosθi cosθ1 |q|² exactly with the weight "perturbation"; with Fresnel's, where the grooves are wide."""
    wi = from_spherical(jnp.asarray(theta), jnp.asarray(0.4))
    eta, k, depth = 1.37, 7.62, 1e-4
    for weight, period, close in (("perturbation", 1.6, 1e-6), ("fresnel", 20.0, 0.05)):
        model = build(f"grating(wavelength=0.6328, period={period}, depth={depth}, weight={weight}, eta={eta}, k={k})")
        x, y = -float(wi.x) + 0.6328 / period, -float(wi.y)
        wo = Direction(*(jnp.asarray(c) for c in (x, y, np.sqrt(1 - x * x - y * y))))
        q2 = float(polarisation_factor(wi, wo, jnp.asarray(eta), jnp.asarray(k)))
        first_order = (2 * np.pi / 0.6328 * depth / 2) ** 2 * float(wi.z * wo.z) * q2
        assert float(model.efficiency(jnp.asarray(1.0), wi, wo)) == pytest.approx(first_order, rel=close)


def test_lobes_are_no_wider_than_orders_stand_apart():
    model = build("grating(wavelength=0.4, period=20, depth=0.1, width=0.1)")
    assert float(model.lobe_width) == pytest.approx(0.25 * 0.02)


def test_scalar_efficiencies_gain_towards_grazing_and_it_is_said():
    deep = build("grating(wavelength=0.532, period=1.6, depth=0.17, profile=lamellar, duty=0.4)")
    assert directional_albedo(deep, np.radians(80), tolerance=1e-4).value > 1.1
    assert "grazing" in deep.violates["energy"]
    assert "period" in deep.validity_notes[0] or "periods" in deep.validity_notes[0]
    assert build("grating(wavelength=0.5, period=10, depth=0.1)").validity_notes == ()
    assert "slopes" in build("grating(wavelength=0.3, period=2, depth=0.4)").validity_notes[-1]


def test_symmetry_is_that_of_the_grooves():
    assert build(DISC.format("")).symmetric and not build(DISC.format(", azimuth=30")).symmetric
    assert not (build("lambert(rho=0.1)") + build(DISC.format(", azimuth=30"))).symmetric
    assert not build(DISC.format("")).isotropic


def test_the_compact_disc_has_wavelengths_of_its_file():
    disc = load_material("compact_disc")
    np.testing.assert_allclose(1000 * np.asarray(disc.brdf.wavelength), disc.channels.wavelengths_nm, rtol=1e-14)
    assert "wavelength=[0.41328" in disc.expression


def test_the_perturbations_weight_needs_an_index():
    with pytest.raises(GonioError, match="no eta"):
        build(DISC.format(", weight=perturbation"))

"""Quantities of standards of models against closed forms, and their uncertainty by the covariance of a fit."""

import dataclasses
import math

import numpy as np
import pytest
import scipy.optimize
from scipy.integrate import dblquad

import gonio
from gonio.data.channels import Channels
from gonio.data.layouts import isotropic
from gonio.data.table import whole_table_of_values
from gonio.metrology.fit_numbers import FitNumbers
from gonio.metrology.standards.catalog import Wanted, standard_quantities
from gonio.metrology.standards.gloss import GLASS, RECEPTORS, SOURCE, fresnel_of_glass, gloss
from gonio.metrology.standards.of_models import of_model
from gonio.metrology.standards.reflectance import multi_angle, reflectance
from gonio.metrology.standards.scatter import scatter
from gonio.metrology.standards.scatter_law import LAWS, descended, scatter_laws
from gonio.metrology.standards.scatter_law import of_model as profile_of_model

RHO = 0.4


def values(model, entries):
    rows, undecided = of_model(gonio.material(model), entries)
    assert not undecided
    return {f"{q.name} {q.place}".strip(): q for q in rows}


@pytest.fixture(scope="module")
def matt():
    material = gonio.material(f"lambert(rho={RHO})")
    rows, undecided = of_model(material, standard_quantities(material.channels, Wanted(), False)[0])
    assert [u.name for u in undecided] in ([], ["distinctness of image"])
    return {f"{q.name} {q.place}".strip(): q for q in rows}


def test_of_a_lambertian_every_factor_is_its_albedo(matt):
    for name in ("45°a:0°", "0°:45°a", "8°:di", "45°:as15°", "45°:as110°", "BRF", "DHR"):
        assert matt[name].value == pytest.approx(RHO, abs=1e-9), name
    # Without a disc of 5° about the direction of 8°: ∫ cosθ dω = π cos 8° sin² 5°.
    outside = RHO * (1 - math.cos(math.radians(8)) * math.sin(math.radians(5)) ** 2)
    assert matt["8°:de"].value == pytest.approx(outside, abs=1e-9)
    assert matt["haze 2°"].value == pytest.approx(100) and matt["contrast gloss"].value == pytest.approx(1)


def test_of_a_lambertian_scatter_is_by_the_squares_of_sines(matt):
    for low, high in ((2.5, 5), (15, 45), (85, 90)):
        share = math.sin(math.radians(high)) ** 2 - math.sin(math.radians(low)) ** 2
        assert matt[f"scatter {low:g}° to {high:g}°"].value == pytest.approx(RHO * share, rel=1e-7)
    assert matt["total integrated scatter"].value == pytest.approx(math.cos(math.radians(2.5)) ** 2, rel=1e-7)


def test_retroreflection_is_f_times_both_cosines(matt):
    angles = [(4, 4.2), (30, 29.67)]
    for (theta_i, theta_o), place in zip(angles, ("-4°, 0.2°", "30°, 0.33°"), strict=True):
        cosines = math.cos(math.radians(theta_i)) * math.cos(math.radians(theta_o))
        assert matt[f"R_A {place}"].value == pytest.approx(RHO / math.pi * cosines, rel=1e-12)


@pytest.mark.parametrize("angle", [20, 60, 85])
def test_gloss_of_a_lambertian_is_the_receptor_over_black_glass(matt, angle):
    """∫ cosθ dω over the receptor and the mean reflectance of glass over the source, by adaptive quadrature."""
    t, (width, height) = math.radians(angle), np.radians(RECEPTORS[angle])

    def projected(y, x):
        return (math.cos(t) - x * math.sin(t)) / (1 + x * x + y * y) ** 2

    a, b = math.tan(width / 2), math.tan(height / 2)
    receptor = dblquad(projected, -a, a, -b, b)[0]
    x = np.tan(np.radians(np.linspace(-SOURCE[0] / 2, SOURCE[0] / 2, 201)))
    y = np.tan(np.radians(np.linspace(-SOURCE[1] / 2, SOURCE[1] / 2, 201)))[:, None]
    length = np.sqrt(1 + x**2 + y**2)
    glass = np.average(fresnel_of_glass((math.cos(t) - x * math.sin(t)) / length), weights=length**-3)
    assert matt[f"gloss {angle}°"].value == pytest.approx(100 * RHO / math.pi * receptor / glass, rel=2e-4)


def test_a_polished_black_glass_has_100_gloss_units():
    """The image of the source alone: with 0.1 nm of roughness the rest scatters 1e-5."""
    glass = values(f"rayleigh_rice(wavelength=0.55, eta={GLASS}, sigma=0.0001, tau=20, spectrum=gaussian)", gloss())
    assert [q.value for q in glass.values()] == pytest.approx([100.0] * 3, abs=0.01)


def test_narrow_lobes_of_black_glass_approach_100_gloss_units():
    made = [values(f"beckmann(alpha={a}, eta={GLASS})", gloss()) for a in (0.005, 0.0005)]
    for name in made[0]:
        off = [abs(m[name].value - 100) for m in made]
        assert off[1] < 0.1 and off[1] <= off[0] + 0.02 and made[1][name].uncertainty < 0.1


def test_ggx_of_width_1():
    """f = 1/(2π(μi + μo)), so that E(μ) = 1 − μ log((1 + μ)/μ), and a reflectance factor is 1/(2(μi + μo))."""
    mu, rows = math.cos(math.radians(8)), values("ggx(alpha=1)", [*reflectance(5.0), *multi_angle()])
    assert rows["8°:di"].value == pytest.approx(1 - mu * math.log((1 + mu) / mu), abs=1e-6)
    for angle in (15, 45, 75, 110):
        sum_of_cosines = math.cos(math.radians(45)) + math.cos(math.radians(45 - angle))
        assert rows[f"45°:as{angle}°"].value == pytest.approx(1 / (2 * sum_of_cosines), rel=1e-9)
    low, high, near = (math.cos(math.radians(a)) for a in (40, 50, 5))
    total = dblquad(lambda a, b: a * b / (2 * (a + b)), near, 1, high, low)[0]
    assert rows["45°a:0°"].value == pytest.approx(total * 4 / ((1 - near**2) * (low**2 - high**2)), rel=1e-8)


def test_total_integrated_scatter_of_a_polished_surface():
    """(4πσ/λ)² exp(−(πτ sin 2.5°/λ)²): a Gaussian spectrum of heights beyond the frequency of 2.5°."""
    sigma, tau, wavelength = 0.002, 2.0, 0.5
    model = f"rayleigh_rice(wavelength={wavelength}, eta=1.37, k=7.62, sigma={sigma}, tau={tau}, spectrum=gaussian)"
    outside = math.exp(-((math.pi * tau * math.sin(math.radians(2.5)) / wavelength) ** 2))
    expected = (4 * math.pi * sigma / wavelength) ** 2 * outside
    assert values(model, scatter(False))["total integrated scatter"].value == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(
    ("model", "name", "numbers"),
    [("abg(a=0.01, b=0.001, g=1.8)", "ABg", (0.01, 0.001, 1.8)),
     ("harvey_shack(b0=2, l=0.02, s=-1.6)", "Harvey–Shack", (2, 0.02, -1.6))],
)  # fmt: skip
def test_laws_of_scatter_are_found_again(model, name, numbers):
    material = gonio.material(model)
    rows, undecided = scatter_laws(profile_of_model(material.brdf), material.channels)
    assert [q.value for q in rows if q.name.startswith(name)] == pytest.approx(numbers, rel=1e-6)
    assert not undecided and rows[-1].value < 1e-6 and "holds" in rows[-1].place


def test_of_a_long_spectrum_laws_are_fitted_to_some_channels_and_that_is_stated():
    material = gonio.material("abg(a=0.01, b=0.001, g=1.8)")
    profile = profile_of_model(material.brdf)
    channels = Channels.of_wavelengths(np.linspace(400, 800, 401))
    rows, undecided = scatter_laws(profile._replace(f=np.repeat(profile.f, 401, axis=1)), channels)
    fitted = [q.channel for q in rows if q.name == "ABg A"]
    assert len(fitted) == 12 and fitted[0] == channels.names[0] and fitted[-1] == channels.names[-1]
    assert "12 of 401 channels" in undecided[-1].reason


def test_a_lambertian_follows_no_law_of_scatter():
    material = gonio.material("lambert(rho=0.5)")
    rows, undecided = scatter_laws(profile_of_model(material.brdf), material.channels)
    assert [q.name for q in rows] == ["difference of incidences"] and len(undecided) == 2


def test_the_covariance_of_a_fit_is_in_the_uncertainty():
    """Of Lambert each factor is ρ, so that its uncertainty is that of ρ."""
    rng = np.random.default_rng(3)
    theta = np.radians(np.linspace(0, 70, 40))
    f = RHO / math.pi * (1 + 0.02 * rng.standard_normal(40))
    fitted = gonio.fit(gonio.Table.from_arrays(0.3, 0, theta, 1.0, f, u_f=np.full(40, 0.02 * RHO / math.pi)), "lambert")
    result = gonio.quantities(fitted, only=["reflectance"], geometries=["33:12:20"])
    u = [q.u for q in result.quantities if q.name != "8°:de"]
    assert not result.undecided and len(u) > 25
    assert [note.split(":")[0] for note in result.notes][-1] == "U is of the fit's covariance"
    assert u == pytest.approx([fitted.parameters[0].standard_uncertainty] * len(u), rel=1e-3)


def test_each_channel_of_a_fit_has_its_own_covariance():
    """Of a Lambertian in two channels with a lobe that they share, as `FitResult.propagated` has it."""
    rng = np.random.default_rng(5)
    theta, true = np.radians(np.linspace(0, 75, 60)), gonio.material("lambert(rho=[0.2, 0.6]) + 0.2 * ggx(alpha=0.3)")
    f = true.f(0.5, 0.0, theta, math.pi) * (1 + 0.01 * rng.standard_normal((60, 2)))
    fitted = gonio.fit(gonio.Table.from_arrays(0.5, 0, theta, math.pi, f, u_f=0.01 * f), "lambert + shared * ggx")
    made = FitNumbers.of(fitted.material)
    slopes = made.slopes(lambda brdf: dataclasses.replace(true, brdf=brdf).f(0.5, 0.0, theta, math.pi))
    expected = fitted.propagated(lambda material: material.f(0.5, 0.0, theta, math.pi), by_channel=True)
    assert made.spread(slopes) == pytest.approx(expected, rel=1e-3)
    assert np.all(slopes[:, 0, [p.get("channel") == fitted.channels.names[1] for p in made.numbers]] == 0)


def test_what_a_fit_leaves_open_is_not_known():
    """The width of a lobe that no reading sees, and a number on its bound, which has no spread."""
    material = gonio.material("lambert(rho=0.5)")
    number = {"name": "lambert.rho", "value": 0.5, "low": 0.0, "high": 1.0, "status": "undetermined"}
    stored = {"parameters": [number], "covariance": [[math.nan]]}
    result = gonio.quantities(dataclasses.replace(material, meta={"fit": stored}), only=["reflectance"])
    assert {u.name for u in result.undecided} >= {"8°:di", "45°a:0°"} and "lambert.rho" in result.notes[0]
    assert not any(q.decided for q in result.quantities)
    stored = {"parameters": [{**number, "status": "at upper bound"}], "covariance": [[math.nan]]}
    result = gonio.quantities(dataclasses.replace(material, meta={"fit": stored}), only=["reflectance"])
    assert all(q.u == 0 for q in result.quantities) and not result.undecided and not result.notes
    broken = dataclasses.replace(material, meta={"fit": {"parameters": [{"status": "free"}]}})
    assert "not in the uncertainties" in gonio.quantities(broken, only=["reflectance"]).notes[0]


@pytest.mark.parametrize("law", list(LAWS))
@pytest.mark.parametrize("seed", range(4))
def test_descents_of_scatter_laws_end_where_scipy_does(law, seed):
    curve, names, sign = LAWS[law]
    rng = np.random.default_rng(seed)
    x = np.log(np.geomspace(1e-3, 1.2, 200))
    truth = np.array([rng.normal(), rng.uniform(-6, -2), sign * rng.uniform(1, 3)])
    y = curve(truth, x)[0] + 0.02 * rng.standard_normal(x.size)
    starts = truth + np.array([[0.5, 0.3, -0.2], [2.0, 1.0, 0.5], [np.nan, 0.0, 0.0]])
    ends, costs = descended(lambda p: curve(p, x), starts, y)
    best = scipy.optimize.least_squares(lambda p: curve(p, x)[0] - y, truth, lambda p: curve(p, x)[1], xtol=1e-12)
    assert costs[:2] == pytest.approx(best.cost, rel=1e-7)
    np.testing.assert_allclose(ends[:2], [best.x] * 2, rtol=1e-3, atol=1e-3)
    assert len(names) == 3 and not np.isfinite(costs[2])


def test_light_from_all_around_is_not_known_of_a_brushed_surface_lit_from_one_azimuth():
    brushed = gonio.material("lambert(rho=0.2) + 0.4 * ggx(alpha_x=0.1, alpha_y=0.4)")
    polar, turns = np.radians(np.arange(0, 81, 5.0)), np.radians(np.arange(0, 360, 15.0))
    layout = isotropic(polar, polar, turns)
    f = brushed.f(*layout.angles())
    known = gonio.quantities(whole_table_of_values(layout, f.reshape(*layout.shape, 1)), only="reflectance,albedo")
    unknown = {u.name for u in known.undecided if "one azimuth" in u.reason}
    assert unknown == {"45°a:0°", "0°:45°x"} and {"45°x:0°", "0°:45°a"} <= {q.name for q in known.quantities}
    (uniform,) = (q for q in known.quantities if q.name == "albedo under uniform light")
    assert uniform.bound == np.inf and not uniform.decided

"""Quantities of standards of tables: within their bounds of the model's, of both sides, and undecided where unread."""

import dataclasses
import math

import numpy as np
import pytest

import gonio
from gonio.data.layouts import in_plane, isotropic
from gonio.instrument import measure
from gonio.instrument.scans import scan
from gonio.metrology.standards.reflectance import SUN
from gonio.metrology.standards.shared import shared_integrals
from gonio.models.errors import GonioError
from support.marks import thorough

GLOSSY = "lambert(rho=0.2) + ggx(alpha=0.2, eta=1.5)"
THETA = np.radians([*range(0, 90, 5), 88])
GRID = isotropic(THETA, THETA, np.radians(range(0, 181, 10)))


def by_name(result):
    return {(q.name, q.place): q for q in result.quantities}


@pytest.fixture(scope="module")
def glossy():
    return measure(GLOSSY, None, GRID)


@pytest.fixture(scope="module")
def true():
    return by_name(gonio.quantities(GLOSSY))


@pytest.mark.parametrize("noise", [0.03, *thorough(0.0)])
def test_a_grid_is_within_its_bounds_of_the_model(glossy, true, noise):
    """Also where all that bends between the nodes is within the noise of a single reading."""
    f = np.nan_to_num(glossy.f)
    table = dataclasses.replace(glossy, u_f=noise * np.abs(f)) if noise else glossy
    of_table, of_model = by_name(gonio.quantities(table)), true
    named = [k for k, q in of_table.items() if q.group not in ("albedo", "scatter law") and k in of_model]
    assert len(named) > 25 and {("gloss 60°", ""), ("8°:de", ""), ("45°a:0°", "")} <= set(named)
    for key in named:
        a, b = of_table[key], of_model[key]
        assert abs(a.value - b.value) <= a.bound + b.bound + 1e-9 * abs(b.value), key


def test_what_is_shared_between_calls_changes_no_number(glossy):
    """Of the same table only: another one has its own rows, also while they are shared."""
    brighter = dataclasses.replace(glossy, f=2 * np.asarray(glossy.f))
    alone = [gonio.quantities(t, only=["gloss"]).to_dict() for t in (glossy, brighter)]
    with shared_integrals():
        for _ in range(2):
            assert [gonio.quantities(t, only=["gloss"]).to_dict() for t in (glossy, brighter)] == alone


@pytest.mark.parametrize(("step", "alpha"), [(7.5, 0.1167), (3.0, 0.0409)])
def test_a_ring_within_a_step_of_a_lobe_at_the_pole_is_within_its_bound(step, alpha):
    """The lobe is a peak at the normal: beyond the pole the grid goes on at the opposite azimuth."""
    material = f"lambert(rho=0.3) + 0.092 * ggx(alpha={alpha}, f0=1)"
    table = measure(material, None, scan("isotropic", step=math.radians(step)))
    a, b = (by_name(gonio.quantities(s, only=["scatter"]))["scatter", "2.5° to 5°"] for s in (table, material))
    assert abs(a.value - b.value) <= a.bound + b.bound


def test_gloss_between_incidences_follows_the_mirror_direction(true):
    """A lobe that moves with the light is smeared where it is interpolated at fixed directions of the detector."""
    table = measure(GLOSSY, None, isotropic(np.radians(range(0, 76, 15)), THETA, np.radians(range(0, 181, 10))))
    for name, q in by_name(gonio.quantities(table, only=["gloss"])).items():
        if q.group == "gloss":
            assert abs(q.value - true[name].value) <= q.bound + true[name].bound, name
        if name[0] == "gloss 20°":
            assert q.value == pytest.approx(true[name].value, rel=0.03)


def test_uneven_nodes_have_their_own_steps():
    """Light at 0° and 7.5°, beside which 8° was read too: what bends in between is more than 7.5° and 8° show."""
    model, places = "lambert(rho=0.1) + ggx(alpha=0.285, eta=1.5)", ("0°:45°a", "0°:45°x", "45°a:0°")
    theta = np.radians([*np.arange(0, 76, 7.5), 8])
    table = measure(
        model, None, isotropic(np.sort(theta), np.radians(np.arange(0, 86, 2.5)), np.radians(range(0, 181, 10)))
    )
    of_table, of_model = (by_name(gonio.quantities(s, only=["reflectance"])) for s in (table, model))
    for place in places:
        q = of_table[place, ""]
        assert abs(q.value - of_model[place, ""].value) <= q.bound + 1e-9


def test_a_lobe_narrower_than_the_grid_is_undecided():
    result = gonio.quantities(measure("lambert(rho=0.2) + ggx(alpha=0.01, eta=1.5)", None, GRID), only=["gloss"])
    assert {"gloss 20°", "gloss 60°", "distinctness of image"} <= {u.name for u in result.undecided}


def test_ten_readings_in_the_plane_decide_single_directions_alone():
    table = measure(
        GLOSSY, None, in_plane([math.radians(SUN)], np.radians([-60, -45, -30, -15, 0, 15, 30, 45, 60, 75]))
    )
    result = gonio.quantities(table, only=["reflectance", "gloss", "multi-angle", "remote sensing"])
    assert {q.name for q in result.quantities} <= {
        "reflectance factor",
        "BRF",
        *(f"45°:as{a}°" for a in (15, 25, 45, 75, 110)),
    }
    reasons = {u.name: u.reason for u in result.undecided}
    assert "in one plane" in reasons["gloss 20°"] and "in one plane" in reasons["8°:di"]
    assert by_name(result)["45°:as15°", ""].value == pytest.approx(math.pi * table.read_values()["f"][6, 0])


def test_a_sheet_in_closed_form():
    """A thin sheet of Lambertian reflection and transmission, read on both sides."""
    table = measure("thin_sheet(rho=0.3, tau=0.5)", None, scan("isotropic", step=math.radians(10), hemisphere="both"))
    result = gonio.quantities(table, geometries=["30:150:90"])
    found = by_name(result)
    for name, value in (("albedo", 0.3), ("transmittance", 0.5), ("absorptance", 0.2)):
        for theta in (0, 40):
            q = found[name, f"θi {theta}°"]
            assert q.value == pytest.approx(value, abs=q.bound + 1e-9) and q.bound < 0.01
    assert found["transmittance factor", "30:150:90"].value == pytest.approx(0.5)
    assert found["transmittance factor", "0:180"].value == pytest.approx(0.5)
    haze = found["haze beyond 2.5°", "θi 0°"]
    assert haze.value == pytest.approx(math.cos(math.radians(2.5)) ** 2, abs=haze.bound + 1e-6)
    assert found["haze of a sphere", "θi 0°"].value == pytest.approx(math.cos(math.radians(4)) ** 2, abs=1e-3)
    budget = gonio.quantities(table, budget=True, uncertainty={"gain": "1 %"}, only=["transmission"])
    gain = next(c.values for c in budget.budget.contributions if c.name == "gain")
    k = next(k for k, q in enumerate(budget.quantities) if (q.name, q.place) == ("transmittance", "θi 0°"))
    assert gain[k] == pytest.approx(0.005, rel=1e-6)
    k = next(k for k, q in enumerate(budget.quantities) if q.name == "haze beyond 2.5°")
    assert gain[k] == pytest.approx(0, abs=1e-9)  # a ratio


def test_single_readings_have_their_own_noise(glossy):
    scattered = np.nan_to_num(glossy.f) * (1 + 0.01 * np.random.default_rng(0).standard_normal(glossy.shape))
    noisy = gonio.Table(glossy.layout, scattered, glossy.flag, glossy.channels, u_f=0.01 * np.abs(scattered))
    q = by_name(gonio.quantities(noisy, only=["multi-angle"]))["45°:as15°", ""]
    assert q.u == pytest.approx(0.01 * q.value) and q.bound == 0
    direct = by_name(gonio.quantities(noisy, only=["gloss"]))["contrast gloss", ""]
    assert 0.005 < direct.u / direct.value < 0.01 * math.sqrt(2)  # of a mean of few readings over a single one


def test_a_geometry_between_readings_is_interpolated_and_one_beyond_them_undecided(glossy):
    places = ["33:12:140", "60:60:180", "89:10:0"]
    result = gonio.quantities(glossy, only=["reflectance"], geometries=places)
    rows = {q.place: q for q in result.quantities if q.name == "reflectance factor"}
    for place in places[:2]:
        i, o, d = map(float, place.split(":"))
        expected = math.pi * gonio.material(GLOSSY).f(i, 0, o, d, degrees=True)[0]
        assert abs(rows[place].value - expected) <= rows[place].bound + 1e-9
    assert rows["33:12:140"].bound > 0 and rows["60:60:180"].bound == 0
    assert rows["33:12:140"].angles == {"theta_i": 33, "theta_o": 12, "delta_phi": 140}
    (beyond,) = [u for u in result.undecided if u.place == "89:10:0"]
    assert "the nearest reading is at 88:10:0" in beyond.reason


def test_the_bihemispherical_reflectance_is_the_albedo_under_uniform_light(glossy):
    for subject in (glossy, GLOSSY):
        rows = by_name(gonio.quantities(subject, only=["remote sensing"]))
        bhr, uniform = rows["BHR", "white sky"], rows["albedo under uniform light", ""]
        assert (bhr.value, bhr.bound, bhr.group) == (uniform.value, uniform.bound, "remote sensing")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [({"only": ["glos"]}, "did you mean 'gloss'"), ({"port": 40.0}, "half-angle"), ({"observer": 5}, "10 or 2"),
     ({"illuminants": ["E"]}, "D65 or A"), ({"feature_width": -1.0}, "0 to 90"),
     ({"against": "lambert(rho=0.5)"}, "has no colour")],
)  # fmt: skip
def test_bad_options_are_one_sentence(options, sentence):
    with pytest.raises(GonioError, match=sentence):
        gonio.quantities("lambert(rho=0.5)", **options)

"""Mitsuba's own values of what is written for it, from the file itself, in its scalar RGB variant."""

import dataclasses
import json

import mitsuba as mi
import numpy as np
import pytest

import gonio
from gonio.exports.about import About
from gonio.exports.forms import appearance_of
from gonio.exports.pairs import Pairs, polar_pairs
from gonio.exports.renderers.mitsuba import forms
from gonio.exports.renderers.mitsuba_file import scene
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction
from support.mitsuba_client import f_cosine

ROUNDING = 1e-5
"""Relative: it computes in single precision."""


@pytest.fixture(autouse=True, scope="module")
def variant():
    mi.set_variant("scalar_rgb")


def client_f(bsdf: "mi.BSDF", pairs: Pairs) -> np.ndarray:
    """f (n, 3) of a BSDF of Mitsuba's."""
    return f_cosine(bsdf, pairs.wi, pairs.wo) / np.abs(pairs.wo.z[:, None])


def bsdf_of(scene_of_sphere: "mi.Scene") -> "mi.BSDF":
    return scene_of_sphere.shapes()[0].bsdf()


def assert_same(f: np.ndarray, expected: np.ndarray) -> None:
    expected = np.broadcast_to(expected, f.shape)
    assert np.all(np.abs(f - expected) <= ROUNDING * np.maximum(expected, 1e-4 * expected.max()))


def spread(turns: int = 1) -> Pairs:
    """Up to 88°: beyond, single precision is worse."""
    pairs = polar_pairs(5, 9, 5, turns)
    return pairs.where(np.minimum(pairs.wi.z, pairs.wo.z) > 0.035)


def test_what_mitsuba_has_is_written_as_it_is(tmp_path):
    expression = (
        "lambert(rho=[0.2, 0.9, 0.3]) + [0.5, 0.6, 0.8] * ggx(alpha_x=0.1, alpha_y=0.3, smith='separable', eta=1.5) "
        "+ beckmann(alpha=0.2, smith='walter', eta=[1, 2, 0.5], k=[3, 2, 4])"
    )
    error = gonio.convert(expression, tmp_path / "sum.xml", to="mitsuba")
    assert error.exact and error.relative_rms < ROUNDING and "exact" in str(error)
    material, pairs = gonio.material(expression), spread(3)
    angles = [a for w in (pairs.wi, pairs.wo) for a in (np.arccos(w.z), np.arctan2(w.y, w.x))]
    expected = material.f(*angles)
    assert_same(client_f(bsdf_of(mi.load_file(str(tmp_path / "sum.xml"))), pairs), expected)
    gonio.convert(expression, tmp_path / "sum.json", to="mitsuba")
    assert_same(client_f(mi.load_dict(json.loads((tmp_path / "sum.json").read_text())), pairs), expected)


@pytest.mark.parametrize("kind", ["smith='separable'", "distribution='beckmann', smith='walter'"])
def test_a_rough_interface_is_written_as_it_is(tmp_path, kind):
    """What goes through is seen over η² there: a renderer follows light from the eye."""
    expression, eta = f"rough_dielectric(alpha=0.3, eta=1.5, {kind})", 1.5
    assert gonio.convert(expression, tmp_path / "glass.xml", to="mitsuba").exact
    bsdf, pairs = bsdf_of(mi.load_file(str(tmp_path / "glass.xml"))), spread()
    turned = Direction(-pairs.wo.x / eta, -pairs.wo.y / eta, -np.sqrt(1 - (1 - pairs.wo.z**2) / eta**2))
    for side, seen in ((pairs, 1.0), (dataclasses.replace(pairs, wo=turned), eta**2)):
        expected = evaluate(gonio.material(expression).brdf, side.wi, side.wo)
        assert_same(seen * client_f(bsdf, side), np.asarray(expected)[:, None])


def test_a_beckmann_interface_of_correlated_masking_is_written_with_beckmanns_facets(tmp_path):
    """Mitsuba has Walter's masking alone: its own values are as far off as is printed."""
    expression, eta = "rough_dielectric(alpha=0.3, eta=1.5, distribution='beckmann')", 1.5
    error = gonio.convert(expression, tmp_path / "glass.xml", to="mitsuba")
    assert "Beckmann" in error.form and 1e-3 < error.relative_rms < 0.03
    bsdf, pairs = bsdf_of(mi.load_file(str(tmp_path / "glass.xml"))), polar_pairs(5, 9, 5)
    theirs = [client_f(bsdf, pairs), eta**2 * client_f(bsdf, pairs.through())]
    sides = pairs, pairs.through()
    ours = [np.asarray(evaluate(gonio.material(expression).brdf, side.wi, side.wo))[:, None] for side in sides]
    off, size = (sum(np.sum(pairs.weight[:, None] * a**2) for a in v) for v in (np.subtract(theirs, ours), ours))
    assert np.sqrt(off / (3 * size)) < 2 * error.relative_rms


def test_a_sheet_is_itself_from_either_side(tmp_path):
    """What is written, lit from behind too: f of the expression itself."""
    expression = "thin_sheet(rho=[0.2, 0.3, 0.1], tau=[0.1, 0.5, 0.2], rho_behind=0.4)"
    assert gonio.convert(expression, tmp_path / "sheet.xml", to="mitsuba").exact
    bsdf, pairs = bsdf_of(mi.load_file(str(tmp_path / "sheet.xml"))), spread()
    behind = dataclasses.replace(pairs, wi=Direction(pairs.wi.x, pairs.wi.y, -pairs.wi.z))
    for side in (pairs, pairs.through(), behind, behind.through()):
        expected = evaluate(gonio.material(expression).brdf, side.wi, side.wo)
        assert_same(client_f(bsdf, side), np.asarray(expected))


@pytest.mark.parametrize(
    "sought",
    [
        "[0.1, 0.2, 0.3] * phong(n=60)",
        "[0.1, 0.2, 0.3] * ward(alpha_x=0.1, alpha_y=0.4)",
        "[0.1, 0.2, 0.3] * phong(n=60) + lambert_transmission(tau=0.1)",
    ],
)
def test_every_form_is_what_mitsuba_makes_of_its_numbers(sought):
    rng = np.random.default_rng(3)
    appearance = appearance_of(gonio.material(sought))
    for form in forms(appearance):
        pairs = spread(1 if appearance.isotropic else 3)
        values = {
            n.name: rng.uniform(max(n.low, min(0.1, 0.5 * n.high)), min(n.high, 2.0), (3,) if n.coloured else ())
            for n in form.numbers
        }
        widest = {n.name: min(n.high, 0.7) for n in form.numbers if n.width}
        values = {k: np.minimum(v, widest.get(k, np.inf)) for k, v in values.items()}
        metal = {n.name: np.asarray(1.0) for n in form.numbers if n.name == "metallic"}
        least = values | {n.name: np.full_like(values[n.name], n.low) for n in form.numbers if not n.width} | metal
        for numbers in (values, least | {k: v for k, v in values.items() if k in ("rho", "base_color")}):
            bsdf = bsdf_of(mi.load_string(scene(form.describe(numbers), About("x", {"numbers": "random"}))))
            for side in (pairs, pairs.through()) if form.transmits else (pairs,):
                assert_same(client_f(bsdf, side), form.f(numbers, side))

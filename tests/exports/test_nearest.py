"""The search for a renderer's numbers: it finds those that a surface was made with, and says how far others are."""

import dataclasses

import numpy as np
import pytest

from gonio.data.subject import load_material
from gonio.exports.forms import Appearance, Form, Values, appearance_of
from gonio.exports.nearest import nearest
from gonio.exports.pairs import Pairs
from gonio.exports.reexpression import reexpression
from gonio.exports.renderers import blender, gltf, mitsuba, openpbr, pbrt
from gonio.exports.renderers.lobes import ggx_facets, schlick
from support.marks import thorough

MODULES = {"blender": blender, "gltf": gltf, "mitsuba": mitsuba, "openpbr": openpbr, "pbrt": pbrt}


@dataclasses.dataclass(frozen=True)
class Made(Appearance):
    """A surface that is a form with some numbers: nothing is compiled."""

    form: Form | None = None
    values: Values | None = None

    def f(self, wi, wo):
        empty = np.zeros(wi.z.size)
        pairs = Pairs(wi, wo, empty, empty.astype(int), np.zeros(1))
        return np.broadcast_to(self.form.f(self.values, pairs), (wi.z.size, self.colours))


def made(form: Form, values: Values, colours: int = 3) -> Made:
    return Made(load_material("0.3 * phong(n=40)"), np.eye(colours), (), form, values)


def of_name(module, name: str, like: str = "ward(alpha=0.2)") -> Form:
    return next(f for f in module.forms(made(None, None)) if f.name == name)


CASES = {
    ("mitsuba", "diffuse + a dielectric's lobe"): {"rho": [0.3, 0.1, 0.5], "alpha0": 0.12, "eta0": 1.4, "scale0": 2.0},
    ("pbrt", "conductor"): {"alpha": 0.25, "eta": [0.4, 1.1, 1.6], "k": [3.0, 2.4, 1.9]},
    ("openpbr", "metal"): {
        "base_color": [0.9, 0.6, 0.3], "specular_color": [0.7, 0.8, 0.9], "alpha": 0.2, "specular_weight": 0.9,
    },
    ("gltf", "dielectric"): {"base_color": [0.5, 0.2, 0.1], "alpha": 0.3, "ior": 1.6, "specular": 0.8},
    ("blender", "dielectric"): {"base_color": [0.5, 0.2, 0.1], "diffuse_roughness": 0.4, "alpha": 0.3, "ior": 1.6},
}  # fmt: skip


@pytest.mark.parametrize(("target", "name"), CASES, ids=[target for target, _ in CASES])
def test_the_numbers_of_a_surface_are_recovered(target, name):
    values = {k: np.asarray(v) for k, v in CASES[target, name].items()}
    form = of_name(MODULES[target], name)
    sought = made(form, values)
    expression = nearest((form,), sought)
    for key, value in values.items():
        np.testing.assert_allclose(expression.values[key], value, rtol=1e-3, err_msg=key)
    error = reexpression(target, sought, expression)
    assert error.relative_rms < 1e-4 and error.albedo_difference < 1e-4 and error.delta_e_max < 0.01
    assert error.within(1e-4) and not error.within(-1)


def test_what_is_exact_says_so_and_what_is_not_says_by_how_much():
    lambert = of_name(pbrt, "diffuse")
    sought = made(lambert, {"reflectance": np.array([0.4])}, colours=1)
    expression = nearest(pbrt.forms(sought), sought)
    assert expression.form.name == "diffuse"  # none of the richer forms is nearer
    assert reexpression("pbrt", sought, expression).exact
    darker = dataclasses.replace(expression, values={"reflectance": np.array([0.3])})
    error = reexpression("pbrt", sought, darker)
    assert not error.exact and "25 %" in error.figures
    np.testing.assert_allclose([error.relative_rms, error.albedo_difference], [0.25, 0.1], rtol=1e-3)


def test_an_index_of_one_leaves_the_diffuser_alone():
    for module, values in (
        (blender, {"ior": 1.0, "diffuse_roughness": 0.0}), (gltf, {"ior": 1.0, "specular": 0.0}),
    ):  # fmt: skip
        values = {k: np.asarray(v) for k, v in values.items()} | {
            "base_color": np.full(3, 0.4),
            "alpha": np.asarray(0.3),
        }
        f = of_name(module, "dielectric").f(values, made(None, None).pairs(4, 8, 4))
        np.testing.assert_allclose(f, 0.4 / np.pi, rtol=1e-6)


@pytest.mark.parametrize(("bright", "chosen"), [(1.04, "bright"), (1.3, "dark")])
def test_a_little_light_is_made_where_all_else_is_far(bright, chosen):
    forms = [
        Form(name, (), lambda v, pairs, share=share: np.full((pairs.wi.z.size, 1), share / np.pi), lambda v: None)
        for name, share in (("dark", 0.5), ("bright", bright))
    ]
    white = Form("white", (), lambda v, pairs: np.full((pairs.wi.z.size, 1), 1 / np.pi), lambda v: None)
    sought = made(white, {}, colours=1)
    expression = nearest(tuple(forms), sought)
    assert expression.form.name == chosen
    told = [r for r in reexpression("any", sought, expression).remarks if "more leaves than arrives" in r]
    assert bool(told) == (chosen == "bright") and all("4 %" in r for r in told)


SURFACES = {
    "dipole(sigma_a=[0.002, 0.004, 0.007], sigma_s=[2.2, 2.6, 3], eta=1.5)": "gltf",
    "eon(rho=0.5, r=1) + 0.3 * beckmann(alpha=0.3)": "mitsuba",
    "lambert(rho=0.4) + 0.1 * ggx(alpha=0.03, f0=0.05) + 0.1 * ggx(alpha=0.2)": "mitsuba",
}


@pytest.mark.parametrize(
    ("sought", "name"),
    [*list(SURFACES.items())[2:], *thorough(*list(SURFACES.items())[:2])],
)
def test_no_export_is_further_than_a_diffuser_or_one_lobe_from_a_coarse_search(sought, name):
    """The best of all Lambertians is that of the surface's bihemispherical albedo."""
    appearance = appearance_of(load_material(sought))
    pairs = appearance.pairs(12, 48, 12)
    f, w = appearance.f(pairs.wi, pairs.wo), pairs.weight[:, None]
    best = np.sum(w * f, axis=0) / np.sum(w)
    lobes = [
        schlick(pairs.cos_d, f0) * ggx_facets(pairs, alpha, alpha, "separable") * scale
        for alpha in (0.03, 0.1, 0.3, 0.6)
        for f0 in (0.04, 0.5)
        for scale in (0.1, 0.3, 1.0)
    ]
    tried = [best, *(lobe + np.maximum(best - np.sum(w * lobe) / np.sum(w), 0.0) for lobe in lobes)]
    diffuse, *others = (np.sqrt(np.sum(w * (t - f) ** 2) / np.sum(w * f * f)) for t in tried)
    error = reexpression(name, appearance, nearest(MODULES[name].forms(appearance), appearance))
    assert error.relative_rms <= diffuse + 0.01
    assert error.relative_rms <= min(others) + 0.01
    assert error.albedo_difference < 0.5


@pytest.mark.parametrize("module", MODULES.values(), ids=list(MODULES))
def test_every_form_is_finite_at_the_ends_of_its_numbers_domains(module):
    for like in ("ward(alpha=0.2)", "ward(alpha_x=0.1, alpha_y=0.3)"):
        sought = appearance_of(load_material(f"[0.1, 0.2, 0.3] * {like}"))
        pairs = sought.pairs(4, 6, 4)
        for form in module.forms(sought):
            for ends in (("low",), ("high",), ("low", "high"), ("high", "low")):
                values = {
                    n.name: np.full((3,) if n.coloured else (), getattr(n, ends[k % len(ends)]))
                    for k, n in enumerate(form.numbers)
                }
                f = form.f(values, pairs)
                assert np.all(np.isfinite(f)), (form.name, ends)
                form.describe(values)

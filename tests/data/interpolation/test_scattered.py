"""Kriged samples: lobes from few samples, the symmetries that it states, and the fall back where it is no better."""

import dataclasses

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.interpolation import inverse_distance
from gonio.data.interpolation.kriging import NAMES, Kriging, likeliest
from gonio.data.interpolation.multilinear import as_material, interpolation
from gonio.data.interpolation.scattered import KEY, MOST, kriging_of, samples_of
from gonio.data.table import whole_table_of_values
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import from_spherical, rotate_z
from support.marks import thorough

GLOSSY = build("lambert(rho=[0.05, 0.4]) + 0.5 * ggx(alpha=0.1)")
BRUSHED = build("0.8 * ggx(alpha_x=0.1, alpha_y=0.3)")


def directions(count, isotropic, seed):
    """Half anywhere, half about mirror reflection."""
    rng = np.random.default_rng(seed)
    theta, phi = rng.uniform(0, 1.3, (2, count)), rng.uniform(0, 2 * np.pi, (2, count))
    phi[0] *= not isotropic
    theta[1, ::2] = np.minimum(theta[0, ::2] + rng.uniform(0, 0.2, theta[0, ::2].size), 1.3)
    phi[1, ::2] = phi[0, ::2] + np.pi + rng.normal(0, 0.2, phi[0, ::2].size)
    return np.stack([theta[0], phi[0], theta[1], phi[1] % (2 * np.pi)])


def table_of(brdf, count, isotropic=True):
    layout = layouts.scattered(*directions(count, isotropic, 0))
    return whole_table_of_values(layout, np.asarray(evaluate(brdf, *layout.directions())))


def error(predicted, brdf, isotropic):
    """Median relative error."""
    wi, wo = layouts.scattered(*directions(400, isotropic, 1)).directions()
    values, f = (np.asarray(evaluate(b, wi, wo)).reshape(400, -1) for b in (predicted, brdf))
    return np.median(np.abs(values / f - 1))


@pytest.fixture(scope="module")
def glossy():
    return table_of(GLOSSY, 200)


@pytest.mark.parametrize("brdf, isotropic, most", [(BRUSHED, False, 0.06), *thorough((GLOSSY, True, 0.01))])
def test_a_lobe_is_predicted_from_few_samples(brdf, isotropic, most):
    table = table_of(brdf, 200, isotropic)
    assert "kriging" in interpolation(table) and ("isotropy" in interpolation(table)) == isotropic
    ours, theirs = (error(of(table), brdf, isotropic) for of in (as_material, inverse_distance.scattered_material))
    assert ours < most and ours < 0.2 * theirs


def test_exchanged_turned_and_mirrored_directions_are_one(glossy):
    brdf = as_material(glossy)
    wi, wo = layouts.scattered(*directions(50, True, 2)).directions()
    f = evaluate(brdf, wi, wo)
    turned = (rotate_z(w, np.cos(1.0), np.sin(1.0)) for w in (wi, wo))
    mirrored = (w._replace(y=-w.y) for w in (wi, wo))
    for pair in ((wo, wi), turned, mirrored):
        np.testing.assert_allclose(evaluate(brdf, *pair), f, rtol=1e-6)


def test_nothing_is_extrapolated_beyond_what_was_read(glossy):
    grazing = [from_spherical(np.array([1.5707]), np.array([p]), np) for p in (0.0, np.pi)]
    f = np.asarray(evaluate(as_material(glossy), *grazing))
    assert (f <= 1.7 * glossy.f.max(axis=0)).all() and (f >= 0.5 * glossy.f.min(axis=0)).all()


def test_left_out_is_what_a_system_without_the_sample_predicts(glossy):
    samples = samples_of(glossy, 1e-3)
    law = likeliest(samples)
    errors, variances = Kriging.of(samples, law).left_out()
    assert (variances > 0).all()
    for k in (3, 50):
        others = Kriging.of(samples.part(np.arange(200) != k), law)
        one = samples.part(np.array([k]))
        np.testing.assert_allclose((one.values - others.predicted(one.wi, one.wo))[0], errors[k], rtol=1e-3, atol=1e-7)


def test_noise_is_not_followed():
    rng, table = np.random.default_rng(3), table_of(GLOSSY, 200)
    noisy = dataclasses.replace(table, f=table.f * (1 + 0.1 * rng.normal(size=table.f.shape)), u_f=0.1 * table.f)
    assert error(as_material(noisy), GLOSSY, True) < 0.06


def test_the_law_that_the_provenance_states_is_used(glossy):
    system, floor = kriging_of(glossy)
    law = dict(zip(NAMES, np.exp(system.law).tolist(), strict=True)) | {"width": 0.3}
    for kept, width in (({"law": law, "floor": floor}, 0.3), ({"law": {"width": 0.3}}, np.exp(system.law[0]))):
        stated = dataclasses.replace(glossy, provenance={KEY: kept})
        assert np.exp(kriging_of(stated).system.law[0]) == pytest.approx(width)


@pytest.mark.parametrize("number", [1e-9, 1e9])
def test_a_damaged_law_is_not_believed(glossy, number):
    kept = {"law": dict.fromkeys(NAMES, number), "floor": 1e-4}
    assert kriging_of(dataclasses.replace(glossy, provenance={KEY: kept})) is None


def test_samples_that_neighbours_do_not_tell_are_averaged():
    rng = np.random.default_rng(4)
    values = {
        "noise": rng.random(100),
        "constant": np.full(100, 0.2),
        "few": np.arange(10.0),
        "many": np.ones(MOST + 1),
    }
    for f in values.values():
        layout = layouts.scattered(*directions(f.size, True, 5))
        assert "inverse-distance" in interpolation(whole_table_of_values(layout, f))

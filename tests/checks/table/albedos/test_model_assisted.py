"""Energy with the help of a fitted model: the bound holds whatever the model, and decides where the model fits."""

import numpy as np
import pytest

import gonio
from gonio.checks.hidden_lobes import Features
from gonio.checks.table.albedos.model_assisted import assisted_albedos
from gonio.checks.table.albedos.two_sided import Part, albedos_of_parts, summed
from gonio.checks.table.energy import table_albedos
from gonio.data import layouts
from gonio.data.table import Channels, whole_table_of_values
from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from support.check_tables import model_table, property_of
from support.marks import thorough

PAINT = "lambert(rho=0.3) + 0.2 * ggx(alpha=0.3) + 0.1 * ggx(alpha=0.08)"
POLAR = np.radians(np.arange(0, 81, 8.0))
LAYOUT = layouts.isotropic(POLAR, POLAR, np.radians(np.arange(0, 360, 15.0)))


def table_of(gain=1.0, noise=0.0):
    f = gain * np.asarray(evaluate(build(PAINT), *LAYOUT.directions())).reshape(*LAYOUT.shape, 1)
    more = {"u_f": noise * f} if noise else {}
    read = f * (1 + noise * np.random.default_rng(0).standard_normal(f.shape))
    return whole_table_of_values(LAYOUT, read, channels=Channels.grey(), **more)


def energy(table, model):
    return property_of("energy", table, model=model)


RIGHT, WRONG = "lambert + ggx + ggx", ("lambert + ggx", "lambert + phong")


@pytest.mark.parametrize(
    ("model", "noise"),
    [(RIGHT, 0.0), (WRONG[0], 0.02), (WRONG[1], 0.0), *thorough((RIGHT, 0.02), (WRONG[0], 0.0), (WRONG[1], 0.02))],
)
def test_the_bound_holds_with_models_right_and_wrong(model, noise):
    table = table_of(noise=noise)
    assisted, alone = assisted_albedos(Part(table), gonio.fit(table, model), Features(1e-3)), table_albedos(table)
    truth = directional_albedo(build(PAINT), POLAR, 0.0, 1e-8).value[:, None]
    assert (np.abs(assisted.value - truth) <= np.minimum(assisted.above, assisted.below)).all()
    if model == "lambert + ggx + ggx":
        assert assisted.above.max() < 0.02 < 10 < alone.above.max()


@pytest.mark.parametrize(("gain", "verdict"), [(1.0, "pass"), (1.8, "fail")])
def test_it_decides_what_the_grid_leaves_open(gain, verdict):
    """The paint sends back 0.6 of the light, and 1.8 times as bright more than it receives."""
    table = table_of(gain, noise=0.01)
    helped, alone = energy(table, "lambert + ggx + ggx"), energy(table, None)
    assert (alone.verdict, helped.verdict) == ("undecided", verdict)
    assert "Model-assisted" in helped.detail and "Without the model it is undecided" in helped.detail
    assert helped.facts["bound_without_model"] == alone.bound
    assert helped.assumes == "between the readings the surface follows lambert + ggx + ggx as it does at them"


def test_lobes_whose_shape_nothing_read_tests_decide_nothing():
    """Peak and foot of a narrow lobe fit another family of lobes, with another width: its light is not known."""
    truth = "0.63 * (lambert(rho=0.844) + 0.6405 * phong(n=3894) + 0.94 * cook_torrance(alpha=0.153, f0=0.108))"
    light, polar = np.radians([0, 20.0, 40]), np.radians(np.arange(0, 90, 10.0))
    layout = layouts.isotropic(light, polar, np.radians(np.arange(0, 360, 10.0)))
    table = model_table(truth, layout)
    fitted = gonio.fit(table, "lambert + beckmann + blinn_phong")
    albedos = assisted_albedos(Part(table), fitted, Features(1e-3))
    true = directional_albedo(build(truth), light, 0.0, 1e-8).value[:, None]
    error = np.abs(albedos.value - true)
    assert error.max() > 0.02
    assert (error <= np.minimum(albedos.above, albedos.below)).all()
    for alpha, known in (
        (0.01, False),
        (0.05, True),
    ):  # of the narrower one peak and tail were read, not where its light is
        table = model_table(f"lambert(rho=0.3) + 0.6 * ggx(alpha={alpha})", layout)
        albedos = assisted_albedos(Part(table), gonio.fit(table, "lambert + ggx"), Features(1e-3))
        assert (albedos.above.max() < 0.01) == known


def test_what_it_cannot_help_is_said():
    with pytest.raises(GonioError, match="is a model; another one helps tables only"):
        gonio.check(PAINT, model="lambert")
    plane = model_table(PAINT, layouts.in_plane(POLAR, np.radians(np.arange(-80, 81, 10.0))))
    assert "A model does not help: readings in one plane" in energy(plane, "lambert").detail


def two_sided_grid(light, step):
    polar = np.radians(np.arange(0, 86, step))
    return layouts.isotropic(light, np.concatenate([polar, np.pi - polar[::-1]]), np.radians(np.arange(0, 360, 15)))


@pytest.mark.parametrize(
    ("truth", "model", "size"),
    [
        pytest.param(
            "thin_sheet(rho=0.3, tau=0.4) + 0.2*transmitted(base=ggx(alpha=0.15))",
            "thin_sheet + transmitted(base=ggx)",
            3e-3,
            marks=pytest.mark.thorough,
        ),
        ("lambert(rho=0.6) + cosine_power_transmission(n=20, tau=0.3)", "lambert + cosine_power_transmission", 3e-3),
        ("thin_sheet(rho=0.3, tau=0.4) + 0.2*transmitted(base=ggx(alpha=0.15))", "thin_sheet", 1.0),
    ],
)
def test_both_sides_of_a_sample_are_held_by_a_model_of_it(truth, model, size):
    light = np.radians([0, 30, 60, 130, 170])
    table = gonio.measure(truth, scan=two_sided_grid(light, 10), log=lambda text: None)
    fitted = gonio.fit(table, model)
    by_side = albedos_of_parts(table, lambda part: assisted_albedos(part, fitted, Features(1e-3)))
    assisted, brdf = summed(by_side), build(truth)
    exact = (g(brdf, light, 0.0, 1e-6).value for g in (directional_albedo, directional_transmittance))
    exact = sum(exact)[:, None]
    assert (exact <= assisted.value + assisted.above + 1e-6).all()
    assert (exact >= assisted.value - assisted.below - 1e-6).all()
    assert np.max(assisted.below) < size

"""Energy of lists and of half/difference tables with the help of a fitted model, right and wrong."""

import numpy as np
import pytest

import gonio
from gonio.checks.hidden_lobes import Features
from gonio.checks.table.albedos.assisted_scattered import assisted_by_nearest
from gonio.checks.table.albedos.two_sided import Part
from gonio.checks.table.energy import table_albedos, table_energy
from gonio.checks.table.evidence import TableEvidence
from gonio.data import layouts
from gonio.models.albedo import directional_albedo
from gonio.models.expression.builder import build
from support.check_tables import model_table
from support.marks import thorough

PAINT = "lambert(rho=0.3) + 0.2 * ggx(alpha=0.3) + 0.1 * ggx(alpha=0.08)"
RIGHT, WRONG = "lambert + ggx + ggx", "lambert + ggx"
NO_LOBE_IS_NARROWER = Features(1e-3, np.radians(8.0))


def listed(readings, noise=0.02, gain=1.0, seed=0):
    """A list of readings at random incidences, half of them anywhere, half about the mirror direction."""
    rng = np.random.default_rng(seed)
    theta, phi_o = np.radians(rng.uniform(0, 85, (2, readings))), rng.uniform(0, 2 * np.pi, readings)
    near = np.arange(readings) % 2 == 0
    theta[1, near] = np.clip(theta[0] + rng.normal(0, 0.1, readings), 0, 1.48)[near]
    phi_o[near] = np.pi + rng.normal(0, 0.1, near.sum())
    f = gain * gonio.material(PAINT).f(theta[0], 0 * phi_o, theta[1], phi_o)[..., 0]
    return gonio.Table.from_arrays(
        theta[0], 0.0, theta[1], phi_o, f * (1 + noise * rng.standard_normal(readings)), u_f=noise * f
    )


def half_difference():
    return model_table(PAINT, layouts.merl(counts=(18, 18, 36)))


@pytest.mark.parametrize(
    ("make", "model"),
    [
        (lambda: listed(1000), WRONG),
        (half_difference, RIGHT),
        *thorough((lambda: listed(1000), RIGHT), (half_difference, WRONG)),
    ],
)
def test_the_bound_holds_with_models_right_and_wrong(make, model):
    table = make()
    assisted = assisted_by_nearest(Part(table), gonio.fit(table, model), NO_LOBE_IS_NARROWER)
    truth = directional_albedo(build(PAINT), assisted.theta_i, 0.0, 1e-6).value[:, None]
    assert (np.abs(assisted.value - truth) <= assisted.below).all()
    assert (assisted.below.max() < 0.03) == (model == RIGHT)


@pytest.mark.parametrize(("gain", "verdict"), [(1.0, "pass"), (1.8, "fail")])
def test_a_list_of_random_directions_is_decided(gain, verdict):
    """Its readings cover the hemisphere at no incidence; the paint sends back 0.6 of the light, or too much."""
    table = listed(1000, gain=gain)
    assert isinstance(table_albedos(table), str)
    energy = table_energy(TableEvidence(table, feature_width=NO_LOBE_IS_NARROWER.width, model=RIGHT), 0.01)
    assert energy.verdict == verdict and "Model-assisted" in energy.detail and "follows" in energy.assumes
    assert ("narrower than 8°" in energy.assumes) == (verdict == "pass")


def test_without_readings_near_the_mirror_direction_a_width_is_asked_for():
    energy = table_energy(TableEvidence(listed(1000), model=RIGHT), 0.01)
    assert energy.verdict == "undecided" and 0 < energy.facts["passes_with_feature_width_deg"] <= 8

"""Checks of tables of both sides of a sample: closed forms, and the mistakes that they have to see."""

import numpy as np
import pytest

from gonio.checks.certificate import FAIL, NOT_TESTABLE, PASS, UNDECIDED
from gonio.checks.certify import check
from gonio.data import layouts
from gonio.data.table import MEDIA, Table, whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.expression.builder import build
from support.check_tables import property_of

POLAR = np.radians(np.arange(0, 86, 5.0))
BEHIND = (np.pi - POLAR)[::-1]
AZIMUTH = np.radians(np.arange(0, 360, 15.0))
NOISE = 0.01


def sheet(theta_i, theta_o, rho=0.3, tau=0.5, media=(1.0, 1.0), change=None, noise=NOISE, listed=False):
    """Reflects ρ/π; transmits τ/π (½ + ¾ |cosθi cosθo|), the same from both sides up to the squared index there."""
    grid = layouts.isotropic(theta_i, theta_o, AZIMUTH)
    wi, wo = grid.directions()
    through = wi.z * wo.z < 0
    index = np.where(wo.z > 0, media[0], media[1])
    lobe = tau / np.pi * (0.5 + 0.75 * np.abs(wo.z) * np.abs(wi.z)) * (index / max(media)) ** 2
    f = np.where(through, lobe, rho / np.pi)
    if change is not None:
        f = np.where(through, change(f, wi, wo), f)
    drawn = f * (1 + noise * np.random.default_rng(5).standard_normal(f.shape))
    table = whole_table_of_values(grid, drawn.reshape(grid.shape), u_f=(noise * f).reshape(*grid.shape, 1))
    table.provenance[MEDIA] = list(media)
    return table.as_list() if listed else table


def verdicts(table: Table) -> dict[str, str]:
    return {p.name: p.verdict for p in check(table).properties}


def transmittance(tau, cos_i):
    """∫ f cosθo dω of the lobe above: τ (½ + ½ |cosθi|)."""
    return tau * (0.5 + 0.5 * np.abs(cos_i))


@pytest.mark.parametrize("light", [POLAR, BEHIND], ids=["front", "back"])
def test_energy_is_what_comes_back_and_what_goes_through(light):
    energy = property_of("energy", sheet(light, np.concatenate([POLAR, BEHIND])))
    assert energy.verdict == PASS and energy.residual == pytest.approx(-0.2, abs=energy.bound) and energy.bound < 0.02
    assert energy.facts["reflectance"] == pytest.approx(0.3, abs=energy.bound)
    assert energy.facts["transmittance"] == pytest.approx(0.5, abs=energy.bound)
    assert energy.facts["absorptance"] == pytest.approx(0.2, abs=energy.bound)
    theta = np.radians(energy.series["theta_i_deg"])
    np.testing.assert_allclose(energy.series["albedo"][0], 0.3 + transmittance(0.5, np.cos(theta)), atol=0.02)
    assert property_of("energy", sheet(light, np.concatenate([POLAR, BEHIND]), rho=0.6)).verdict == FAIL


def test_a_hemisphere_alone_is_bounded_alone_and_the_verdict_says_so():
    energy = property_of("energy", sheet(POLAR, BEHIND, tau=0.9))
    assert energy.verdict == PASS and energy.residual == pytest.approx(-0.1, abs=energy.bound)
    assert "transmits no more than it receives" in energy.detail and "Reflection was not looked at" in energy.detail
    assert energy.facts["reflectance"] is None and energy.facts["absorptance"] is None
    assert property_of("energy", sheet(POLAR, BEHIND, tau=1.2)).verdict == FAIL


def test_a_list_of_readings_is_integrated_too():
    energy = property_of("energy", sheet(POLAR[::3], np.concatenate([POLAR, BEHIND]), listed=True))
    assert energy.facts["transmittance"] == pytest.approx(0.5, abs=0.02) and energy.verdict == PASS


BOTH = np.concatenate([POLAR[::2], BEHIND[1::2]])


def test_an_honest_sheet_lit_from_both_sides_passes_all():
    assert set(verdicts(sheet(BOTH, BOTH)).values()) <= {PASS, "not applicable"}


def test_where_no_light_goes_nothing_is_wrong():
    """Beyond the angles that light is refracted to no count is met, and no uncertainty is stored."""
    table = sheet(BOTH, BOTH, change=lambda f, wi, wo: np.where(np.abs(wi.z * wo.z) < 0.6, 0.0, f))
    assert np.mean(table.f == 0) > 0.3
    judged = verdicts(table)
    assert judged["reciprocity"] == judged["symmetry"] == judged["pole"] == PASS and FAIL not in judged.values()


@pytest.mark.parametrize(
    "change",
    [
        lambda f, wi, wo: f * np.abs(wo.z),  # a doubled cosine
        lambda f, wi, wo: np.where(wi.z < 0, 1.1 * f, f),  # one side's calibration
        lambda f, wi, wo: f * (1 - 0.3 * (np.abs(wo.z) < 0.5)),  # an arm in the way of the detector
    ],
)
def test_transmission_that_is_not_the_same_both_ways_fails(change):
    reciprocity = property_of("reciprocity", sheet(BOTH, BOTH, change=change))
    assert reciprocity.verdict == FAIL and reciprocity.where.get("theta_o", reciprocity.where.get("theta_to")) > 90


def test_between_media_radiance_grows_with_the_squared_index():
    """f_t(i → o)/n_o² = f_t(o → i)/n_i²: honest where the table states its media, a lost η² where it states none."""
    interface = sheet(BOTH, BOTH, media=(1.0, 1.5), tau=0.9)
    assert property_of("reciprocity", interface).verdict == PASS
    interface.provenance[MEDIA] = [1.0, 1.0]
    reciprocity = property_of("reciprocity", interface)
    assert reciprocity.verdict == FAIL and reciprocity.facts["largest"] == pytest.approx(2 * 1.25 / 3.25, abs=0.1)
    assert (
        "2.25 times as bright behind as in front, as between media whose indices are as 1 to 1.5" in reciprocity.detail
    )


def test_light_from_one_side_alone_tells_nothing_of_transmissions_reciprocity():
    front = check(sheet(POLAR, np.concatenate([POLAR, BEHIND])))
    assert front["reciprocity"].verdict == NOT_TESTABLE and front.overall == "undecided" and front.exit_status == 3
    assert "lit from the front alone" in front["reciprocity"].detail and front["reciprocity"].residual < 0.05
    through = property_of("reciprocity", sheet(POLAR, BEHIND))
    assert through.verdict == NOT_TESTABLE and "light from behind (gonio measure --lit both)" in through.detail
    assert property_of("reciprocity", sheet(POLAR, POLAR)).verdict == PASS


def interface(light, detector, alpha=0.5, eta=1.5):
    """An absorbing interface of air and glass, without noise."""
    grid = layouts.isotropic(light, detector, np.radians(np.arange(0, 360, 10.0)))
    f = grid_values(build(f"0.6 * rough_dielectric(alpha={alpha}, eta={eta})"), grid)
    table = whole_table_of_values(grid, f, u_f=NOISE * np.abs(f))
    table.provenance[MEDIA] = [1.0, eta]
    return table


def test_readings_on_one_side_of_the_horizon_have_no_partners_between_both_sides():
    """Lit up to 70°, the exchanged directions of what is read at 75° to 85° lie in the gap about the horizon."""
    judged = check(interface(np.concatenate([POLAR[:15], BEHIND[-15:]]), np.concatenate([POLAR, BEHIND])))
    assert judged["reciprocity"].verdict == UNDECIDED and "14 %" in judged["reciprocity"].detail


def test_light_that_is_refracted_may_end_between_two_nodes():
    """R + T of an interface lit from the front: within its bound, and without a stated width where it was read."""
    table = interface(POLAR[:14], np.concatenate([POLAR, BEHIND]))
    exact = 0.6 * sum(
        rule(build("rough_dielectric(alpha=0.5, eta=1.5)"), POLAR[:14], tolerance=1e-5).value
        for rule in (directional_albedo, directional_transmittance)
    )
    energy = property_of("energy", table, feature_width=np.radians(3.0))
    assert energy.verdict == PASS and energy.bound < 0.2 and "no lobe is narrower than 3°" in energy.assumes
    assert np.all(np.abs(np.array(energy.series["albedo"][0]) - exact) <= energy.series["bound"][0])
    assert property_of("energy", table).facts["passes_with_feature_width_deg"] < 3

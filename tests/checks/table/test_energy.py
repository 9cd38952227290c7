import dataclasses

import numpy as np
import pytest
from scipy.stats import binom

import gonio
from gonio.checks.hidden_lobes import width_of
from gonio.checks.table.energy import table_albedos, table_energy
from gonio.checks.table.evidence import TableEvidence
from gonio.data import layouts
from gonio.data.table import Channels, Table, whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.albedo import directional_albedo
from gonio.models.expression.builder import build
from support.check_tables import SQUARE, degrees, model_table, outgoing_grid
from support.marks import thorough

MERL = layouts.merl(counts=(45, 30, 60))


def energy_of(expression, layout, feature_width=0.0):
    return table_energy(TableEvidence(model_table(expression, layout), feature_width=feature_width), 0.01)


@pytest.mark.parametrize("shift", [0.0, 0.5])
def test_a_grid_that_cannot_resolve_the_lobe_decides_nothing(shift):
    # 5.2 with a node on the peak, 0.3 with the peak between nodes; 0.9999 in truth.
    energy = energy_of("ggx(alpha=0.01)", outgoing_grid(5.0, shift))
    assert energy.verdict == "undecided"
    albedo = np.array(energy.series["albedo"][0])[2]
    assert albedo > 5 if shift == 0 else albedo < 0.4


def test_a_mirror_between_the_nodes_of_a_flat_table_is_not_overlooked():
    # All readings are those of a diffuser of 0.3; the surface reflects 1.3.
    table = model_table("lambert(rho=0.3) + beckmann(alpha=0.001)", outgoing_grid(5.0, 0.5))
    np.testing.assert_allclose(table.f[table.flag == 0], 0.3 / np.pi)
    energy = table_energy(TableEvidence(table), 0.01)
    assert energy.verdict == "undecided" and "mirror" in energy.detail
    # Whoever knows that there is no such lobe may say so, and the certificate says how wide it has to be.
    least = energy.facts["passes_with_feature_width_deg"]
    assert np.degrees(width_of(0.001)) < least < 3 and f"--feature-width {least:g}" in energy.detail
    stated = table_energy(TableEvidence(table, feature_width=np.radians(least)), 0.01)
    assert stated.verdict == "pass" and stated.assumes == f"no lobe is narrower than {least:g}°"
    assert table_energy(TableEvidence(table, feature_width=np.radians(0.8 * least)), 0.01).verdict == "undecided"


@pytest.mark.parametrize(
    ("expression", "layout"),
    [
        ("ggx(alpha=0.3)", outgoing_grid(5.0)),
        ("ggx(alpha=0.3)", MERL),
        ("0.5 * beckmann(alpha=1) + lambert(rho=0.3)", outgoing_grid(10.0)),
    ],
    ids=["5", "merl", "10"],
)
def test_the_claimed_interval_holds_the_truth(expression, layout):
    series = energy_of(expression, layout).series
    theta = np.radians(series["theta_i_deg"])
    truth = directional_albedo(build(expression), theta, tolerance=1e-6).value
    albedo, bound = (np.array(series[k][0]) for k in ("albedo", "bound"))
    assert np.all(np.abs(albedo - truth) <= bound)
    assert np.all(bound[theta < np.radians(50)] < 0.1)


@pytest.mark.parametrize("layout", [outgoing_grid(5.0), MERL], ids=["5", "merl"])
def test_resolved_tables_are_decided(layout):
    assert energy_of("0.7 * ggx(alpha=0.5) + lambert(rho=0.2)", layout).verdict == "pass"
    assert energy_of("1.3 * ggx(alpha=0.3) + lambert(rho=0.2)", layout).verdict == "fail"


@pytest.mark.parametrize("alpha", [0.1, 0.3])
def test_what_is_undecided_says_how_fine_a_grid_decides(alpha):
    expression = f"0.7 * ggx(alpha={alpha})"
    coarse = energy_of(expression, outgoing_grid(10.0))
    assert coarse.verdict == "undecided" and "a step of about" in coarse.detail
    needed = coarse.facts["step_needed_deg"]
    assert 1 < needed < 10
    layout = layouts.isotropic(degrees(0, 81, 20), degrees(0, 89.9, needed), degrees(0, 360 - needed / 2, needed))
    assert energy_of(expression, layout, width_of(alpha)).verdict == "pass"


def test_the_albedo_carries_the_noise_of_the_cells_at_the_stated_level():
    f, scans, level = grid_values(build("lambert(rho=1)"), SQUARE), 40, 0.5
    noise, verdicts = 0.1 * f, []
    for seed in range(scans):
        readings = f + noise * np.random.default_rng(seed).standard_normal(f.shape)
        evidence = TableEvidence(whole_table_of_values(SQUARE, readings, u_f=noise), level, np.radians(20))
        energy = table_energy(evidence, 0.0)
        verdicts.append(energy.verdict)
    # A diffuser that reflects all surely exceeds 1 somewhere in no more than half of the level of the scans.
    assert "pass" not in verdicts and verdicts.count("fail") <= binom.ppf(0.999, scans, level / 2)
    assert 0.002 < energy.facts["noise_of_albedo"] < 0.02


def test_a_plane_or_a_cap_has_no_albedo():
    plane = layouts.in_plane(degrees(0, 81, 10), degrees(-80, 81, 10))
    cap = layouts.isotropic(degrees(0, 81, 10), degrees(0, 41, 10), degrees(0, 360, 10))
    for layout in (plane, cap):
        energy = energy_of("lambert(rho=0.5)", layout)
        assert energy.verdict == "undecided" and energy.residual is None


@pytest.mark.parametrize(
    ("expression", "counts"),
    [
        ("0.6 * lambert(rho=1) + 0.7 * ggx(alpha=0.12, eta=1.76)", (24, 24, 48)),
        ("0.05 * eon(rho=0.83, r=0.8) + 0.63 * beckmann(alpha=0.0976, eta=1.93)", (6, 6, 12)),
        *thorough(
            ("0.9068 * eon(rho=0.8, r=0.8828) + 1.2636 * ggx(alpha=0.2941, eta=1.5)", (24, 24, 48)),
            ("0.8895 * eon(rho=0.8, r=0.9976) + 1.954 * ggx(alpha=0.5655, eta=1.5)", (6, 6, 12)),
        ),
    ],
)
def test_bounds_of_coarse_half_difference_tables_hold_at_every_incidence(expression, counts):
    albedos = table_albedos(model_table(expression, layouts.merl(counts=counts)))
    exact = np.asarray(directional_albedo(build(expression), albedos.theta_i, tolerance=1e-7).value)
    assert (np.abs(albedos.value[:, 0] - exact) <= albedos.below[:, 0]).all()


@pytest.mark.parametrize(("albedo", "verdict"), [(1.9, "fail"), (0.9, "undecided")])
def test_an_incidence_that_was_read_in_part_fails_by_what_was_read_or_stays_open(albedo, verdict):
    """A diffuser read up to 60°: sin²60° of its albedo is in what was read."""
    theta, phi = (a.ravel() for a in np.meshgrid(degrees(0, 61, 5), degrees(0, 360, 15), indexing="ij"))
    whole_theta, whole_phi = (a.ravel() for a in np.meshgrid(degrees(0, 89, 4), degrees(0, 360, 15), indexing="ij"))
    theta_i = np.r_[np.full(theta.size, degrees(50, 51, 1)), np.full(whole_theta.size, degrees(10, 11, 1))]
    f = np.r_[np.full(theta.size, albedo / np.pi), np.full(whole_theta.size, 0.5 / np.pi)]
    table = Table.from_arrays(theta_i, 0.0, np.r_[theta, whole_theta], np.r_[phi, whole_phi], f)
    energy = table_energy(TableEvidence(table), 0.01)
    assert energy.verdict == verdict and energy.facts["not_judged_theta_i_deg"] == [50.0]
    assert albedo * 0.5 < 1 + energy.residual <= albedo * np.sin(np.radians(60)) ** 2 + 0.02
    assert "Judged at θi 10°" in energy.detail and "Undecided at θi 50°" in energy.detail


def test_the_coarsest_half_difference_grid_that_covers_the_hemisphere_has_a_bound():
    layout = layouts.half_difference(degrees(0, 90, 25), degrees(0, 90, 25), degrees(0, 180, 60))
    energy = energy_of("lambert(rho=0.5)", layout)
    assert energy.verdict == "undecided" or abs(1 + energy.residual - 0.5) <= energy.bound


@pytest.mark.parametrize("stated", [{"misalignment": np.radians(0.3)}, {"calibration": 0.03}], ids=["arms", "factor"])
def test_what_an_instrument_states_of_itself_is_in_the_bounds(stated):
    """Light 0.3° beside 85° lights the sample by up to 6 % more; so do readings with a factor that is off."""
    layout = layouts.isotropic(degrees(0, 86, 17), degrees(0, 86, 5), degrees(0, 360, 30))
    tables = [gonio.measure("lambert(rho=0.98)", gonio.Instrument(**stated), layout, seed=k) for k in range(4)]
    judged = [table_energy(TableEvidence(table), 0.01) for table in tables]
    assert {"undecided"} <= {energy.verdict for energy in judged} <= {"undecided", "pass"}
    assert all("states of its alignment" in energy.detail for energy in judged)
    bright = gonio.measure("lambert(rho=1) + lambert(rho=0.5)", gonio.Instrument(**stated), layout)
    assert table_energy(TableEvidence(bright), 0.01).verdict == "fail"


def test_one_azimuth_about_the_half_vector_leaves_energy_open():
    layout = layouts.half_difference(np.linspace(0, 1.5, 6), np.linspace(0, 1.4, 5), [0.5])
    f = np.full((*layout.shape, 1), 0.2)
    table = whole_table_of_values(layout, f, Channels.grey())
    energy = table_energy(TableEvidence(table), 0.01)
    assert energy.verdict == "undecided" and "one azimuth of the light about the half vector" in energy.detail


def test_readings_that_repeat_others_make_albedos_no_better_known():
    """One side was copied to the other; beside it the same values but for 1e-5, which are readings of their own."""
    polar, azimuths = np.radians(np.arange(0, 81, 10)), np.radians(np.arange(0, 360, 15))
    layout, rng = layouts.isotropic(polar, polar, azimuths), np.random.default_rng(3)
    f = grid_values(build("lambert(rho=0.6)"), layout)
    y = f * (1 + 0.05 * rng.standard_normal(f.shape))
    y = y[:, :, np.minimum(np.arange(azimuths.size), -np.arange(azimuths.size) % azimuths.size)]
    apart = y * (1 + 1e-5 * rng.standard_normal(f.shape))
    # Of a simulated instrument: of another one readings that agree so well would share an error.
    tables = [whole_table_of_values(layout, a, u_f=0.05 * f) for a in (y, apart)]
    tables = [dataclasses.replace(t, provenance={"instrument": {"photons": 1e4}}) for t in tables]
    bound, of_more = (np.array(table_energy(TableEvidence(t), 0.01).series["bound"]) for t in tables)
    assert (bound > 1.1 * of_more).all()

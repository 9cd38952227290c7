"""Agreement of tables, and of models, with a table of the same surface or of another one."""

import numpy as np
import pytest

import gonio
from gonio.data import layouts
from support.check_tables import degrees, model_table, property_of
from support.marks import thorough

PAINT = "lambert(rho=0.3) + 0.3 * ggx(alpha=0.12, f0=0.5)"
FINE = layouts.isotropic(degrees(0, 81, 5), degrees(0, 81, 5), degrees(0, 360, 15))
COARSE = layouts.isotropic(degrees(0, 81, 20), degrees(0, 81, 10), degrees(0, 360, 30))
APART = layouts.isotropic(degrees(0, 81, 10), degrees(2, 81, 7), degrees(0, 360, 30))


def as_list(table):
    wi, wo = table.layout.directions_at(np.arange(table.layout.size))
    angles = (np.arccos(wi.z), np.arctan2(wi.y, wi.x), np.arccos(wo.z), np.arctan2(wo.y, wo.x))
    return gonio.Table.from_arrays(*angles, np.asarray(table.f).ravel())


@pytest.mark.parametrize(
    ("layout", "other"), [(COARSE, "list"), (APART, "grid"), *thorough((COARSE, "grid"), (APART, "list"))]
)
def test_a_table_does_not_fail_beside_a_coarser_one_of_the_same_surface(layout, other):
    """Between the readings of the coarser one a lobe is anywhere; what both read is compared as it is."""
    coarse, fine = model_table(PAINT, layout), model_table(PAINT, FINE)
    coarse = as_list(coarse) if other == "list" else coarse
    assert property_of("agreement", fine, against=coarse).verdict != "fail"
    brighter = model_table(f"1.25 * ({PAINT})", FINE)
    assert property_of("agreement", brighter, against=coarse).verdict == "fail"


def test_readings_of_the_same_directions_are_compared_without_interpolation():
    coarse, fine = model_table(PAINT, COARSE), model_table(PAINT, FINE)
    agreement = property_of("agreement", coarse, against=fine)
    assert agreement.verdict == "pass" and agreement.residual < 1e-12


SIDES = layouts.isotropic(degrees(0, 76, 15), np.append(degrees(0, 76, 15), degrees(105, 181, 15)), degrees(0, 360, 15))


@pytest.mark.parametrize(
    "make",
    [
        lambda: model_table("thin_sheet(rho=0.3, tau=0.4) + 0.2 * transmitted(base=ggx(alpha=0.3))", SIDES),
        lambda: model_table(PAINT, layouts.merl(counts=(6, 6, 12))),
        lambda: as_list(model_table(PAINT, COARSE)),
    ],
    ids=["both sides", "half vectors", "list"],
)
def test_a_table_agrees_with_itself(make):
    table = make()
    agreement = property_of("agreement", table, against=table)
    assert agreement.verdict == "pass" and agreement.residual < 1e-9


def test_nothing_is_said_where_the_other_table_was_not_read():
    narrow = model_table(PAINT, layouts.isotropic(degrees(0, 41, 5), degrees(0, 41, 5), degrees(0, 360, 15)))
    agreement = property_of("agreement", model_table(PAINT, FINE), against=narrow)
    assert agreement.verdict == "undecided" and "says nothing of" in agreement.detail


def test_a_model_is_judged_by_the_readings_of_a_table():
    table = model_table(PAINT, COARSE)
    assert property_of("agreement", PAINT, against=table).verdict == "pass"
    brighter = f"1.03 * ({PAINT})"
    for tolerance, verdict in ((None, "pass"), (0.01, "fail")):
        assert property_of("agreement", brighter, against=table, tolerances={"agreement": tolerance}).verdict == verdict
    other = property_of("agreement", PAINT.replace("0.12", "0.2"), against=table)
    assert other.verdict == "fail" and other.where


@pytest.mark.parametrize(("stated", "verdict"), [(0.03, "pass"), (0.003, "fail")])
def test_noise_of_both_tables_counts(stated, verdict):
    def noise(seed):
        return lambda f, *_: f * (1 + 0.03 * np.random.default_rng(seed).normal(size=f.shape))

    one, two = (model_table(PAINT, FINE, noise(seed), stated=stated) for seed in (0, 1))
    assert property_of("agreement", one, against=two).verdict == verdict


def test_a_grey_table_is_held_against_every_channel_of_the_other():
    grey, three = (model_table(f"lambert(rho={rho})", COARSE) for rho in ("0.5", "[0.5, 0.5, 0.9]"))
    for other in (three, gonio.material("lambert(rho=[0.5, 0.5, 0.9])")):
        assert property_of("agreement", grey, against=other).residual == pytest.approx(0.4 / 0.7, rel=1e-6)


def of_azimuth(surface, phi_i):
    layout = layouts.spherical(degrees(0, 81, 20), [phi_i], degrees(0, 81, 10), degrees(0, 360, 30))
    return model_table(surface, layout)


def test_a_brushed_surface_lit_from_another_azimuth_is_not_another_surface():
    brushed = "lambert(rho=0.2) + ggx(alpha_x=0.3, alpha_y=0.12, f0=0.8)"
    along, across, every = of_azimuth(brushed, 0.0), of_azimuth(brushed, np.pi / 2), model_table(brushed, COARSE)
    agreement = property_of("agreement", along, against=across)
    assert agreement.verdict == "undecided" and "other azimuths" in agreement.detail
    assert property_of("agreement", every, against=along).verdict != "fail"  # the same azimuth
    paint = model_table(f"1.25 * ({PAINT})", COARSE)
    assert property_of("agreement", of_azimuth(PAINT, np.pi / 2), against=paint).verdict == "fail"


READ = layouts.isotropic(degrees(0, 86, 5), degrees(0, 86, 5), degrees(0, 360, 30))
SATIN = "lambert(rho=0.155) + 0.34 * ggx(alpha=0.044, f0=0.54)"


@pytest.mark.parametrize(
    ("instrument", "verdict"),
    [
        (gonio.Instrument(detector_half_angle=np.radians(3), photons=1e5), "pass"),
        (gonio.Instrument(misalignment=np.radians(0.2)), "undecided"),
    ],
    ids=["apertures", "misaligned"],
)
def test_readings_of_an_instrument_are_not_those_of_another_surface(instrument, verdict):
    """They are averages over discs, and may be off by what is stated of the arms: both as the reference is read."""
    table = gonio.measure(SATIN, instrument, READ, seed=2)
    made = gonio.check(table, against=SATIN)
    assert made["agreement"].verdict == verdict
    for reciprocity in (made["reciprocity"], property_of("reciprocity", table.as_list())):
        assert reciprocity.verdict == "undecided" and "as stated, may explain it" in reciprocity.detail
    assert property_of("agreement", table, against=f"1.25 * ({SATIN})").verdict == "fail"


def test_what_an_instrument_does_not_explain_still_fails():
    table = gonio.measure(SATIN, gonio.Instrument(misalignment=np.radians(0.05)), READ, seed=2)
    theta_i, _, theta_o, _ = (a.reshape(READ.shape)[..., None] for a in READ.angles())
    table.f[...] = table.f * (1 + 0.2 * np.sign(theta_o - theta_i))
    assert property_of("reciprocity", table).verdict == "fail"

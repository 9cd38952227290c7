import numpy as np
import pytest

from gonio.checks.certify import TABLE_TOLERANCES
from gonio.checks.certify_table import check_table, table_positivity
from gonio.checks.table.energy import table_energy
from gonio.checks.table.reciprocity import table_reciprocity, table_symmetry
from gonio.data import layouts
from gonio.data.table import whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.albedo import directional_albedo
from gonio.models.expression.builder import build
from support import helpers


def degrees(*range_):
    return np.radians(np.arange(*range_))


def grid(step, shift=0.0):
    return layouts.isotropic(degrees(0, 81, 20), degrees(shift * step, 89.9, step), degrees(0, 360, step))


SQUARE = layouts.isotropic(degrees(0, 86, 10), degrees(0, 86, 10), degrees(0, 360, 30))


def table(expression, layout, noise=0.0, known=True):
    f = grid_values(build(expression), layout)
    u = noise * np.abs(f) if noise and known else None
    f = f + noise * f * np.random.default_rng(0).standard_normal(f.shape)
    return whole_table_of_values(layout, f, u_f=u)


@pytest.mark.parametrize("shift", [0.0, 0.5])
def test_a_grid_that_cannot_resolve_the_lobe_decides_nothing(shift):
    # 5.2 with a node on the peak, 0.3 with the peak between nodes; 0.9999 in truth.
    lobe = table("ggx(alpha=0.01)", grid(5.0, shift))
    found = table_energy(lobe, 0.01)
    assert found.verdict == "undecided"
    read = np.array(found.series["albedo"][0])[2]
    assert read > 5 if shift == 0 else read < 0.4


def test_a_mirror_between_the_nodes_of_a_flat_table_is_not_overlooked():
    # All readings are those of a diffuser of 0.3; the surface reflects 1.3.
    hidden = table("lambert(rho=0.3) + beckmann(alpha=0.001)", grid(5.0, 0.5))
    np.testing.assert_allclose(hidden.f[hidden.flag == 0], 0.3 / np.pi)
    found = table_energy(hidden, 0.01)
    assert found.verdict == "undecided" and "mirror" in found.detail
    # Who knows that there is no such lobe may say so.
    assert table_energy(hidden, 0.01, feature_width=np.radians(6)).verdict == "pass"


@pytest.mark.parametrize("layout", [grid(5.0), grid(10.0), layouts.merl(counts=(60, 45, 90))], ids=["5", "10", "merl"])
@pytest.mark.parametrize("expression", ["ggx(alpha=0.3)", "0.5 * beckmann(alpha=1) + lambert(rho=0.3)"])
def test_the_claimed_interval_holds_the_truth(layout, expression):
    found = table_energy(table(expression, layout), 0.01)
    theta = np.radians(found.series["theta_i_deg"])
    truth = directional_albedo(build(expression), theta, tolerance=1e-6).value
    read, bound = (np.array(found.series[k][0]) for k in ("albedo", "bound"))
    assert np.all(np.abs(read - truth) <= bound)
    assert np.all(bound[theta < np.radians(50)] < 0.1)


@pytest.mark.parametrize("layout", [grid(5.0), layouts.merl(counts=(60, 45, 90))], ids=["5", "merl"])
def test_resolved_tables_are_decided(layout):
    assert table_energy(table("0.7 * ggx(alpha=0.5) + lambert(rho=0.2)", layout), 0.01).verdict == "pass"
    assert table_energy(table("1.3 * ggx(alpha=0.3) + lambert(rho=0.2)", layout), 0.01).verdict == "fail"


@pytest.mark.parametrize("alpha", [0.1, 0.3])
def test_what_is_undecided_says_how_fine_a_grid_decides(alpha):
    expression = f"0.7 * ggx(alpha={alpha})"
    coarse = table_energy(table(expression, grid(10.0)), 0.01)
    assert coarse.verdict == "undecided" and "a step of about" in coarse.detail
    needed = coarse.facts["step_needed_deg"]
    assert 1 < needed < 10
    layout = layouts.isotropic(degrees(0, 81, 20), degrees(0, 89.9, needed), degrees(0, 360 - needed / 2, needed))
    assert table_energy(table(expression, layout), 0.01, np.radians(2 * needed)).verdict == "pass"


def test_the_albedo_carries_the_noise_of_the_cells_at_the_stated_level():
    f = grid_values(build("lambert(rho=1)"), SQUARE)
    seen = []
    for seed in range(40):
        noise = 0.1 * f
        read = whole_table_of_values(
            SQUARE, f + noise * np.random.default_rng(seed).standard_normal(f.shape), u_f=noise
        )
        found = table_energy(read, 0.0, feature_width=np.radians(20), level=0.5)
        seen.append(found.verdict)
        largest = found.facts["noise_of_albedo"]
    # A diffuser that reflects all exceeds 1 for sure somewhere in no more than a quarter of the scans (10 ± 2.7).
    assert "pass" not in seen and seen.count("fail") <= 18
    assert 0.002 < largest < 0.02


def test_a_plane_or_a_cap_has_no_albedo():
    plane = layouts.in_plane(degrees(0, 81, 10), degrees(-80, 81, 10))
    cap = layouts.isotropic(degrees(0, 81, 10), degrees(0, 41, 10), degrees(0, 360, 10))
    for layout in (plane, cap):
        found = table_energy(table("lambert(rho=0.5)", layout), 0.01)
        assert found.verdict == "undecided" and found.residual is None


def two_way(m=2000):
    rng = np.random.default_rng(0)
    theta, phi = np.arccos(1 - 0.9 * rng.random((2, m))), 2 * np.pi * rng.random((2, m))
    return layouts.scattered(
        np.r_[theta[0], theta[1]], np.r_[phi[0], phi[1]], np.r_[theta[1], theta[0]], np.r_[phi[1], phi[0]]
    )


LAYOUTS = {
    "isotropic": SQUARE,
    "half of the azimuths": layouts.isotropic(degrees(0, 86, 10), degrees(0, 86, 10), degrees(0, 181, 30)),
    "spherical": layouts.spherical(degrees(0, 86, 15), degrees(0, 360, 60), degrees(0, 86, 15), degrees(0, 360, 30)),
    "one light azimuth": layouts.spherical(degrees(0, 86, 10), [0.5], degrees(0, 86, 10), degrees(0, 360, 30) + 0.5),
    "half/difference": layouts.half_difference(degrees(0, 80, 4), degrees(0, 90, 5), degrees(0, 360, 15)),
    "in plane": layouts.in_plane(degrees(0, 81, 5), degrees(-80, 81, 5)),
    "scattered": two_way(),
}


def tilted(layout):
    """f ∝ 1 + 0.2 cosθi: the two values of a pair differ by 0.2 |cosθi − cosθo| / (1 + 0.1 (cosθi + cosθo))."""
    cos_i, _ = layout.cosines()
    return whole_table_of_values(layout, (1 + 0.2 * cos_i).reshape(layout.shape))


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_pairs_are_found_on_every_layout_and_differ_as_they_should(layout):
    assert table_reciprocity(table("ggx(alpha=0.4)", layout), 0.05).residual < 1e-6
    found = table_reciprocity(tilted(layout), 0.05)
    cos_i, cos_o = layout.cosines()
    below = np.minimum(cos_i, cos_o) > np.cos(np.radians(70))
    expected = np.max(np.abs(0.2 * (cos_i - cos_o) / (1 + 0.1 * (cos_i + cos_o)))[below])
    assert found.facts["largest"] == pytest.approx(expected, rel=1e-6)
    assert 0 < found.residual < expected
    assert found.facts["pairs"] > 10


def test_a_layout_that_stores_one_value_for_both_cannot_be_tested():
    assert table_reciprocity(tilted(layouts.merl(counts=(8, 8, 8))), 0.05).verdict == "not applicable"


def test_grids_that_differ_are_compared_through_interpolation_with_its_error():
    layout = layouts.isotropic(degrees(0, 81, 10), degrees(2.5, 85, 5), degrees(0, 360, 15))
    found = table_reciprocity(table("lambert(rho=0.3) + 0.2 * ggx(alpha=0.5)", layout), 0.05)
    assert found.verdict == "pass" and found.facts["interpolation_error"] > 0


def test_known_noise_is_not_taken_for_a_broken_law():
    lobe = "lambert(rho=0.5)"
    known, unknown = (table_reciprocity(table(lobe, SQUARE, 0.1, k), 0.05) for k in (True, False))
    assert known.verdict == "undecided" and unknown.verdict == "fail"
    assert known.facts["chi2_per_pair"] == pytest.approx(1, abs=0.2)
    assert known.facts["share_beyond_2_sigma"] == pytest.approx(0.0455, abs=0.03)


def test_a_table_lopsided_in_azimuth_is_not_symmetric():
    angles = SQUARE.angles()[3].reshape(SQUARE.shape)
    assert table_symmetry(whole_table_of_values(SQUARE, 1 + 0.3 * np.sin(angles)), 0.05).verdict == "fail"
    assert table_symmetry(table("ggx(alpha=0.5)", SQUARE), 0.05).verdict == "pass"
    assert table_symmetry(table("ggx(alpha=0.5)", LAYOUTS["half of the azimuths"]), 0.05).verdict == "not applicable"


def test_negative_readings_are_counted_and_judged_beyond_their_noise():
    one = table("lambert(rho=0.5)", SQUARE)
    one.f[3, 4, :] = -0.01
    found = table_positivity(one, 0.001)
    assert found.facts["negative"] == 12 and found.verdict == "fail"
    one.u_f = np.full(one.f.shape, 0.01)
    assert table_positivity(one, 0.001).verdict == "pass"


def test_nothing_valid_is_undecided_everywhere():
    one = table("lambert(rho=0.5)", SQUARE)
    one.flag[...] = 4
    found = check_table(one, TABLE_TOLERANCES)
    assert [p.verdict for p in found[:4]] == ["undecided", "undecided", "undecided", "undecided"]
    assert all(p.verdict in ("undecided", "not applicable") for p in found)


@pytest.mark.parametrize(
    ("name", "verdict"),
    [("cc_ibiza_sunset", "fail"), ("paper_blue", "pass")],
)
def test_measured_materials_are_judged_as_known(name, verdict):
    from gonio.data.formats.rgl_file import read_rgl

    found = table_reciprocity(read_rgl(helpers.shared("data", "rgl", f"{name}_rgb.bsdf")), 0.05)
    assert found.verdict == verdict
    assert found.residual > 0.16 if verdict == "fail" else found.residual < 0.03

import dataclasses
import json

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import minimize

import gonio
from gonio.__main__ import main
from gonio.checks.repairs.albedo_rows import albedo_rows
from gonio.checks.repairs.nearest_table import repair
from gonio.checks.repairs.projection import nearest
from gonio.checks.table.energy import table_albedos
from gonio.data import layouts
from gonio.data.hdf5.writer import open_table, write_table
from gonio.data.interpolation.multilinear import as_material
from gonio.data.table import Channels, whole_table_of_values
from gonio.models.errors import GonioError
from support.check_tables import LAYOUTS, SQUARE, degrees

GRIDS = {name: LAYOUTS[name] for name in ("isotropic", "half of the azimuths", "spherical", "half/difference")}


def lawless(layout, level=0.33, u=None, seed=0):
    """f that grows with cosθi alone and reflects more than it receives at normal incidence; 2 % noise."""
    cos_i, cos_o = layout.cosines()
    rng = np.random.default_rng(seed)
    f = level * (1 + 0.2 * cos_i) * (1 + 0.02 * rng.standard_normal(cos_i.size))
    f = np.where(np.minimum(cos_i, cos_o) > 0, f, np.nan)
    return whole_table_of_values(layout, f.reshape(layout.shape), u_f=u)


@pytest.mark.parametrize("nonnegative", [False, True])
def test_the_projection_is_the_nearest_point(nonnegative):
    rng = np.random.default_rng(0)
    start, weight = rng.standard_normal(30) + 0.3, rng.uniform(0.5, 2, 30)
    rows = np.abs(rng.standard_normal((5, 30))) * (rng.random((5, 30)) < 0.5)
    repaired = nearest(start, weight, sparse.csr_array(rows), np.full(5, 0.7), nonnegative)
    other = minimize(
        lambda y: np.sum(weight * (y - start) ** 2),
        np.zeros(30),
        jac=lambda y: 2 * weight * (y - start),
        constraints={"type": "ineq", "fun": lambda y: 0.7 - rows @ y, "jac": lambda y: -rows},
        bounds=[(0 if nonnegative else None, None)] * 30,
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    np.testing.assert_allclose(repaired.point, other.x, atol=1e-5)
    assert repaired.missed <= 1e-11 and repaired.steps < 50 and np.count_nonzero(repaired.multipliers) > 1


@pytest.mark.parametrize("layout", GRIDS.values(), ids=GRIDS)
def test_rows_are_the_albedos_that_the_check_integrates(layout):
    table = lawless(layout)
    rows = albedo_rows(table, 0)
    np.testing.assert_allclose(rows @ np.nan_to_num(table.f.ravel()), table_albedos(table).value[:, 0], rtol=1e-12)


@pytest.mark.parametrize(
    "layout",
    [
        pytest.param(grid, marks=pytest.mark.thorough if name == "half/difference" else (), id=name)
        for name, grid in GRIDS.items()
    ],
)
def test_a_repaired_table_obeys_both_laws_at_once(layout):
    table = lawless(layout)
    repaired = repair(table, feature_width=0.6)
    assert repaired.before.overall == "fail"
    assert repaired.after["reciprocity"].verdict == "pass" and repaired.after["reciprocity"].residual < 1e-12
    assert np.max(table_albedos(repaired.table).value) <= 1 + 1e-9 < np.max(table_albedos(table).value)
    assert 0 < repaired.moved["relative_rms"] < 0.2
    assert repaired.after["energy"].verdict != "fail" and sum(repaired.moved["incidences_at_the_limit"]) > 0
    again = repair(repaired.table)
    np.testing.assert_allclose(again.table.f, repaired.table.f, rtol=1e-9)


def test_it_is_nearer_than_averaging_and_dimming():
    table = lawless(SQUARE, u=np.full((*SQUARE.shape, 1), 0.01))
    repaired = repair(table)
    f = table.f[..., 0]
    mean = (f + f.transpose(1, 0, 2)[:, :, (-np.arange(12)) % 12]) / 2
    dimmed = mean / np.max(albedo_rows(table, 0) @ mean.ravel())
    assert repaired.moved["rms_in_uncertainties"] < 0.9 * np.sqrt(np.mean(((dimmed - f) / 0.01) ** 2))
    np.testing.assert_allclose(repaired.table.u_f[2, 4], 0.01 / np.sqrt(2), rtol=1e-12)


def test_a_lawful_table_is_left_as_it_is_and_uncertain_readings_move_most():
    honest = whole_table_of_values(SQUARE, np.full(SQUARE.shape, 0.2))
    np.testing.assert_allclose(repair(honest).table.f, honest.f, rtol=1e-14)
    u = np.full((*SQUARE.shape, 1), 0.01)
    u[3, 5, 2] = 0.1
    one = whole_table_of_values(SQUARE, honest.f[..., 0].copy(), u_f=u)
    one.f[3, 5, 2] = 0.3
    fixed = repair(one).table.f[..., 0]
    # The weighted mean of 0.3 ± 0.1 and 0.2 ± 0.01.
    assert fixed[3, 5, 2] == fixed[5, 3, 10] == pytest.approx(0.2 + 0.1 / 101)


def test_negative_readings_are_kept_unless_asked_otherwise():
    table = lawless(SQUARE, 0.2)
    table.f[4, 4, 3], table.f[4, 4, 9] = -0.02, -0.02
    assert repair(table).table.f.min() == pytest.approx(-0.02)
    assert repair(table, nonnegative=True).table.f.min() == 0


def test_what_cannot_be_repaired_is_refused():
    uneven = layouts.isotropic(degrees(0, 81, 10), degrees(2.5, 85, 5), degrees(0, 360, 30))
    few = layouts.scattered([0.1, 0.2], [0, 0], [0.3, 0.1], [0, 0])
    for table in (lawless(uneven), lawless(few), 3):
        with pytest.raises(GonioError):
            repair(table)
    assert gonio.repair is repair


def test_the_command_writes_another_file_with_its_provenance(tmp_path, capsys):
    source, out, certificate = tmp_path / "a.h5", tmp_path / "b.h5", tmp_path / "c.json"
    write_table(source, lawless(SQUARE))
    status = main(["check", str(source), "--repair", str(out), "--json", str(certificate), "--feature-width", "30"])
    printed = capsys.readouterr().out
    assert "readings moved by" in printed and "at the limit of 1" in printed
    content = json.loads(certificate.read_text())
    assert content["overall"] == "fail" and content["repair"]["after"]["exit_status"] == status
    assert open_table(out).provenance["repaired"]["moved"] == content["repair"]["moved"]
    assert main(["check", str(source), "--repair", str(source), "--force"]) == 2
    assert main(["check", str(source), "--nonnegative"]) == 2
    assert main(["check", str(source), "--step", "2"]) == 2
    for wrong in (["--feature-width", "500"], ["--level", "2"], ["--tol-energy", "-1"]):
        assert main(["check", str(source), "--repair", str(tmp_path / "d.h5"), *wrong]) == 2
    assert main(["check", "lambert(rho=0.5)", "--repair", str(tmp_path / "d.h5")]) == 2
    assert not (tmp_path / "d.h5").exists()


def test_a_table_between_directions_is_repaired_on_a_grid_of_the_step_asked_for(tmp_path):
    path = tmp_path / "three.h5"
    f = np.stack([lawless(SQUARE, level).f[..., 0] for level in (0.1, 0.2, 0.33)], axis=-1)
    table = whole_table_of_values(SQUARE, f, channels=Channels.rgb())
    write_table(path, table)
    repaired = repair(path)
    assert repaired.before["reciprocity"].where["channel"] in ("R", "G", "B")
    warped = dataclasses.replace(table, interpolant=lambda: as_material(table))
    assert repair(warped, step=15).table.layout.shape == (6, 6, 24)
    for step in (0.5, 20, float("nan")):
        with pytest.raises(GonioError, match="1 to 15"):
            repair(warped, step=step)
    with pytest.raises(GonioError, match="grid of its own"):
        repair(table, step=5)


@pytest.mark.parametrize(
    ("levels", "index2"), [((0.4, 0.45, 0.5), 1.0), ((0.28, 0.28, 0.28), 2.25)], ids=["sheet", "interface"]
)
def test_light_from_both_sides_becomes_reciprocal_and_no_more_than_arrives(levels, index2):
    """f over the squared index of the exit is that of exchanged light, R + T ≤ 1, and what is lawful stays."""
    polar = np.radians(np.arange(0, 90, 15.0))
    both = np.append(polar, np.pi - polar[::-1])
    layout = layouts.isotropic(both, both, np.radians(np.arange(0, 360, 30.0)))
    behind, exit2 = (c < 0 for c in layout.cosines()), np.where(layout.cosines()[1] < 0, index2, 1.0)
    level = np.array(levels)[sum(b.astype(int) for b in behind)]  # reflected, transmitted, reflected behind
    truth = (level / np.pi * exit2).reshape(layout.shape)
    about = {"media": [1.0, index2**0.5]}
    noise = np.random.default_rng(0).standard_normal(layout.shape)
    noisy = whole_table_of_values(layout, 1.3 * truth * (1 + 0.2 * noise), provenance=about)
    repaired = gonio.repair(noisy)
    f, cells = repaired.table.f.reshape(-1), np.arange(layout.size)
    np.testing.assert_allclose(f / exit2, (f / exit2)[layout.exchanged(cells)], rtol=1e-12)
    before, after = (np.max(c["energy"].series["albedo"]) for c in (repaired.before, repaired.after))
    assert before > 1.05 and after <= 1 + 1e-9
    assert repaired.after["reciprocity"].verdict == "pass" and repaired.table.media[1] == index2**0.5
    even = whole_table_of_values(layout, truth, provenance=about)
    assert gonio.repair(even).moved["relative_rms"] < 1e-12

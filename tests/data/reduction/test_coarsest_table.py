"""Reduced tables: within the tolerance as measured afterwards, smaller, and no symmetry that the surface breaks."""

import dataclasses

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.hdf5.reader import open_table
from gonio.data.hdf5.writer import write_table
from gonio.data.interpolation.multilinear import as_material
from gonio.data.reduction import coarsest_table
from gonio.data.reduction.coarsest_table import reduce_table
from gonio.data.reduction.thin_grid import SceneValues, StartGrid, Thinning
from gonio.data.scene import Range, Scene
from gonio.data.table import whole_table_of_values
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from support.fit_tables import ONE_LOBE as ONE
from support.fit_tables import coarse_table_of as table_of

THETA = np.radians(np.arange(0, 81, 10.0))
GRID = layouts.isotropic(THETA, THETA, np.radians(np.arange(0, 360, 30.0)))
ROUND_ABOUT = (0.0, 2 * np.pi)
WHOLE_ROUND = layouts.spherical(
    THETA[::2], np.radians(np.arange(0, 360, 45.0)), THETA[::2], np.radians(np.arange(0, 360, 22.5))
)
SUN = Scene("sun", 0.05, (Range((0.9, 1.2), ROUND_ABOUT, 1.0),), (Range((0.0, 1.2), ROUND_ABOUT, 1.0),))


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Fewer directions and coarser grids to start from: the rules are the same."""
    monkeypatch.setattr(coarsest_table, "SEARCH", 2500)
    monkeypatch.setattr(coarsest_table, "CHECK", 9000)
    monkeypatch.setattr(coarsest_table, "HALF_DIFFERENCE", (18, 12, 8))


def error_of(reduced, whole, scene):
    pairs = scene.pairs(9000)
    f, truth = (np.asarray(evaluate(as_material(t), pairs.wi, pairs.wo)) for t in (reduced, whole))
    return pairs.error(np.broadcast_to(f.reshape(pairs.view.size, -1), truth.shape), truth)


@pytest.fixture(scope="module")
def whole():
    return table_of(ONE, GRID, noise=0.0)


def test_a_trial_is_what_the_interpolant_of_the_thinned_table_says(whole):
    pairs = SUN.pairs(500)
    truth = np.asarray(evaluate(as_material(whole), pairs.wi, pairs.wo))
    thinning = Thinning(StartGrid(whole.layout, whole.f, np.isfinite(whole.f)), SceneValues(pairs, truth))
    assert thinning.error(thinning.grid.nodes) < 1e-6  # single precision
    kept = (np.array([0, 3, 4, 8]), np.array([1, 5]), np.array([0, 2, 7, 11]))
    grid = GRID.part(**dict(zip(GRID.axes, kept, strict=True)))
    small = as_material(whole_table_of_values(grid, whole.f[np.ix_(*kept)]))
    f = np.asarray(evaluate(small, pairs.wi, pairs.wo))
    assert thinning.error(kept) == pytest.approx(pairs.error(f, truth), rel=1e-5)


def test_a_reduced_table_is_small_and_within_the_tolerance(whole):
    reduced = reduce_table(whole, SUN)
    assert reduced.error <= 0.05 and error_of(reduced.table, whole, SUN) <= 0.055
    assert reduced.cells[1] < reduced.cells[0] / 4 and any("bilateral symmetry" in words for words in reduced.left_out)
    strict = reduce_table(whole, SUN, tolerance=0.01)
    assert strict.error <= 0.01 and strict.cells[1] > reduced.cells[1]


def same_reduction(a, b):
    """Whether two reductions keep the same nodes and err alike."""
    assert a.table.layout == b.table.layout and a.error == pytest.approx(b.error, rel=1e-3)
    assert a.left_out == b.left_out and a.cells[1] == b.cells[1]


def test_scaling_f_scales_the_reduced_table_and_nothing_else(whole):
    factor = 7.0
    scaled = reduce_table(dataclasses.replace(whole, f=factor * whole.f), SUN)
    plain = reduce_table(whole, SUN)
    same_reduction(scaled, plain)
    np.testing.assert_allclose(scaled.table.f, factor * plain.table.f, rtol=1e-6)


def test_permuting_channels_permutes_the_reduced_table_and_nothing_else(whole):
    order = [2, 0, 1]
    permuted, plain = reduce_table(dataclasses.replace(whole, f=whole.f[..., order]), SUN), reduce_table(whole, SUN)
    same_reduction(permuted, plain)
    np.testing.assert_array_equal(permuted.table.f, plain.table.f[..., order])


def test_channels_of_the_scene_are_those_of_a_table_of_them(whole):
    of_scene = reduce_table(whole, dataclasses.replace(SUN, channels=("B", "R")))
    assert of_scene.left_out[0].startswith("1 of 3 channels")
    of_table = reduce_table(whole.only(["B", "R"]), SUN)
    same_reduction(dataclasses.replace(of_scene, left_out=of_scene.left_out[1:]), of_table)
    np.testing.assert_array_equal(of_scene.table.f, of_table.table.f)


def test_grey_and_flat_surfaces_need_next_to_nothing():
    reduced = reduce_table(table_of("lambert(rho=[.3,.3,.3])", GRID, noise=0.0), SUN)
    assert reduced.cells[1] == 1 and reduced.error < 1e-6 and any("colour" in words for words in reduced.left_out)


def test_no_symmetry_is_assumed_that_the_scene_would_miss():
    brushed = table_of("lambert(rho=.1) + 0.4*ggx(alpha_x=.2, alpha_y=.6)", WHOLE_ROUND, noise=0.0)
    reduced = reduce_table(brushed, SUN)
    assert reduced.table.layout.name == "spherical" and reduced.error <= 0.05


def test_isotropy_shows_from_any_azimuth():
    axes = {n: a + 0.1 if n.startswith("phi") else a for n, a in WHOLE_ROUND.axes.items()}
    table = table_of("lambert(rho=.1) + 0.2*ggx(alpha=.6)", type(WHOLE_ROUND)(axes), noise=0.0)
    reduced = reduce_table(table, SUN, tolerance=0.1)
    assert reduced.error <= 0.1 and reduced.table.layout.name != "spherical"
    assert any("isotropy" in words for words in reduced.left_out)


@pytest.mark.parametrize("stored", [False, True])
def test_light_of_one_azimuth_is_reduced_as_light_at_any_other(stored, tmp_path):
    whole = table_of("lambert(rho=.3) + 0.05*ggx(alpha=.6)", GRID, noise=0.0)
    light, turns = np.radians(137.0), GRID.axes["delta_phi"]
    phi = np.mod(light + turns, 2 * np.pi)
    order = np.argsort(phi)
    layout = layouts.spherical(THETA, [light], THETA, phi[order])
    at_x = dataclasses.replace(whole, provenance={})
    turned = dataclasses.replace(
        at_x, layout=layout, f=whole.f[:, None][..., order, :], flag=whole.flag[:, None][..., order, :]
    )
    if stored:
        write_table(tmp_path / "t.h5", turned)
        turned = open_table(tmp_path / "t.h5", lazy_bytes=10)
    expected, reduced = reduce_table(at_x, SUN, tolerance=0.1), reduce_table(turned, SUN, tolerance=0.1)
    assert reduced.error == pytest.approx(expected.error, rel=1e-2)
    assert expected.promised < 0.2 and reduced.promised == pytest.approx(expected.promised, rel=0.1)
    assert (reduced.cells, reduced.left_out) == (expected.cells, expected.left_out)
    assert error_of(reduced.table, at_x, SUN) <= 0.11


def test_what_cannot_be_reduced_is_one_sentence(whole):
    with pytest.raises(GonioError, match="larger tolerance"):
        reduce_table(
            whole_table_of_values(layouts.isotropic([0.3], [0.4], [0.0]), np.full((1, 1, 1, 1), 0.3, np.float32)), SUN
        )
    flat = layouts.in_plane(THETA, np.radians(np.arange(-60, 61, 20.0)))
    with pytest.raises(GonioError, match="in-plane"):
        reduce_table(table_of(ONE, flat), SUN)
    dark = whole_table_of_values(GRID, np.zeros((*GRID.shape, 1)))
    with pytest.raises(GonioError, match="dark"):
        reduce_table(dark, SUN)


def test_the_command_line_lists_what_is_omitted(tmp_path, capsys, whole):
    from gonio.__main__ import main
    from gonio.data.hdf5.writer import open_table, write_table

    source, out, scene = (str(tmp_path / n) for n in ("t.h5", "small.h5", "s.toml"))
    write_table(source, whole)
    (tmp_path / "s.toml").write_text(
        'gonio_scene = 1\ntolerance = 0.05\nchannels = ["R"]\n[[light]]\ntheta = [50, 70]\n[[view]]\ntheta = [0, 70]\n'
    )
    # Its nodes, 10° apart, are too few for the lobe: exit status 1, and no promise.
    assert main(["reduce", source, "--scene", scene, "-o", out]) == 1
    text = capsys.readouterr().out
    assert "2 of 3 channels" in text and "times less" in text and "against the whole table" in text
    assert "the tolerance of 5 % is not promised" in text
    small = open_table(out)
    assert small.channels.names == ("R",) and small.f.dtype == np.float32 and small.provenance["reduced"]
    assert main(["reduce", source, "--scene", scene, "-o", out]) == 2
    assert main(["reduce", source, "--scene", "nowhere", "-o", out, "--force"]) == 2
    assert "scene" in capsys.readouterr().err

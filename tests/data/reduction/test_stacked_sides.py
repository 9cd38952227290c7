"""Reduction of tables of both sides: each pair of sides keeps the tolerance, by values that it did not make itself."""

import dataclasses

import numpy as np
import pytest

import gonio
from gonio.data import layouts
from gonio.data.interpolation.multilinear import as_material
from gonio.data.scene import Range, Scene, load_scene
from gonio.data.table import Table
from gonio.instrument import scans
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.expression.builder import build
from gonio.models.folded import seen_from

SHEET = "thin_sheet(rho=[0.5, 0.3], tau=[0.02, 0.1]) + 0.1 * transmitted(base=ggx(alpha=0.5))"
SCENE = "matte_room"


OPAQUE = "lambert(rho=0.5) + 0.1 * transmitted(base=ggx(alpha=0.6))"
"""Dark where it is lit and seen from behind."""
SKY = Range((np.radians(91), np.pi), (0.0, 2 * np.pi), 1.0, fills=True)
ROOM = Range((0.0, 1.0), (0.0, 2 * np.pi), 0.3)
CURTAIN = Scene("curtain", 0.05, (SKY, ROOM), (Range((0.0, 1.2), (0.0, 2 * np.pi), 1.0),))


def measured(lit="both", step=20.0, sheet=SHEET):
    grid = scans.isotropic(np.radians(step), hemisphere="both", lit=lit)
    return gonio.measure(sheet, scan=grid, log=lambda text: None)


def errors(table, pairs):
    of_table, of_sheet = as_material(table), build(SHEET)
    for sides in table.sides:
        f, truth = (evaluate_in_blocks(seen_from(b, *sides), pairs.wi, pairs.wo) for b in (of_table, of_sheet))
        yield pairs.error(np.asarray(f), np.asarray(truth))


def test_each_pair_of_sides_keeps_the_tolerance_however_faint():
    whole = measured("front")
    del whole.provenance["material"]
    reduced = gonio.reduce(whole, SCENE, 0.05)
    assert reduced.keeps and reduced.table.layout.size < whole.layout.size / 10
    assert reduced.table.sides == whole.sides
    assert reduced.table.channels == whole.channels
    assert max(errors(reduced.table, load_scene(SCENE).pairs(20_000))) <= reduced.promised <= 0.05


@pytest.mark.thorough
def test_light_from_behind_and_in_front_keeps_the_tolerance_together_and_side_by_side():
    """By values that the reduction did not make: the sheet's own radiance under both."""
    scene = CURTAIN
    whole = measured()
    reduced = gonio.reduce(whole, scene)
    pairs = scene.pairs(20_000)
    f, truth = (evaluate_in_blocks(b, pairs.wi, pairs.wo) for b in (as_material(reduced.table), build(SHEET)))
    assert pairs.error(f, truth) <= reduced.promised <= 0.05 and reduced.table.sides == whole.sides
    assert reduced.table.layout.size < whole.layout.size / 10
    assert max(errors(reduced.table, pairs.mirrored())) <= 0.05
    with pytest.raises(GonioError, match="'curtain' looks at transmission, lit from behind, which front does not hold"):
        gonio.reduce(dataclasses.replace(measured("front"), name="front"), scene)


def test_a_table_that_names_no_material_is_promised_what_its_nodes_show_though_a_side_is_dark():
    whole = measured(sheet=OPAQUE, step=30.0)
    del whole.provenance["material"]
    reduced = gonio.reduce(whole, CURTAIN, 0.2)
    pairs = CURTAIN.pairs(20_000)
    f, truth = (evaluate_in_blocks(b, pairs.wi, pairs.wo) for b in (as_material(reduced.table), build(OPAQUE)))
    assert 0 < reduced.whole.error < 0.2 and pairs.error(f, truth) <= reduced.promised <= 0.2


def test_a_part_of_a_table_is_held_against_the_material_as_it_sees_it():
    whole = measured("front")
    for part in whole.parts().values():
        assert gonio.reduce(part, SCENE, 0.05).whole.error < 0.02


def test_grids_that_differ_behind_and_lists_are_refused_in_a_sentence():
    whole = measured()
    with pytest.raises(GonioError, match="without a grid of both hemispheres"):
        gonio.reduce(whole.as_list(), SCENE, 0.05)
    polar = np.radians([0, 20, 40, 60, 80])
    grid = layouts.isotropic(polar, np.append(polar, np.pi - polar[:0:-2]), np.radians(np.arange(0, 360, 30)))
    with pytest.raises(GonioError, match="other polar angles behind"):
        gonio.reduce(gonio.measure(SHEET, scan=grid, log=lambda text: None), SCENE, 0.05)
    assert isinstance(whole, Table)

"""What a fit promises in a scene holds against the surface, and is withheld where the readings do not show it."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.scene import Range, Scene
from gonio.fitting.fit_table import fit
from gonio.fitting.selection.scene_promise import promise
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.expression.builder import build
from support.fit_tables import table_of
from support.marks import thorough

ROUND = (0.0, 2 * np.pi)
LAMP = Scene("lamp", 0.05, (Range((0.5, 0.9), ROUND, 1.0),), (Range((0.0, 1.2), ROUND, 1.0),))
POLAR = np.radians(np.arange(0, 81, 8.0))
GRID = layouts.isotropic(POLAR, POLAR, np.radians(np.arange(0, 360, 20.0)))
TRUTH = "lambert(rho=.3) + .4*ggx(alpha=.3, f0=.2)"


def true_error(expression):
    pairs = LAMP.pairs(37_000)
    f, truth = (evaluate_in_blocks(build(e), pairs.wi, pairs.wo) for e in (expression, TRUTH))
    return pairs.error(f, truth)


WRONG = "lambert(rho=.3) + .4*ggx(alpha=.32, f0=.2)", "lambert(rho=.3) + .4*beckmann(alpha=.3, f0=.2)"


@pytest.mark.parametrize(
    ("expression", "noise"),
    [
        (TRUTH, 0.0),
        (WRONG[0], 0.0),
        (WRONG[1], 0.03),
        *thorough(
            (TRUTH, 0.03), (WRONG[0], 0.03), (WRONG[1], 0.0), ("lambert(rho=.31)", 0.0), ("lambert(rho=.31)", 0.03)
        ),
    ],
)
def test_the_bound_holds_for_right_and_wrong_models(expression, noise):
    table = table_of(TRUTH, GRID, noise=noise)
    promised = promise(table, build(expression), LAMP, determined=True)
    assert promised.bound is None or true_error(expression) <= promised.bound
    if noise == 0:
        assert promised.keeps == (expression == TRUTH or "alpha=.32" in expression)
    assert ("not promised" in promised.sentence()) == (not promised.keeps)


def test_numbers_left_open_count_as_the_table_itself():
    table = table_of(TRUTH, GRID)
    closed, opened = (promise(table, build(TRUTH), LAMP, determined=d) for d in (True, False))
    assert closed.bound < 1e-6 and (opened.bound is None or opened.bound > 0.05)


def test_a_named_truth_is_measured_against():
    table = table_of(TRUTH, GRID, provenance={"material": {"name": "paint", "spelling": TRUTH}})
    promised = promise(table, build("lambert(rho=.3) + .4*ggx(alpha=.32, f0=.2)"), LAMP, determined=True)
    true = true_error("lambert(rho=.3) + .4*ggx(alpha=.32, f0=.2)")
    assert true <= promised.bound <= 1.3 * true and "paint" in promised.reason


def test_light_through_a_sheet_is_judged_with_what_it_reflects():
    """The bound against the sheet itself in a window; what the table does not hold of it is named."""
    sheet = "thin_sheet(rho=0.3, tau=0.5)"
    sky = Range((np.radians(91), np.pi), ROUND, 1.0, fills=True)
    window = Scene("window", 0.05, (sky, *LAMP.lights), LAMP.views)
    polar = np.radians(np.arange(0, 81, 20.0))
    grid = layouts.isotropic(*[np.append(polar, np.pi - polar[::-1])] * 2, np.radians(np.arange(0, 360, 60.0)))
    table = table_of(sheet, grid)
    result = fit(table, "thin_sheet", scene=window, starts=1)
    assert result.scene["keeps"] and [p.value for p in result.parameters] == pytest.approx([0.3, 0.5], abs=1e-6)
    off = promise(table, build("thin_sheet(rho=0.3, tau=0.6)"), window, determined=True)
    pairs = window.pairs(30_000)
    f, truth = (evaluate_in_blocks(build(f"thin_sheet(rho=0.3, tau={t})"), pairs.wi, pairs.wo) for t in (0.6, 0.5))
    assert pairs.error(f, truth) <= off.bound <= 1.3 * pairs.error(f, truth) and not off.keeps
    with pytest.raises(GonioError, match=r"transmission, lit from behind, which .* does not hold"):
        fit(table_of("lambert(rho=0.3)", GRID), "lambert", scene=window)


def test_readings_in_a_plane_promise_nothing():
    flat = table_of(TRUTH, layouts.in_plane(POLAR, np.radians(np.arange(-80, 81, 8.0))))
    assert promise(flat, build(TRUTH), LAMP, determined=True).bound is None


def test_a_fit_tells_what_it_promises_by_its_status():
    table = table_of(TRUTH, GRID)
    good = fit(table, "lambert + ggx(f0=.2)", scene=LAMP, starts=1)
    poor = fit(table, "lambert", scene=LAMP, starts=1)
    assert (good.exit_status, poor.exit_status) == (0, 1)
    assert good.scene["keeps"] and not poor.scene["keeps"] and "not promised" in poor.notes[0]
    assert fit(table, "lambert", starts=1).scene is None

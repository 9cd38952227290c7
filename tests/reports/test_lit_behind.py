"""Lobes of light from behind: each number stands at its own place, named by the side of its light."""

import numpy as np
import pytest

import gonio
from gonio.data import layouts
from gonio.models.errors import GonioError
from gonio.reports import scatter_figures
from gonio.reports.document import assemble
from gonio.reports.evaluation import evaluate_subject
from gonio.reports.subject import subject_of
from support.fit_tables import table_of

THETA = np.radians(np.arange(0, 81, 20.0))
BEHIND = np.pi - THETA[::-1]
BOTH = np.concatenate([THETA, BEHIND])
PHI = np.radians(np.arange(0, 360, 45.0))
SHEET = "0.2*lambert_transmission(tau=0.5) + lambert(rho=0.3)"
"""π f is 0.1 of what goes through, 0.3 of what a front reflects, and 0 of what the back does."""


def figures_of(subject):
    document = assemble([subject_of(subject, 0)], "t", None, [])
    values = document.values["subjects"][0]
    return {f["id"].removeprefix("subject-1-"): f for f in values["figures"]}


def sides_of(figure):
    """π f of the lobe in space on the light's side and through the sample, where it is known, and on the horizon."""
    (source,) = figure["data"]["sources"]
    set_ = source["incidences"][1]
    theta, f = np.array(set_["theta_o_deg"]), np.pi * np.array(set_["f_per_sr"], float)
    return [g[np.isfinite(g)] for g in (f[theta < 90], f[theta > 90], f[theta == 90])]


def test_a_table_lit_from_both_sides_shows_both():
    figures = figures_of(table_of(SHEET, layouts.isotropic(BOTH, BOTH, PHI)))
    for slug, reflected, words in (("lobe", 0.3, "light from the front"), ("lobe-lit-behind", 0.0, "from behind")):
        same_side, through, horizon = sides_of(figures[slug])
        np.testing.assert_allclose(same_side, reflected, atol=1e-4)
        np.testing.assert_allclose(through, 0.1, rtol=1e-3)
        assert same_side.size and through.size and not horizon.size
        assert words in figures[slug]["caption"] and "goes through" in figures[slug]["caption"]
    for slug in ("plane-log", "map-scale"):
        assert "from the front" in figures[slug]["caption"]
        assert "from behind" in figures[f"{slug}-lit-behind"]["caption"]
    drawn = figures["plane-linear-lit-behind"]["data"]["readings"][0]
    angles, f = (np.array(drawn[k]) for k in ("theta_o_deg", "f_per_sr"))
    np.testing.assert_allclose(np.pi * f, np.where(np.abs(angles) < 90, 0.0, 0.1), rtol=1e-5)


def test_the_law_of_scatter_is_of_each_side_about_its_own_direction():
    sheet = subject_of("ggx(alpha=0.3) + transmitted(base=ggx(alpha=0.1))", 0)
    figures = {f.slug: f for f in scatter_figures.figures(sheet, evaluate_subject(sheet))}
    assert list(figures) == ["scatter", "scatter-through", "scatter-through-lit-behind"]  # the back reflects nothing
    reflected, through = (figures[slug].data["sets"][0] for slug in ("scatter", "scatter-through"))
    assert np.max(through["f_per_sr"]) > 3 * np.max(reflected["f_per_sr"])
    assert "transmission, lit from behind" in figures["scatter-through-lit-behind"].caption


def test_a_table_lit_from_behind_alone_has_lobes_of_that_light_alone():
    table = table_of(SHEET, layouts.isotropic(BEHIND, THETA, PHI))
    figures = figures_of(table)
    same_side, through, _ = sides_of(figures["lobe-lit-behind"])
    np.testing.assert_allclose(through, 0.1, rtol=1e-3)
    assert not same_side.size and "lobe" not in figures and "polar-log" not in figures
    angles = np.concatenate([dots.get_path().vertices[:, 0] for dots in table.plot("lobe", polar=False).patches])
    assert angles.size and (np.abs(angles) > 90).all()
    with pytest.raises(GonioError, match="no readings of light from the front; give lit='back'"):
        table.plot("lobe", lit="front")


def test_models_have_lobes_from_behind_where_these_differ():
    sheet = figures_of("thin_sheet(rho=0.3, tau=0.4)")
    assert "either side alike" in sheet["lobe"]["caption"] and not any("lit-behind" in slug for slug in sheet)
    np.testing.assert_allclose([np.ptp(side) for side in sides_of(sheet["lobe"])[:2]], 0, atol=1e-6)
    glass = figures_of("rough_dielectric(alpha=0.3, eta=1.5)")
    front, behind = (sides_of(glass[slug]) for slug in ("lobe", "lobe-lit-behind"))
    assert all(side.max() > 0 for side in (*front[:2], *behind[:2])) and front[0].max() != behind[0].max()
    # What it refracts leaves the straight direction, which the law of scatter is about.
    assert {"spheres-lit-behind", "scatter-lit-behind"} < set(glass) and "scatter-through" not in glass
    assert not any("light" in f["caption"].split(";")[0] for f in [figures_of("ggx(alpha=0.3)")["lobe"]])


def test_plots_take_the_side_of_the_light():
    material = gonio.material(SHEET)
    line = material.plot("lobe", lit="back", polar=False, log=False).lines
    x, y = max((np.asarray(part.get_data(), float) for part in line), key=lambda xy: xy.shape[1])
    known = np.isfinite(y)
    np.testing.assert_allclose(np.pi * y[known], np.where(np.abs(x[known]) < 90, 0.0, 0.1), atol=1e-9)
    sheet = gonio.material("thin_sheet(rho=0.3, tau=0.4)")
    front, back = (sheet.plot("slice", lit=lit) for lit in ("front", "back"))
    assert "lit from behind" in back.get_title() and "lit from behind" not in front.get_title()
    with pytest.raises(GonioError, match="sends no light on that comes from the back"):
        gonio.material("lambert(rho=0.5)").plot("slice", lit="back")
    with pytest.raises(GonioError, match="lit is 'top'; give 'front' or 'back'"):
        material.plot("lobe", lit="top")

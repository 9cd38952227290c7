"""The stability atlas: that it sees what is wrong, believes what is right, and can be done again cell by cell."""

import csv

import jax.numpy as jnp
import numpy as np
import pytest

from gonio.__main__ import main
from gonio.atlas import integrals, samplers
from gonio.atlas.cell import METHODS, RIGHT, SILENT
from gonio.atlas.fits import fit_cells, readings
from gonio.atlas.reference import DIGITS, Reference
from gonio.atlas.settings import settings_of
from gonio.atlas.values import gradient_cells, value_cells
from gonio.models.building import build
from gonio.models.catalog import MODELS
from gonio.models.ggx import GGX
from gonio.models.lambert import Lambert
from gonio.models.phong import Phong


def test_every_model_has_settings_and_a_second_opinion():
    from gonio.atlas.textbook import TEXTBOOK

    assert set(MODELS) <= set(TEXTBOOK)
    for name in MODELS:
        found = settings_of(name)
        assert found and len(set(found)) == len(found)
        for spelling in found[:2]:
            build(spelling)


def test_a_slope_at_forty_digits():
    import mpmath as mp

    reference = Reference("phong(n=3)", np.float64)
    wi, wo = (0.0, 0.6, 0.8), (0.0, 0.0, 1.0)
    with mp.workdps(DIGITS):
        n, c = mp.mpf(3), mp.mpf(0.8)
        exact = c**n / (2 * mp.pi) * (1 + (n + 2) * mp.log(c))
        assert float(reference.slope("n", wi, wo)) == pytest.approx(float(exact), rel=1e-12)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_honest_values_and_gradients_are_right(precision):
    for cells in (value_cells, gradient_cells):
        found = cells("phong", "phong(n=30)", precision, ("30°", "89.99°"))
        assert [c.verdict for c in found] == [RIGHT, RIGHT], [c.detail for c in found]


def test_a_wrong_digit_is_silent(monkeypatch):
    """f with a relative error of 1e-12 is caught; so is a slope without its last term."""

    class Off(Lambert):
        def f(self, wi, wo):
            return super().f(wi, wo) * (1 + 1e-12 * self.rho)

    monkeypatch.setitem(MODELS, "lambert", Off)
    assert {c.verdict for c in value_cells("lambert", "lambert(rho=0.5)", "float64", ("30°",))} == {SILENT}
    assert {c.verdict for c in gradient_cells("lambert", "lambert(rho=0.5)", "float64", ("30°",))} == {SILENT}


def test_a_density_that_is_not_the_samplers_is_seen():
    class Off(Phong):
        def pdf(self, wi, wo):
            return super().pdf(wi, wo) * (1 + 0.03 * jnp.sign(wo.x))

    honest, off = (samplers.count_and_expect(m(n=jnp.asarray(30.0)), 0.8, 200_000) for m in (Phong, Off))
    assert samplers.p_value(*honest[:2]) > 1e-4 and honest[1].sum() == pytest.approx(1, abs=1e-6)
    assert samplers.p_value(*off[:2]) < 1e-6


@pytest.mark.parametrize(
    "spelling", ["ggx(alpha=0.1)", "beckmann(alpha=0.3)", "ggx(alpha_x=0.05, alpha_y=0.4)", "eon(rho=1, r=1)"]
)
def test_samplers_draw_from_their_densities(spelling):
    """χ² at the 1 % level over all of them [Šidák 1967], and ∫ of the density, at four incidences."""
    cells = samplers.sampler_cells(spelling, spelling, "float64", 200_000)
    assert {c.verdict for c in cells} == {RIGHT}, [c.detail for c in cells]


def test_rings_know_the_closed_forms():
    mu = np.cos(1.2)
    value, known = integrals.reference_albedo(GGX(alpha=jnp.asarray(1.0)), 1.2)
    assert value == pytest.approx(1 - mu * np.log(1 + 1 / mu), abs=1e-10) and known < 5e-9
    value, known = integrals.reference_albedo(Phong(n=jnp.asarray(0.0)), 1.5)
    assert value == pytest.approx((1 + np.cos(1.5)) / 2, abs=1e-9) and known < 5e-9


def test_a_bound_that_does_not_hold_is_silent(monkeypatch):
    from gonio.models.quadrature import Estimate

    honest = integrals.directional_albedo
    monkeypatch.setattr(
        integrals, "directional_albedo", lambda *a: Estimate(honest(*a).value + 1e-5, honest(*a).bound, 0)
    )
    assert {c.verdict for c in integrals.integral_cells("lambert", "lambert(rho=0.5)")} == {SILENT}


def test_a_fit_of_a_model_to_itself():
    assert {c.verdict for c in fit_cells("lambert")} == {RIGHT}
    table = readings("lambert(rho=0.5)", 60, 0.01)
    assert table.layout.size == 60 and np.all(table.u_f > 0)


def test_the_command_line(tmp_path, capsys):
    folder = tmp_path / "atlas"
    assert main(["stress", "lambert", "-o", str(folder), "--quick", "--processes", "1"]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[-1] == "0 silent failures"
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert "0 silent failures" in page and page.count("<svg") == len(METHODS)
    rows = list(csv.DictReader((folder / "stress.csv").read_text(encoding="utf-8").splitlines()))
    assert {r["method"] for r in rows} == set(METHODS) and {r["verdict"] for r in rows} == {RIGHT}
    key = rows[0]["recipe"].split("'")[1]
    assert main(["stress", "lambert", "--quick", "--cell", key]) == 0
    assert capsys.readouterr().out.startswith("right: ")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["lambret"], "Unknown model 'lambret'; did you mean 'lambert'?"),
        (["lambert", "--cell", "nonsense"], "is no cell"),
        (["--cell", "value/x/y/z"], "name that model"),
        (["lambert", "--processes", "0"], "give 1 or more"),
    ],
)
def test_bad_words_are_refused(words, said, capsys):
    assert main(["stress", *words]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_a_finished_atlas_is_not_replaced(tmp_path, capsys):
    (tmp_path / "index.html").write_text("kept")
    assert main(["stress", "lambert", "-o", str(tmp_path)]) == 2
    assert "holds an atlas already" in capsys.readouterr().err
    assert (tmp_path / "index.html").read_text() == "kept"

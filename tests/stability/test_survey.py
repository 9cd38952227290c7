"""The stability atlas: that it sees what is wrong, believes what is right, and can be done again cell by cell."""

import csv
import signal
import subprocess
import sys

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

from gonio.__main__ import main
from gonio.models.catalog import MODELS
from gonio.models.diffuse.lambert import Lambert
from gonio.models.empirical.phong import Phong
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build
from gonio.models.microfacet import albedo_tables as albedo_table
from gonio.models.microfacet.ggx import GGX
from gonio.stability import albedos as integrals
from gonio.stability import rectangle_cubature as cells
from gonio.stability import run, samplers
from gonio.stability.cases import settings_of
from gonio.stability.fits import fit_cells, readings
from gonio.stability.outcome import METHODS, RIGHT, SAYS_SO, SILENT
from gonio.stability.reference import DIGITS, Reference
from gonio.stability.values_and_gradients import gradient_cells, value_cells


def test_every_model_has_settings_and_a_second_opinion():
    from gonio.stability.textbook import TEXTBOOK

    assert set(MODELS) <= set(TEXTBOOK)
    for name in MODELS:
        found = settings_of(name)
        assert found and len(set(found)) == len(found)
        for expression in found[:2]:
            build(expression)


def test_cells_are_halved_where_the_rules_disagree():
    """∫∫ 1/√(x² + y²) over a quarter disc's square, a point singularity, and a line's kink, to closed forms."""
    cell, bins = np.array([[0.0, 0.0, 1.0, 1.0]]), np.zeros(1, int)
    (point,), error = cells.integrate(lambda x, y: 1 / np.hypot(x, y), cell, bins, 1e-9)
    assert error < 1e-9 and point == pytest.approx(2 * np.log(1 + np.sqrt(2)), abs=1e-9)
    (kink,), error = cells.integrate(lambda x, y: abs(x - 0.3) + 0 * y, cell, bins, 1e-12)
    assert kink == pytest.approx(0.29, abs=1e-11)
    two, _ = cells.integrate(lambda x, y: x * y, np.array([[0, 0, 1, 1], [1, 0, 2, 1.0]]), np.array([1, 0]), 1e-12)
    assert two == pytest.approx([0.75, 0.25])


def test_infinite_slopes_inside_of_a_domain_are_seen():
    """(θ − θ0)^k has a cusp at θ = θ0 for k < 1."""
    wi, wo = (0.0, 0.0, 1.0), (0.6, 0.0, 0.8)
    words = "alpha=0.1, p=0.7, kappa=5, f0=0.04, f1=0, lam=3, c=0.1, theta_0=0"
    with mp.workdps(DIGITS):
        for k, infinite in ((0.5, True), (2, False)):
            reference = Reference(f"sgd({words}, k={k})", np.float64)
            assert reference.infinite("theta_0", reference.inputs(wi, wo)) == infinite


def test_a_slope_at_forty_digits():
    reference = Reference("phong(n=3)", np.float64)
    wi, wo = (0.0, 0.6, 0.8), (0.0, 0.0, 1.0)
    with mp.workdps(DIGITS):
        n, c = mp.mpf(3), mp.mpf(0.8)
        exact = c**n / (2 * mp.pi) * (1 + (n + 2) * mp.log(c))
        assert float(reference.slope("n", reference.inputs(wi, wo))) == pytest.approx(float(exact), rel=1e-12)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_honest_values_and_gradients_are_right(precision):
    for look in (value_cells, gradient_cells):
        found = look("phong", "phong(n=30)", precision, ("30°", "89.99°"))
        assert [c.verdict for c in found] == [RIGHT, RIGHT], [c.detail for c in found]


def test_a_wrong_digit_is_silent(monkeypatch):
    """f with a relative error of 1e-12 is caught; so is a slope without its last term."""

    class Off(Lambert):
        def formula(self, wi, wo):
            return super().formula(wi, wo) * (1 + 1e-12 * self.rho)

    monkeypatch.setitem(MODELS, "lambert", Off)
    assert {c.verdict for c in value_cells("lambert", "lambert(rho=0.5)", "float64", ("30°",))} == {SILENT}
    assert {c.verdict for c in gradient_cells("lambert", "lambert(rho=0.5)", "float64", ("30°",))} == {SILENT}


def test_a_density_that_is_not_the_samplers_is_seen():
    class Off(Phong):
        def pdf(self, wi, wo):
            return super().pdf(wi, wo) * (1 + 0.03 * jnp.sign(wo.x))

    honest, off = (samplers.count_and_expect(m(n=jnp.asarray(30.0)), 0.8, 200_000) for m in (Phong, Off))
    assert samplers.p_value(honest.counts, honest.shares) > 1e-4 and honest.shares.sum() == pytest.approx(1, abs=1e-6)
    assert samplers.p_value(off.counts, off.shares) < 1e-6


@pytest.mark.parametrize(
    "expression", ["ggx(alpha=0.1)", "beckmann(alpha=0.3)", "ggx(alpha_x=0.05, alpha_y=0.4)", "eon(rho=1, r=1)"]
)
def test_samplers_draw_from_their_densities(expression):
    """χ² at the 1 % level over all of them [Šidák 1967], and ∫ of the density, at four incidences."""
    found = samplers.sampler_cells(expression, expression, "float64", 200_000)
    assert {c.verdict for c in found} == {RIGHT}, [c.detail for c in found]


def test_rings_know_the_closed_forms():
    mu = np.cos(1.2)
    value, known = integrals.reference_albedo(GGX(alpha=jnp.asarray(1.0)), 1.2)
    assert value == pytest.approx(1 - mu * np.log(1 + 1 / mu), abs=1e-10) and known < 5e-9
    value, known = integrals.reference_albedo(Phong(n=jnp.asarray(0.0)), 1.5)
    assert value == pytest.approx((1 + np.cos(1.5)) / 2, abs=1e-9) and known < 5e-9


def test_tables_have_their_whole_slope_on_a_bound():
    """Slopes by width and index on their bounds, beside those a little inside."""

    def albedo(alpha, eta):
        return albedo_table.tabulated("coat", albedo_table.coat_series(alpha, eta), jnp.asarray(0.3), alpha)

    alpha = np.array([[1.0, 1.0 - 1e-6], [1e-4, 1e-4 + 1e-10], [0.1, 0.1], [0.1, 0.1]])
    eta = np.array([[1.5, 1.5], [1.5, 1.5], [1.01, 1.01 + 1e-8], [4.0, 4.0 - 1e-6]])
    by_alpha, by_eta = jax.jit(jax.vmap(jax.grad(albedo, (0, 1))))(alpha.ravel(), eta.ravel())
    slopes = np.concatenate([np.asarray(by_alpha).reshape(4, 2)[:2], np.asarray(by_eta).reshape(4, 2)[2:]])
    assert slopes[:, 0] == pytest.approx(slopes[:, 1], rel=1e-3) and np.all(slopes != 0)


def test_steep_facets_count_where_tails_are_short():
    """Beyond a slope of 1 GTR's density falls as GGX's, whatever γ: at 89° that is 4e-6 of the albedo."""
    found = integrals.integral_cells("gtr", "gtr(alpha=0.3, gamma=5)")
    assert {c.verdict for c in found} == {RIGHT}, [c.detail for c in found]


def test_a_bound_that_does_not_hold_is_silent(monkeypatch):
    from gonio.models.albedo import Estimate

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


@pytest.mark.parametrize("name", ["index.html", "stress.csv", "fit.svg"])
def test_a_finished_atlas_is_not_replaced(name, tmp_path, capsys):
    (tmp_path / name).write_text("kept")
    assert main(["stress", "lambert", "-o", str(tmp_path)]) == 2
    assert "holds an atlas already" in capsys.readouterr().err
    assert (tmp_path / name).read_text() == "kept"


def test_refusals_say_so_and_crashes_do_not(monkeypatch):
    def refused(self, wi, wo):
        raise GonioError("not here")

    def crashed(self, wi, wo):
        raise TypeError("no number")

    for f, verdict, said in ((refused, SAYS_SO, "refused: not here"), (crashed, SILENT, "crashed with TypeError")):
        monkeypatch.setitem(MODELS, "lambert", type("Failing", (Lambert,), {"f": f}))
        found = run.cells_of(("lambert", "value"), quick=True)
        assert {c.verdict for c in found} == {verdict} and all(said in c.detail for c in found)


ORPHAN = """
import multiprocessing, os, signal, time
from gonio.stability.run import start_worker

if __name__ == "__main__":
    pool = multiprocessing.get_context("spawn").Pool(1, start_worker)
    print(pool.apply(os.getpid), flush=True)
    pool.apply_async(time.sleep, (300,))
    time.sleep(0.2)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal there")
def test_a_killed_atlas_leaves_no_process(tmp_path):
    (tmp_path / "orphan.py").write_text(ORPHAN)
    # What is left of the pool holds the pipe: its output ends when the last process does, or not in time.
    done = subprocess.run([sys.executable, str(tmp_path / "orphan.py")], capture_output=True, timeout=100)
    assert done.returncode == -signal.SIGKILL and int(done.stdout) > 0

"""Values and gradients: right ones are believed, a wrong digit is not, and a model without a textbook form has laws."""

import pytest

from gonio.models.catalog import MODELS
from gonio.models.diffuse.lambert import Lambert
from gonio.models.errors import GonioError
from gonio.stability.laws import LAWS_ONLY
from gonio.stability.outcome import RIGHT, SAYS_SO, SILENT
from gonio.stability.run import cells_of
from gonio.stability.textbook import TEXTBOOK
from gonio.stability.values_and_gradients import gradient_cells, value_cells


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


def test_refusals_say_so_and_crashes_do_not(monkeypatch):
    def refused(self, wi, wo):
        raise GonioError("not here")

    def crashed(self, wi, wo):
        raise TypeError("no number")

    for f, verdict, said in ((refused, SAYS_SO, "refused: not here"), (crashed, SILENT, "crashed with TypeError")):
        monkeypatch.setitem(MODELS, "lambert", type("Failing", (Lambert,), {"formula": f}))
        found = cells_of(("lambert", "value"), quick=True)
        assert {c.verdict for c in found} == {verdict} and all(said in c.detail for c in found)


def test_a_model_without_a_textbook_form_is_judged_by_laws(monkeypatch):
    class OneSided(Lambert):
        def formula(self, wi, wo):
            return super().formula(wi, wo) * wi.z

    monkeypatch.delitem(TEXTBOOK, "lambert")
    for method in ("value", "gradient"):
        cells = cells_of(("lambert", method), quick=True)
        assert {c.verdict for c in cells} == {RIGHT} and all(LAWS_ONLY in c.detail for c in cells)
    monkeypatch.setitem(MODELS, "lambert", OneSided)
    assert SILENT in {c.verdict for c in cells_of(("lambert", "value"), quick=True)}

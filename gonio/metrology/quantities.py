"""`quantities`: what standards ask for of a material or a table, and where the uncertainty of it comes from."""

import dataclasses
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict, Unpack

from gonio.data.material import Material
from gonio.data.reflection_only import require_reflection
from gonio.data.serialise import finite
from gonio.data.subject import SubjectLike, load_material, resolve_subject
from gonio.data.table import Table
from gonio.fitting.fit_table import fit
from gonio.fitting.result import FitResult
from gonio.instrument.instrument import Instrument
from gonio.metrology.budget import Budget, joined
from gonio.metrology.effects import Readings
from gonio.metrology.fit_budget import fit_budget, fit_errors, outputs_of
from gonio.metrology.measurands import Quantity, TableMeasurands, to_row
from gonio.metrology.model_quantities import model_quantities
from gonio.metrology.monte_carlo import Simulation, require_draws, simulated
from gonio.metrology.polished_quantities import polished_quantities
from gonio.metrology.sources import sources_of
from gonio.metrology.table_budget import table_budget
from gonio.models.deprecation import settings_of
from gonio.models.display import Displayed
from gonio.models.errors import GonioError

MOST_SHOWN = 8
FitLike = FitResult | Material | str | os.PathLike[str]


class QuantitiesOptions(TypedDict, total=False):
    """Keywords of `gonio.quantities`; `help(gonio.quantities)` describes each."""

    budget: bool
    fit: FitLike | None
    instrument: Instrument | None
    uncertainty: Mapping[str, object]
    geometries: Sequence[str]
    monte_carlo: int
    seed: int
    name: str | None


@dataclasses.dataclass(frozen=True)
class QuantitiesSettings:
    """The options of `quantities`, complete; see `gonio.quantities`."""

    budget: bool = False
    fit: FitLike | None = None
    instrument: Instrument | None = None
    uncertainty: Mapping[str, object] = dataclasses.field(default_factory=dict)
    geometries: Sequence[str] = ()
    monte_carlo: int = 0
    seed: int = 0
    name: str | None = None

    def __post_init__(self) -> None:
        if not self.budget and (self.uncertainty or self.instrument is not None):
            raise GonioError("stated uncertainties belong to a budget; ask for the budget too")
        if self.monte_carlo:
            require_draws(self.monte_carlo)
            if not self.budget:
                raise GonioError("Monte Carlo checks a budget; ask for the budget too")


@dataclasses.dataclass(frozen=True, repr=False)
class Quantities(Displayed):
    """The quantities of a subject (`kind`: table or model), their budget if it was asked for, and remarks."""

    subject: str
    kind: str
    quantities: list[Quantity]
    budget: Budget | None = None
    notes: list[str] = dataclasses.field(default_factory=list)
    fitted: FitResult | None = dataclasses.field(default=None, repr=False)

    def facts(self) -> dict[str, str]:
        """The first quantities with their standard uncertainties."""
        rows = {}
        for k, q in enumerate(self.quantities[:MOST_SHOWN]):
            u, known = "", q.text(q.bound)
            if self.budget is not None:
                u, known = f" ± {self.budget.standard[k]:.2g}", q.text(float(self.budget.standard[k]))
            rows[" ".join(filter(None, (q.name, q.place, q.channel)))] = f"{known}{u}"
        more = len(self.quantities) - MOST_SHOWN
        return {self.kind: self.subject, **rows} | ({"…": f"{more} more"} if more > 0 else {})

    def to_dict(self) -> dict[str, Any]:
        """Everything as JSON can hold it: what is not finite is None, and "null" says why."""
        rows = [to_row(q) for q in self.quantities]
        if self.budget is not None:
            keys = ("standard_uncertainty", "effective_degrees_of_freedom", "expanded_uncertainty")
            columns = self.budget.standard, self.budget.dof, self.budget.expanded
            for row, *values in zip(rows, *columns, strict=True):
                row |= dict(zip(keys, map(float, values), strict=True))
        content = {"gonio_quantities": 1, "subject": self.subject, "kind": self.kind, "quantities": rows}
        return finite(content | {"budget": self.budget and self.budget.to_dict(), "notes": self.notes})

    def to_json(self) -> str:
        """`to_dict` as JSON text, with a newline at its end."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def quantities(subject: SubjectLike, **options: Unpack[QuantitiesOptions]) -> Quantities:
    """Albedos and reflectance factors of a material or a table, and where their uncertainty comes from.

    Args:
        subject: any subject (see `gonio.data.subject.SubjectLike`).
        budget: tables only: each source's contribution to every quantity, in the form of the GUM; what is neither
            stored nor stated is listed as not known.
        fit: tables only: the numbers and albedos of a fit too, and its slopes for what errors of the angles do. A fit
            result of this table, a model as `gonio.fit` takes it, "auto", or a fitted material or its file, whose model
            is fitted again.
        instrument: the real instrument with its stated uncertainties; they go before what the table stores.
        uncertainty: uncertainties of single terms, such as {"gain": "0.5 %", "tilt": "0.05 deg rectangular dof 12"};
            they go before the instrument's.
        geometries: more reflectance factors, as theta_i:theta_o:delta_phi in degrees ("30:30:180" is the mirror
            direction); of a table they have to be read there.
        monte_carlo: draws of all errors at once, from their distributions and by the whole formula of a reading, which
            show whether the linear budget holds; 0 for none, at least 100.
        seed: of these draws.
        name: what the result calls the subject.

    Returns:
        The quantities; `budget` has a column of numbers for them.

    Raises:
        GonioError: a subject that cannot be read, a budget of a model, a geometry that was not read, a term that is
            unknown.
    """
    settings = settings_of(QuantitiesSettings, "quantities", options)
    known = resolve_subject(subject)
    name = settings.name or known.name
    if known.table is None:
        if settings.budget or settings.fit is not None:
            raise GonioError(f"{name} is a model: budgets and fits are of readings; give the table itself")
        material = known.as_material()
        rows = model_quantities(material, settings.geometries) + polished_quantities(material)
        return Quantities(name, "model", rows, notes=list(material.brdf.validity_notes))
    table = known.table
    if table.interpolant is None and not table.valid_cells().size:
        raise GonioError(f"{name} holds no valid reading; there is nothing to integrate")
    require_reflection(table, name, "the list of quantities")
    measurands = TableMeasurands.of(table, settings.geometries)
    notes = [*table.provenance.get("warnings", []), *measurands.notes]
    fitted = None if settings.fit is None else _fitted(table, settings.fit)
    if not settings.budget:
        rows = [] if fitted is None else outputs_of(fitted)[0]
        return Quantities(name, "table", measurands.quantities + rows, None, notes, fitted)
    _require_readings(table)
    sources = sources_of(table, settings.instrument, settings.uncertainty)
    model = None if fitted is None else fitted.brdf
    readings = Readings.of(table, model)
    budget, rows, of_fit = table_budget(measurands, readings, sources), measurands.quantities, None
    if fitted is not None:
        of_fit = fit_errors(table, fitted, sources)
        budget, rows = joined(budget, fit_budget(of_fit, sources)), rows + of_fit.outputs[0]
    if settings.monte_carlo:
        draws = simulated(
            Simulation(measurands, readings, sources, of_fit), budget, settings.monte_carlo, settings.seed
        )
        budget = dataclasses.replace(budget, simulated=draws)
    return Quantities(name, "table", rows, budget, notes, fitted)


def _fitted(table: Table, given: FitLike) -> FitResult:
    """The fit itself; or the one of an expression, of "auto", or of a fitted material's file, made here."""
    if isinstance(given, FitResult):
        return given
    if isinstance(given, str) and not (Path(given).is_file() or given.endswith(".toml")):
        return fit(table, None if given == "auto" else given)
    material = load_material(given)
    stored = material.meta.get("fit")
    if not isinstance(stored, dict) or "asked" not in stored:
        raise GonioError(f"{material.name} is not a fitted material; give one that 'gonio fit' wrote, or a model")
    names = ("loss", "weight", "robust", "theta_max")
    options: Any = {name: stored[name] for name in names if stored.get(name) not in (None, "scene")}
    return fit(table, str(stored["asked"]), **options)


def _require_readings(table: Table) -> None:
    if table.interpolant is not None:
        raise GonioError(
            f"{table.name or 'this table'} is read by its format's own warp, which no reading's error goes through; "
            "measure it on a grid first: gonio measure FILE --scan isotropic -o T.h5"
        )

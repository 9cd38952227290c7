"""`quantities`: what standards ask for of a material or a table, and where the uncertainty of it comes from."""

import dataclasses
import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypedDict, Unpack

import numpy as np

from gonio.data.channels import Channels
from gonio.data.interpolation.multilinear import with_light_at_x
from gonio.data.material import Material
from gonio.data.plausibility.copies import repeated, with_noise_of_copies
from gonio.data.plausibility.correlated_uncertainty import (
    CorrelatedUncertainty,
    correlated_uncertainty,
    with_scatter,
)
from gonio.data.plausibility.understated_uncertainty import as_scattered, understated_uncertainty
from gonio.data.polarisation import are_radiances
from gonio.data.profile import Profile
from gonio.data.profile_files import profile_of
from gonio.data.serialise import finite
from gonio.data.subject import Subject, SubjectLike, load_material, resolve_subject
from gonio.data.table import Table
from gonio.fitting.fit_table import fit
from gonio.fitting.material_warnings import material_warnings
from gonio.fitting.result import FitResult
from gonio.fitting.subsurface.result import ProfileFit
from gonio.instrument.instrument import Instrument
from gonio.metrology.budget import Budget, joined
from gonio.metrology.effects import Readings
from gonio.metrology.fit_budget import fit_budget, fit_errors, outputs_of
from gonio.metrology.fit_numbers import FitNumbers
from gonio.metrology.measurands import ALBEDO, BHR, UNIFORM, WHITE_SKY, TableMeasurands
from gonio.metrology.model_quantities import model_quantities
from gonio.metrology.monte_carlo import Simulation, require_draws, simulated
from gonio.metrology.polished_quantities import polished_quantities
from gonio.metrology.profile_quantities import fit_of_profile, profile_quantities, quantities_of_fits
from gonio.metrology.quantity import Quantity, to_row
from gonio.metrology.remarks import (
    of_common,
    of_copies,
    of_numbers,
    of_polarisation,
    of_reach,
    of_scatter,
    of_symmetry,
    of_uncertainties,
)
from gonio.metrology.sources import sources_of
from gonio.metrology.standards import scatter_law
from gonio.metrology.standards.catalog import Wanted, standard_quantities
from gonio.metrology.standards.colour import ILLUMINANTS, LAB, Reference, Viewing
from gonio.metrology.standards.evaluation import Undecided
from gonio.metrology.standards.of_models import of_model
from gonio.metrology.standards.reflectance import PORT
from gonio.metrology.standards.shared import once
from gonio.metrology.subsurface_quantities import subsurface_quantities
from gonio.metrology.table_budget import table_budget
from gonio.models.brdf import AbstractBRDF
from gonio.models.deprecation import settings_of
from gonio.models.display import Displayed
from gonio.models.errors import GonioError
from gonio.models.geometry.sides import FRONT, Hemispheres

MOST_SHOWN = 8
FitLike = FitResult | ProfileFit | Material | str | os.PathLike[str]


class QuantitiesOptions(TypedDict, total=False):
    """Keywords of `gonio.quantities`; `help(gonio.quantities)` describes each."""

    budget: bool
    fit: FitLike | None
    instrument: Instrument | None
    uncertainty: Mapping[str, object]
    geometries: Sequence[str] | str
    only: Sequence[str] | str
    feature_width: float
    port: float
    illuminants: Sequence[str] | str
    observer: int
    linear_srgb: bool
    against: SubjectLike | None
    monte_carlo: int
    seed: int
    name: str | None


ALL = "all"
"""Stands for every group of quantities."""
LISTS = ("geometries", "only", "illuminants")
"""Options that are a list, or a text with commas."""


@dataclasses.dataclass(frozen=True)
class QuantitiesSettings:
    """The options of `quantities`, complete; see `gonio.quantities`."""

    budget: bool = False
    fit: FitLike | None = None
    instrument: Instrument | None = None
    uncertainty: Mapping[str, object] = dataclasses.field(default_factory=dict)
    geometries: Sequence[str] = ()
    only: Sequence[str] = ()
    feature_width: float = 0.0
    port: float = PORT
    illuminants: Sequence[str] = ILLUMINANTS
    observer: int = 10
    linear_srgb: bool = False
    against: SubjectLike | None = None
    monte_carlo: int = 0
    seed: int = 0
    name: str | None = None

    def __post_init__(self) -> None:
        if not self.budget and (self.uncertainty or self.instrument is not None):
            raise GonioError("stated uncertainties belong to a budget; ask for the budget too")
        if not 0 <= self.feature_width <= 90:
            raise GonioError(f"the feature width is {self.feature_width:g}; give degrees from 0 to 90")
        if self.monte_carlo:
            require_draws(self.monte_carlo)
            if not self.budget:
                raise GonioError("Monte Carlo checks a budget; ask for the budget too")

    def wanted(self) -> Wanted:
        """Which quantities of standards, and how; raises GonioError for groups, ports and viewing that are none."""
        viewing = Viewing(tuple(self.illuminants), self.observer, self.linear_srgb)
        wanted = Wanted(() if ALL in self.only else tuple(self.only), self.port, viewing)
        if self.against is None:
            return wanted
        colour = dataclasses.replace(wanted, groups=tuple(g for g in ("colour", "multi-angle") if g in wanted))
        rows = _quantities(resolve_subject(self.against), QuantitiesSettings(name="the other"), colour).quantities
        lab: dict[str, list[tuple[float, float]]] = {}
        for q in rows:
            if q.name in LAB:
                lab.setdefault(q.place, []).append((q.value, q.uncertainty))
        if not lab:
            raise GonioError("what differences are taken against has no colour: it needs a spectrum, 400 to 700 nm")
        against = {place: Reference(*np.array(v).T) for place, v in lab.items() if len(v) == len(LAB)}
        return dataclasses.replace(wanted, against=against)


@dataclasses.dataclass(frozen=True, repr=False)
class Quantities(Displayed):
    """The quantities of a subject (`kind`: table, profile or model), their budget if it was asked for, and remarks.

    `undecided`: what standards name and the data do not reach, with the reasons.
    """

    subject: str
    kind: str
    quantities: list[Quantity]
    budget: Budget | None = None
    notes: list[str] = dataclasses.field(default_factory=list)
    fitted: FitResult | None = dataclasses.field(default=None, repr=False)
    undecided: list[Undecided] = dataclasses.field(default_factory=list)

    def facts(self) -> dict[str, str]:
        """The first quantities with their standard uncertainties."""
        rows = {}
        for k, q in enumerate(self.quantities[:MOST_SHOWN]):
            size = q.uncertainty if self.budget is None else float(self.budget.standard[k])
            u, known = f" ± {size:.2g}" if size else "", q.text(size)
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
        content["undecided"] = [u._asdict() for u in self.undecided]
        return finite(content | {"budget": self.budget and self.budget.to_dict(), "notes": self.notes})

    def to_json(self) -> str:
        """`to_dict` as JSON text, with a newline at its end."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def quantities(subject: SubjectLike, **options: Unpack[QuantitiesOptions]) -> Quantities:
    """Albedos and reflectance factors of a material or a table, and where their uncertainty comes from.

    Args:
        subject: any subject (see `gonio.data.subject.SubjectLike`), or a profile of light below a surface.
        budget: tables only: each source's contribution to every quantity, in the form of the GUM; what is neither
            stored nor stated is listed as not known.
        fit: tables only: the numbers and albedos of a fit too, and its slopes for what errors of the angles do. A fit
            result of this table, a model as `gonio.fit` takes it, "auto", or a fitted material or its file, whose model
            is fitted again. Of a profile a fit's coefficients, lengths and edge loss.
        instrument: the real instrument with its stated uncertainties; they go before what the table stores.
        uncertainty: uncertainties of single terms, such as {"gain": "0.5 %", "tilt": "0.05 deg rectangular dof 12"};
            they go before the instrument's.
        geometries: more reflectance factors, as theta_i:theta_o:delta_phi in degrees ("30:30:180" is the mirror
            direction); of a list they have to be read there, of a grid they may lie between its nodes.
        only: groups of standards' quantities, see `gonio.metrology.standards.catalog.GROUPS`; all by default,
            or with "all".
        feature_width: degrees: nothing in f is narrower; else a lobe may hide where the mirror direction was not read.
        port: half-angle, degrees, about the mirror direction, of what "8°:de" leaves out.
        illuminants: of colours, "D65" and "A".
        observer: its field, 10 or 2 degrees.
        linear_srgb: R, G, B are linear sRGB, and have a colour by that.
        against: another subject, from whose colours CIEDE2000 is taken; its own uncertainty is not in that.
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
    given: dict[str, Any] = {k: _listed(v) if k in LISTS else v for k, v in options.items()}
    settings = settings_of(QuantitiesSettings, "quantities", given)
    if (profile := profile_of(subject)) is not None:
        settings.wanted()
        return _of_profile(profile, settings)
    return _quantities(resolve_subject(subject), settings, settings.wanted())


def _listed(value: object) -> object:
    """A text as the command line takes it, names with commas between them, as the list that it is."""
    return [name.strip() for name in value.split(",")] if isinstance(value, str) else value


def _radiances(table: Table) -> Table:
    """The table without channels that are no radiances, as elements of Mueller matrices."""
    radiances = are_radiances(table.channels.names)
    if radiances.all():
        return table
    return table.only([name for name, is_one in zip(table.channels.names, radiances, strict=True) if is_one])


class _Read(NamedTuple):
    """A table as it is integrated: without what is no radiance (`given`), with uncertainties as large as readings
    scatter (`table`), less what all of them share, and more for copies (`read`); and what was found of these."""

    given: Table
    table: Table
    read: Table
    excess: np.ndarray
    times: np.ndarray | None
    correlated: CorrelatedUncertainty


def _as_read(table: Table, ordered: bool) -> _Read:
    """`ordered`: its cells stay in their order, in place of that by the azimuth from the light."""
    given = _radiances(table)
    given = given if ordered else with_light_at_x(given)
    excess = understated_uncertainty(given)
    scattered, times = as_scattered(given, excess), repeated(given)
    correlated = correlated_uncertainty(scattered)
    read = with_noise_of_copies(with_scatter(scattered, correlated), times)
    return _Read(given, scattered, read, excess, times, correlated)


def _quantities(known: Subject, settings: QuantitiesSettings, wanted: Wanted) -> Quantities:
    name = settings.name or known.name
    if known.table is None:
        if settings.budget or settings.fit is not None:
            raise GonioError(f"{name} is a model: budgets and fits are of readings; give the table itself")
        return _of_model(known.as_material(), name, settings, wanted)
    if known.table.interpolant is None and not known.table.valid_cells().size:
        raise GonioError(f"{name} holds no valid reading; there is nothing to integrate")
    names = known.table.channels.names
    # A fit's readings stand in the order of the table's cells.
    ordered, whole = isinstance(settings.fit, FitResult), known.table
    given, table, read, excess, times, correlated = once(whole, ("read", ordered), lambda: _as_read(whole, ordered))
    entries, remarks = standard_quantities(table.channels, wanted, table.sides != FRONT)
    measurands = TableMeasurands.of(read, settings.geometries, entries, math.radians(settings.feature_width))
    notes = [*table.provenance.get("warnings", []), *measurands.notes, *remarks, *of_polarisation(names)]
    undecided = _without_albedo(measurands, wanted) + measurands.standards.undecided
    notes += of_common(correlated) if settings.budget or correlated.relative else of_uncertainties(table)
    notes += of_scatter(excess) + of_copies(times) + once(table, "symmetry", lambda: of_symmetry(table))
    notes += of_reach(undecided) if settings.fit is None else []
    fitted = None if settings.fit is None else _fitted(given, settings.fit)
    if not settings.budget:
        laws = _laws(table, table.channels, wanted)
        rows, undecided = [] if fitted is None else outputs_of(fitted)[0], undecided + laws[1]
        known_to = _with_common(measurands, correlated.relative)
        return Quantities(name, "table", known_to + rows + laws[0], None, notes, fitted, undecided)
    _require_readings(table)
    of_readings = sources_of(table, settings.instrument, settings.uncertainty)
    sources = of_readings if times is None else of_readings.of_copies(times)
    model = None if fitted is None else fitted.brdf
    readings = Readings.of(table, model)
    budget, rows, of_fit = table_budget(measurands, readings, sources), measurands.quantities, None
    if fitted is not None:
        of_fit = fit_errors(table, fitted, of_readings)
        budget, rows = joined(budget, fit_budget(of_fit, sources)), rows + of_fit.outputs[0]
    if settings.monte_carlo:
        draws = simulated(
            Simulation(measurands, readings, sources, of_fit), budget, settings.monte_carlo, settings.seed
        )
        budget = dataclasses.replace(budget, simulated=draws)
    return Quantities(name, "table", rows, budget, notes, fitted, undecided)


def _with_common(measurands: TableMeasurands, share: float) -> list[Quantity]:
    """The quantities with what all readings may be off together, a share of them, in their uncertainties."""
    moved = measurands.scaled(measurands.table, share)
    return [
        dataclasses.replace(q, u=math.hypot(q.u, float(v))) for q, v in zip(measurands.quantities, moved, strict=True)
    ]


def _of_profile(profile: Profile, settings: QuantitiesSettings) -> Quantities:
    """Those of a profile by its readings, and by a fit of it."""
    given = {"budget": settings.budget, "geometries": settings.geometries, "against": settings.against}
    if wrong := [name for name, value in given.items() if value]:
        raise GonioError(f"a profile of light below a surface has no {wrong[0]}; leave it out")
    rows, undecided = profile_quantities(profile)
    fits = [] if settings.fit is None else [fit_of_profile(profile, settings.fit)]
    notes = [*profile.provenance.get("warnings", [])]
    if not fits:
        notes.append(
            "σa, σs′ and the edge loss are of a fit: give --fit auto, a model such as 'dipole(eta=1.5)', or FIT.toml."
        )
    for material in fits:
        notes += _numbers_of_fit(material)[1]
    name = settings.name or profile.name or "profile"
    return Quantities(name, "profile", rows + quantities_of_fits(profile, fits), None, notes, None, undecided)


def _without_albedo(measurands: TableMeasurands, wanted: Wanted) -> list[Undecided]:
    """Shares of all light that the readings in front do not reach."""
    known = measurands.albedos.get((1, 1), "nothing was read in front of the sample with light in front")
    if not isinstance(known, str):
        if any(q.name == BHR for q in measurands.quantities):
            return []
        known = "too little of the hemisphere was read"
    named = ((ALBEDO, "", "albedo"), (UNIFORM, "", "albedo"), (BHR, WHITE_SKY, "remote sensing"))
    return [Undecided(name, place, group, known) for name, place, group in named if group in wanted]


def _of_model(material: Material, name: str, settings: QuantitiesSettings, wanted: Wanted) -> Quantities:
    transmits = Hemispheres.TRANSMISSION in material.brdf.hemispheres
    entries, notes = standard_quantities(material.channels, wanted, transmits)
    numbers, remarks = _numbers_of_fit(material)
    named, undecided = of_model(material, entries, numbers)
    laws = _laws(material.brdf, material.channels, wanted)
    rows = model_quantities(material, settings.geometries, numbers) + polished_quantities(material) + named + laws[0]
    rows += subsurface_quantities(material, numbers)
    notes = material_warnings(material) + notes + remarks + of_numbers(numbers)
    return Quantities(name, "model", rows, notes=notes, undecided=undecided + laws[1])


def _numbers_of_fit(material: Material) -> tuple[FitNumbers | None, list[str]]:
    """The numbers whose covariance spreads the quantities of a fit, and what it leaves out."""
    try:
        numbers = FitNumbers.of(material)
    except GonioError as error:
        return None, [f"The covariance of the fit is not in the uncertainties: {error}."]
    open_ended = numbers.undetermined if numbers is not None else []
    listed = ", ".join(open_ended[:3]) + (" …" if len(open_ended) > 3 else "")
    return numbers, [f"The fit leaves {listed} open: what depends on that is not known."] if open_ended else []


def _laws(subject: Table | AbstractBRDF, channels: Channels, wanted: Wanted) -> tuple[list[Quantity], list[Undecided]]:
    """Laws of scatter of a model, or of readings at directions that a table lists."""
    if scatter_law.GROUP not in wanted:
        return [], []
    if not isinstance(subject, Table):
        return scatter_law.scatter_laws(scatter_law.of_model(subject), channels)
    if subject.layout.in_half_vectors or subject.interpolant is not None:
        return [], [
            Undecided("ABg, Harvey–Shack", "", scatter_law.GROUP, "no directions of its cells are in one plane")
        ]
    return scatter_law.scatter_laws(scatter_law.of_table(subject), channels)


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
            f"{table.name or 'this table'} is read by its format's own rule, which no reading's error goes through; "
            "measure it on a grid first: gonio measure FILE --scan isotropic -o T.h5"
        )

"""The few readings that would decide on the energy of a table: at mirror directions left out, or between nodes."""

import dataclasses
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gonio.checks.albedos import Albedos
from gonio.checks.certificate import UNDECIDED, Property
from gonio.checks.deciding_directions import Ways, deciding_directions
from gonio.checks.properties import PROPERTIES
from gonio.checks.table.albedos.two_sided import summed
from gonio.checks.table.energy import deciding_by_side, table_energy
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.further_readings import joined, require_alike
from gonio.data import layouts
from gonio.data.layouts import Layout
from gonio.data.serialise import finite
from gonio.data.subject import SubjectLike, resolve_subject
from gonio.data.table import Table
from gonio.instrument.instrument import Instrument
from gonio.instrument.pace import AXES
from gonio.models.brdf import AbstractBRDF
from gonio.models.display import Displayed
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.folded import seen_from
from gonio.models.geometry.directions import from_spherical
from gonio.models.geometry.sides import FRONT
from gonio.planning.shots import Shots, ordered, write_shots

if TYPE_CHECKING:
    from gonio.fitting.result import FitResult


@dataclasses.dataclass(frozen=True, repr=False)
class EnergyPlan(Displayed):
    """The readings that would decide on the energy of a table.

    Attributes:
        name: of the table.
        shots: directions (4, n), radians, in their order, and counting seconds (n,).
        hours: of the whole, travel included.
        undecided_theta_i: incidences, degrees, that leave energy open.
        model: what was fitted to the table; it says what will be read.
        before, after: energy as it is, and as it will be if the surface is what the model says.
    """

    name: str
    shots: Shots
    hours: float
    undecided_theta_i: list[float]
    model: str
    before: Property
    after: Property

    @property
    def layout(self) -> Layout:
        """The directions as `gonio.measure` takes them; `shots.seconds` are its `seconds`."""
        return layouts.scattered(*self.shots.angles)

    def facts(self) -> dict[str, str]:
        """Readings, hours, and the verdict before and after."""
        return {
            "of": self.name,
            "readings": f"{self.shots.seconds.size} in {self.hours:.3g} h",
            "energy now": f"{self.before.verdict}, ± {self.before.bound:.2g}",
            "energy then": f"{self.after.verdict}, ± {self.after.bound:.2g}, if the surface is {self.model}",
        }

    def to_dict(self) -> dict[str, Any]:
        """Everything, for JSON: angles in degrees."""
        columns = {n: np.degrees(a).round(3).tolist() for n, a in zip(AXES, self.shots.angles, strict=True)}
        judged = {k: dataclasses.asdict(getattr(self, k)) for k in ("before", "after")}
        others = {k: getattr(self, k) for k in ("name", "hours", "undecided_theta_i", "model")}
        return finite({**others, **judged, "shots": columns | {"seconds": self.shots.seconds.tolist()}})

    def save(self, path: str | os.PathLike[str], force: bool = False) -> Path:
        """Writes the path as CSV, which `gonio measure --scan` takes. GonioError where it exists or cannot be."""
        return write_shots(path, self.shots, f"gonio plan of {self.name} for energy", self.hours, force)


def plan_energy(
    subject: SubjectLike,
    instrument: Instrument | None = None,
    *,
    model: str = "auto",
    tolerance: float | None = None,
    feature_width: float = 0.0,
    further: Table | None = None,
    fitted: "FitResult | None" = None,
) -> EnergyPlan:
    """The readings that would decide on the energy of a table which leaves it open.

    The mirror directions of incidences that left them out; of lobes that the table does not resolve, readings at
    several levels below the peak. `gonio.check(table, further=...)` takes what was read there.

    Args:
        subject: a table, or what gives one.
        instrument: its speed, ranges and shadow.
        model: as of `gonio.check`: what carries the verdict, and says what will be read.
        tolerance: of energy, as of `gonio.check`.
        feature_width: radians, as of `gonio.check`.
        further: what was read of a plan before, where that left energy open; the plan is of readings beside those.
        fitted: the fit of the model to the table and the further readings, where it was made before.

    Raises:
        GonioError: a table whose energy is decided, or that no reading decides; directions that cannot be read.
    """
    table = resolve_subject(subject).require_table()
    limit = PROPERTIES["energy"].table_tolerance if tolerance is None else tolerance
    assert limit is not None
    if further is not None:
        require_alike(table, further)
        table, further = (table, further) if table.layout.gridded else (joined(table, further), None)
    evidence = TableEvidence(table, feature_width=feature_width, model=model, further=further, made=fitted)
    before = table_energy(evidence, limit)
    name = table.name or "the table"
    if before.verdict != UNDECIDED:
        raise GonioError(f"the energy of {name} is decided ({before.verdict}): no reading is needed")
    evidence = dataclasses.replace(evidence, made=evidence.refitted)
    by_side = deciding_by_side(evidence)
    albedos = summed(by_side)
    if isinstance(albedos, str):
        raise GonioError(f"no few readings decide on the energy of {name}: {albedos}")
    instrument = instrument or Instrument()
    open_ = np.flatnonzero(~np.all(albedos.value + albedos.above <= 1 + limit, axis=1) & ~albedos.partial)
    fitted = evidence.fitted
    assert fitted is not None
    angles = _deciding(table, fitted.brdf, by_side, (albedos.theta_i[open_], instrument))
    if not angles.size:
        raise GonioError(f"no few readings decide on the energy of {name}: {before.detail}")
    shots = ordered(Shots(angles, np.full(angles.shape[1], instrument.seconds)), instrument.pace)
    read = _as_the_model_says(table, fitted.brdf, shots.angles)
    if table.layout.gridded:
        evidence = dataclasses.replace(evidence, further=read if further is None else joined(further, read))
    else:
        evidence = dataclasses.replace(evidence, table=joined(table, read))
    after = table_energy(dataclasses.replace(evidence, made=fitted), limit)
    hours = instrument.pace.path_seconds(shots.angles, shots.seconds) / 3600
    theta = np.unique(np.round(np.degrees(albedos.theta_i[open_]), 3)).tolist()
    return EnergyPlan(name, shots, hours, theta, fitted.expression, before, after)


def _deciding(
    table: Table,
    brdf: AbstractBRDF,
    by_side: dict[tuple[int, int], Albedos | str],
    terms: tuple[np.ndarray, Instrument],
) -> np.ndarray:
    """Directions (4, n) that decide at incidences, of all sides that are integrated; `terms`: those, the instrument."""
    theta, instrument = terms
    each = [
        deciding_directions(
            Ways(table, *sides), brdf if table.sides == FRONT else seen_from(brdf, *sides), albedos, theta, instrument
        )
        for sides, albedos in by_side.items()
        if not isinstance(albedos, str)
    ]
    return np.concatenate(each, axis=1)


def _as_the_model_says(table: Table, brdf: Any, angles: np.ndarray) -> Table:
    """Readings in some directions as a model says, as uncertain as those of the table are."""
    wi, wo = from_spherical(angles[0], angles[1], np), from_spherical(angles[2], angles[3], np)
    f = np.asarray(evaluate(brdf, wi, wo)).reshape(angles.shape[1], -1)
    f = np.broadcast_to(f, (angles.shape[1], len(table.channels)))
    relative = 0.0
    if table.u_f is not None:
        values = table.read_values(0, table.layout.size)
        known = (values["f"] > 0) & np.isfinite(values["u_f"]) & (values["flag"] == 0)
        relative = float(np.median(values["u_f"][known] / values["f"][known])) if known.any() else 0.0
    u = relative * f if relative else None
    theta_i, phi_i, theta_o, phi_o = angles
    return Table.from_arrays(theta_i, phi_i, theta_o, phi_o, f, u, channels=table.channels.names)

"""What a fit returns: the model, every number with its uncertainty and status, and how far to believe it."""

import dataclasses
import functools
from typing import Any

import numpy as np

from gonio.data.table import Channels
from gonio.fitting.residuals.colour_difference import sphere_difference
from gonio.fitting.residuals.summary import Evidence, ResidualSummary, summarise
from gonio.models.brdf import AbstractBRDF

CORRELATED = 0.95  # from which on a correlation is said in words
MOST_CORRELATED = 5


@dataclasses.dataclass(frozen=True)
class ParameterEstimate:
    """One fitted number. `status`: determined, undetermined, at lower bound, at upper bound, or fixed."""

    name: str
    channel: str | None
    value: float
    standard_uncertainty: float
    interval95: tuple[float, float]
    status: str
    unit: str
    low: float
    high: float

    @property
    def label(self) -> str:
        """Name with its channel, such as ``lambert.rho[R]``."""
        return self.name if self.channel is None else f"{self.name}[{self.channel}]"


@dataclasses.dataclass(frozen=True)
class FitResult:
    """A fitted model. `converged` means stationary by the projected gradient, or exact; `reason` says why.

    `covariance` and `correlation` are over `free_names`; `cost` is ½Σr² of the named loss; `bic` compares models on the
    same readings and loss; `seconds` are wall time by stage. `counts`: readings by what became of them. `floor`: of the
    loss, one for each channel fitted by itself. `robust`: how outliers were weighed. `bootstrap`: what refits to drawn
    readings gave.
    """

    expression: str
    asked: str
    brdf: AbstractBRDF
    channels: Channels
    parameters: list[ParameterEstimate]
    free_names: list[str]
    covariance: np.ndarray
    correlation: np.ndarray
    converged: bool
    reason: str
    stationarity: float
    exact: bool
    loss: str
    weight: str | None
    cost: float
    metrics: dict[str, float]
    samples: int
    cells: int
    negative_readings: int
    starts: int
    starts_agreed: int
    bic: float
    undetermined: list[str]
    active_bounds: list[str]
    seconds: dict[str, float]
    theta_max: float | None
    notes: list[str] = dataclasses.field(default_factory=list)
    alternatives: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    table: str = ""
    counts: dict[str, int] = dataclasses.field(default_factory=dict)
    floor: list[float] = dataclasses.field(default_factory=list)
    robust: str | None = None
    bootstrap: dict[str, Any] | None = None
    evidence: Evidence | None = dataclasses.field(default=None, repr=False, compare=False)

    @functools.cached_property
    def residuals(self) -> ResidualSummary | None:
        """Noise or structure, maps over angles, and readings that stand out; worked out when first asked for."""
        return None if self.evidence is None else summarise(self.evidence)

    @functools.cached_property
    def colour_difference(self) -> dict[str, Any] | None:
        """CIEDE2000 between lit spheres of model and readings; None for channels without colour."""
        if self.evidence is None:
            return None
        e = self.evidence
        return sphere_difference(self.channels, e.readings, e.model_f, e.layout, e.seed)

    @property
    def correlated(self) -> list[dict[str, Any]]:
        """Pairs of determined numbers whose correlation is at least 0.95 in size, the strongest first."""
        known = {p.label for p in self.parameters if p.status == "determined"}
        both = np.array([n in known for n in self.free_names], bool)
        size = np.nan_to_num(np.triu(np.abs(self.correlation), 1)) * np.outer(both, both)
        order = np.argsort(-size, axis=None)[:MOST_CORRELATED]
        pairs = [np.unravel_index(k, size.shape) for k in order]
        return [
            {"a": self.free_names[i], "b": self.free_names[j], "correlation": float(self.correlation[i, j])}
            for i, j in pairs
            if size[i, j] >= CORRELATED
        ]

    @property
    def exit_status(self) -> int:
        """0 where converged, else 1."""
        return 0 if self.converged else 1

    def to_dict(self) -> dict[str, Any]:
        """Everything but the model itself, as what JSON and TOML can hold."""
        left = ("brdf", "channels", "evidence")
        kept = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name not in left}
        kept["correlated"] = self.correlated
        kept["colour_difference"] = self.colour_difference
        kept["residuals"] = None if self.residuals is None else self.residuals.to_dict()
        kept["parameters"] = [dataclasses.asdict(p) for p in self.parameters]
        kept["channels"] = list(self.channels.names)
        kept["spelling"] = kept.pop("expression")  # as files have it
        return unboxed(kept)

    def to_material_dict(self, name: str, description: str = "") -> dict[str, Any]:
        """The fitted model as a material file's content, which `gonio measure` can scan again."""
        held: dict[str, Any] = {"gonio_material": 1, "name": name, "description": description or f"fit to {self.table}"}
        held["model"] = self.expression
        if self.channels.wavelengths_nm is not None:
            held["wavelengths_nm"] = list(self.channels.wavelengths_nm)
        elif len(self.channels) > 1:
            held["channels"] = list(self.channels.names)
        held["source"] = {"text": f"gonio fit of '{self.asked}' to {self.table or 'a table'}"}
        fit = self.to_dict()
        fit.pop("spelling")
        held["fit"] = without_none(fit)
        return held


def unboxed(value: Any) -> Any:
    """NumPy out of nested containers: lists, dicts, numbers (NaN too, which TOML knows) and strings only."""
    if isinstance(value, dict):
        return {str(k): unboxed(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [unboxed(v) for v in value]
    if isinstance(value, np.ndarray):
        return unboxed(value.tolist())
    return value.item() if isinstance(value, np.generic) else value


def without_none(value: Any) -> Any:
    """Nested containers less their empty entries, which TOML cannot hold."""
    if isinstance(value, dict):
        return {k: without_none(v) for k, v in value.items() if v is not None}
    return [without_none(v) for v in value] if isinstance(value, list) else value

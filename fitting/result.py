"""The result of a fit: the model, every number with its uncertainty and status, and how well they are known."""

import dataclasses
import functools
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gonio.data.files import new_file
from gonio.data.material import Material
from gonio.data.serialise import toml_values, unboxed
from gonio.data.table import Channels
from gonio.fitting.residuals.colour_difference import sphere_difference
from gonio.fitting.residuals.summary import Evidence, ResidualSummary, summarise
from gonio.models.brdf import AbstractBRDF
from gonio.models.deprecation import renamed_attribute
from gonio.models.display import Displayed
from gonio.models.expression.builder import build, frame
from gonio.models.expression.labels import number_label
from gonio.models.expression.parser import Value, parse
from gonio.models.expression.paths import changed

CORRELATED = 0.95  # from which on a correlation is reported
MOST_CORRELATED = 5
MOST_SHOWN = 7  # numbers in a repr


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


class DerivedNumber(NamedTuple):
    """A quantity of a fitted model with both of its errors, arrays of one shape.

    `numerical_error`: bound on the error of computing it; `standard_uncertainty`: from the covariance of the fit.
    """

    value: np.ndarray
    numerical_error: np.ndarray
    standard_uncertainty: np.ndarray


@dataclasses.dataclass(frozen=True, repr=False)
class FitResult(Displayed):
    """A fitted model with everything that is known of it; a subject of every verb, as its `material` is.

    Attributes:
        expression: the fitted model, all numbers given; `requested`: the expression that was fitted.
        brdf, channels: the model, and the channels of its values.
        parameters: every number with uncertainty, 95 % interval and status.
        free_names: labels of the free numbers; `covariance` and `correlation` are over them.
        converged: stationary by the projected gradient, or exact; `reason` says why.
        stationarity: largest projected gradient; `exact`: the residual is rounding.
        loss, weight, robust, theta_max: as resolved; `floor`: of the loss, one for each channel fitted by itself.
        cost: ½Σr² of the loss; `bic`: compares models on the same readings and loss; `metrics`: differences by name.
        samples, cells, negative_readings: what was fitted; `counts`: readings by what became of them.
        starts, starts_agreed: descents, and how many ended at the best cost.
        undetermined, active_bounds, notes: sentences and labels.
        alternatives: the other models, as plain data; `bootstrap`: what the refits gave.
        seconds: wall time by stage; `table`: name of the table.
    """

    expression: str
    requested: str
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

    asked = renamed_attribute("asked", "requested")
    spelling = renamed_attribute("spelling", "expression")

    def facts(self) -> dict[str, str]:
        """Verdict, model, the first free numbers with their standard uncertainties, and how well they fit."""
        free = [p for p in self.parameters if p.status != "fixed"]
        numbers = {p.label: f"{p.value:.6g} ± {p.standard_uncertainty:.2g}, {p.status}" for p in free[:MOST_SHOWN]}
        verdict = "converged" if self.converged else "NOT converged"
        more = {"…": f"{len(free) - MOST_SHOWN} more"} if len(free) > MOST_SHOWN else {}
        metrics = (
            f"relative rms {self.metrics['relative_rms']:.3g}, {self.samples:,} readings of {self.table or 'a table'}"
        )
        return {"verdict": f"{verdict}: {self.reason}", "model": self.requested, **numbers, **more, "fit": metrics}

    @functools.cached_property
    def residuals(self) -> ResidualSummary | None:
        """Noise or structure, maps over angles, and readings that stand out; computed on first use."""
        return None if self.evidence is None else summarise(self.evidence)

    @functools.cached_property
    def colour_difference(self) -> dict[str, Any] | None:
        """CIEDE2000 between lit spheres of model and readings; None for channels without colour."""
        e = self.evidence
        return e and sphere_difference(self.channels, e.readings, e.model_f, e.layout, e.seed)

    @functools.cached_property
    def material(self) -> Material:
        """The fitted model as a material, which can be measured, checked, evaluated and reported."""
        content = self.to_material_dict(f"fit of {self.table}" if self.table else "fit")
        return Material(
            content["name"], self.brdf, self.expression, self.channels, content["description"],
            content["source"]["text"], {"fit": content["fit"]},
        )  # fmt: skip

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

    def albedo(self, theta_i: ArrayLike, phi_i: ArrayLike = 0.0, degrees: bool = False) -> DerivedNumber:
        """Share of the light from (theta_i, phi_i) that the fitted model reflects; see `Material.albedo`."""
        estimate = self.material.albedo(theta_i, phi_i, degrees)
        spread = self.propagated(lambda material: material.albedo(theta_i, phi_i, degrees).value)
        return DerivedNumber(estimate.value, estimate.bound, spread)

    def propagated(self, quantity: Callable[[Material], np.ndarray]) -> np.ndarray:
        """Standard uncertainty of a quantity of the material from the covariance of the fit.

        By central differences over one standard uncertainty on either side, within the domain [JCGM 100:2008, eq. 13].
        Numbers on an active bound add nothing; NaN where the readings leave a number without a covariance.
        """
        free = [p for p in self.parameters if p.label in self.free_names]
        moving = [k for k, p in enumerate(free) if not p.status.startswith("at ")]
        slopes = []
        for p in (free[k] for k in moving):
            u = p.standard_uncertainty
            low, high = (min(max(p.value + step, p.low), p.high) for step in (-u, u))
            ends = [quantity(self._with_number(p, value)) for value in (low, high)] if low < high else [np.nan, np.nan]
            slopes.append((ends[1] - ends[0]) / (high - low if low < high else np.nan))
        if not slopes:
            return np.zeros_like(quantity(self.material))
        j = np.stack(np.broadcast_arrays(*slopes))
        covariance = self.covariance[np.ix_(moving, moving)]
        return np.sqrt(np.maximum(np.einsum("i...,ij,j...->...", j, covariance, j), 0.0))

    def _with_number(self, p: ParameterEstimate, value: float) -> Material:
        """The material with one of its numbers changed."""
        terms = parse(self.expression)
        frames = tuple(frame(t) for t in terms)
        channel = None if p.channel is None else self.channels.names.index(p.channel)

        def change(index: int, path: str, v: Value) -> Value:
            if number_label(frames, index, path) != p.name:
                return v
            if channel is None or not isinstance(v.number, tuple):
                return Value(value)
            return Value((*v.number[:channel], value, *v.number[channel + 1 :]))

        terms = tuple(changed(t, functools.partial(change, index)) for index, t in enumerate(terms))
        return dataclasses.replace(self.material, brdf=build(terms))

    @property
    def exit_status(self) -> int:
        """0 where converged, else 1."""
        return 0 if self.converged else 1

    def save(self, path: str | os.PathLike[str], force: bool = False) -> Path:
        """Write the fitted material as TOML, as `gonio fit -o` does.

        Args:
            path: the file, such as ``plastic.fit.toml``; the material is named after it.
            force: replace an existing file.

        Returns:
            The path.

        Raises:
            GonioError: the file exists, or cannot be written.
        """
        import tomli_w

        name = Path(path).name.removesuffix(".toml").removesuffix(".fit")
        with new_file(path, force) as part:
            part.write_text(tomli_w.dumps(self.to_material_dict(name)), encoding="utf-8")
        return Path(path)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the model itself, as what JSON and TOML can hold."""
        models = ("brdf", "channels", "evidence")
        content = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name not in models}
        content["correlated"] = self.correlated
        content["colour_difference"] = self.colour_difference
        content["residuals"] = None if self.residuals is None else self.residuals.to_dict()
        content["parameters"] = [dataclasses.asdict(p) for p in self.parameters]
        content["channels"] = list(self.channels.names)
        for name, in_files in (("expression", "spelling"), ("requested", "asked")):
            content[in_files] = content.pop(name)
        return unboxed(content)

    def to_material_dict(self, name: str, description: str = "") -> dict[str, Any]:
        """The fitted model as the content of a material file, which `gonio measure` can scan."""
        content: dict[str, Any] = {
            "gonio_material": 1, "name": name, "description": description or f"fit to {self.table}",
            "model": self.expression,
        }  # fmt: skip
        if self.channels.wavelengths_nm is not None:
            content["wavelengths_nm"] = list(self.channels.wavelengths_nm)
        elif len(self.channels) > 1:
            content["channels"] = list(self.channels.names)
        content["source"] = {"text": f"gonio fit of '{self.requested}' to {self.table or 'a table'}"}
        fit = self.to_dict()
        fit.pop("spelling")
        content["fit"] = toml_values(fit)
        return content

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
from gonio.fitting.judgement import FAILED, FitJudgement, judge_fit
from gonio.fitting.moved_numbers import with_number
from gonio.fitting.residuals.colour_difference import sphere_difference
from gonio.fitting.residuals.summary import Evidence, ResidualSummary, summarise
from gonio.fitting.uncertainty.joint_covariance import JointCovariance
from gonio.fitting.uncertainty.optimum import ParameterEstimate
from gonio.models.brdf import AbstractBRDF, changed_terms
from gonio.models.deprecation import renamed_attribute
from gonio.models.display import Displayed
from gonio.models.errors import printable

CORRELATED = 0.95  # from which on a correlation is reported
MOST_CORRELATED = 5
MOST_IN_FULL = 64  # free numbers whose covariance files keep in full
JUDGED = ("samples", "converged", "reason", "metrics", "undetermined", "common_errors")  # attributes
MOST_SHOWN = 7  # numbers in a repr


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
        uncertainty: the covariances of each fit (one, or one for each channel), with what they leave open.
        converged: stationary by the projected gradient, or exact; `reason` says why.
        stationarity: largest projected gradient; `exact`: the residual is rounding.
        loss, weight, robust, theta_max: as resolved; `floor`: of the loss, one for each channel fitted by itself.
        cost: ½Σr² of the loss; `bic`: compares models on the same readings and loss; `metrics`: differences by
            name; `unexplained`, Σr² over that of the best Lambertian; `largest_albedo` of incidences up to 85°, to 2 %
            below 0.95 and to 1e-4 above and for brushed models; `reduced_chi2` where the noise is known.
        samples, cells, negative_readings: what was fitted, without readings that repeat others; `counts`: readings by
            what became of them.
        starts, starts_agreed: descents, and how many ended at the best cost.
        undetermined, active_bounds, notes: sentences and labels.
        alternatives: the other models, as plain data; `bootstrap`: what the refits gave.
        seconds: wall time by stage; `table`: name of the table; `scene`: what is promised in the scene of the fit.
        nuisance: errors of the instrument that were fitted too, with their uncertainties, where that was asked for.
        common_errors: what all readings share and the standard uncertainties leave out; see `common_errors`.
        apertures: averages over the discs of light and detector, and what the numbers at their centres are off by.
    """

    expression: str
    requested: str
    brdf: AbstractBRDF
    channels: Channels
    parameters: list[ParameterEstimate]
    free_names: list[str]
    uncertainty: list[JointCovariance] = dataclasses.field(repr=False, compare=False)
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
    scene: dict[str, Any] | None = None
    apertures: dict[str, Any] | None = None
    nuisance: list[dict[str, Any]] | None = None
    common_errors: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    evidence: Evidence | None = dataclasses.field(default=None, repr=False, compare=False)

    asked = renamed_attribute("asked", "requested")
    spelling = renamed_attribute("spelling", "expression")

    def facts(self) -> dict[str, str]:
        """Verdict, model, the first free numbers with their standard uncertainties, and how well they fit."""
        free = [p for p in self.parameters if p.status != "fixed"]
        numbers = {p.label: f"{p.value:.6g} ± {p.standard_uncertainty:.2g}, {p.status}" for p in free[:MOST_SHOWN]}
        more = {"…": f"{len(free) - MOST_SHOWN} more"} if len(free) > MOST_SHOWN else {}
        metrics = (
            f"relative rms {self.metrics['relative_rms']:.3g}, {self.readings_in_words} of {self.table or 'a table'}"
        )
        return {"verdict": self.judgement.sentence, "model": self.requested, **numbers, **more, "fit": metrics}

    @property
    def readings_in_words(self) -> str:
        """How many readings were fitted, and how many more only repeat them."""
        copies = self.counts.get("copies", 0)
        return f"{self.samples:,} readings" + f" (and {copies:,} that repeat them)" * (copies > 0)

    @functools.cached_property
    def covariance(self) -> np.ndarray:
        """Covariance (P, P) of the free numbers; those of channels fitted by themselves do not depend on each other."""
        size, first = len(self.free_names), 0
        covariance = np.zeros((size, size))
        for u in self.uncertainty:
            these = slice(first, first + u.size)
            covariance[these, these], first = u.matrix(), first + u.size
        return covariance

    @property
    def correlation(self) -> np.ndarray:
        """Correlation (P, P) of the free numbers."""
        with np.errstate(invalid="ignore"):
            deviations = np.sqrt(np.diagonal(self.covariance))
            return self.covariance / np.outer(deviations, deviations)

    def _views(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """(indices of some free numbers (K,), their covariance (K, K)): all pairs but those of two channels."""
        views, first = [], 0
        for u in self.uncertainty:
            views += [(first + v.index, v.covariance.matrix) for v in u.views]
            first += u.size
        return views

    @functools.cached_property
    def residuals(self) -> ResidualSummary | None:
        """Noise or structure, maps over angles, and readings that stand out; computed on first use."""
        return None if self.evidence is None else summarise(self.evidence)

    @functools.cached_property
    def judgement(self) -> FitJudgement:
        """Whether the fit is good, fair, poor or failed, and why."""
        residuals = None if self.residuals is None else self.residuals.to_dict()
        return judge_fit({**{f: getattr(self, f) for f in JUDGED}, "residuals": residuals})

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
        determined = np.array([n in known for n in self.free_names], bool)
        pairs: dict[tuple[int, int], float] = {}
        for index, covariance in self._views():
            with np.errstate(invalid="ignore"):
                deviations = np.where(determined[index], np.sqrt(np.diagonal(covariance)), np.nan)
                correlation = covariance / np.outer(deviations, deviations)
            for i, j in zip(*np.nonzero(np.triu(np.abs(correlation) >= CORRELATED, 1)), strict=True):
                a, b = sorted((int(index[i]), int(index[j])))
                pairs[a, b] = float(correlation[i, j])
        strongest = sorted(pairs, key=lambda pair: -abs(pairs[pair]))[:MOST_CORRELATED]
        return [{"a": self.free_names[a], "b": self.free_names[b], "correlation": pairs[a, b]} for a, b in strongest]

    def albedo(self, theta_i: ArrayLike, phi_i: ArrayLike = 0.0, degrees: bool = False) -> DerivedNumber:
        """Share of the light from (theta_i, phi_i) that the fitted model reflects; see `Material.albedo`."""
        estimate = self.material.albedo(theta_i, phi_i, degrees)
        spread = self.propagated(lambda material: material.albedo(theta_i, phi_i, degrees).value, by_channel=True)
        return DerivedNumber(estimate.value, estimate.bound, spread)

    def propagated(
        self, quantity: Callable[[Material], np.ndarray], by_channel: bool = False, linear: bool = False
    ) -> np.ndarray:
        """Standard uncertainty of a quantity of the material from the covariance of the fit.

        By central differences over one standard uncertainty on either side, within the domain [JCGM 100:2008, eq. 13].
        Numbers on an active bound add nothing; NaN where the readings leave a number without a covariance.

        Args:
            quantity: array of a material.
            by_channel: the array's last axis is the channels, and a channel's values depend on no other channel's
                numbers: those of all channels are then moved at once.
            linear: the quantity is linear in f: only terms that change are then evaluated, and the array has all
                channels even where these terms have none.
        """
        free = [p for p in self.parameters if p.status != "fixed"]
        moving = [k for k, p in enumerate(free) if not p.status.startswith("at ")]
        if not moving:
            return np.zeros_like(quantity(self.material))
        if not by_channel:
            j = np.stack(np.broadcast_arrays(*(self._slope(quantity, [free[k]], linear) for k in moving)))
            return _spread(j, self.covariance[np.ix_(moving, moving)])
        groups: dict[str, list[ParameterEstimate]] = {}
        for k in moving:
            groups.setdefault(free[k].name, []).append(free[k])
        slopes = {name: self._slope(quantity, group, linear) for name, group in groups.items()}
        spreads, views, free_to_move = [], self._views(), set(moving)
        for c, channel in enumerate(self.channels.names):
            index, covariance = views[c if len(views) == len(self.channels) else 0]
            involved = [i for i, k in enumerate(index) if free[k].channel in (None, channel) and k in free_to_move]
            j = [slopes[free[index[i]].name][..., c] for i in involved]
            spreads.append(_spread(np.stack(j), covariance[np.ix_(involved, involved)]) if j else np.zeros(()))
        return np.stack(np.broadcast_arrays(*spreads), axis=-1)

    def _slope(
        self, quantity: Callable[[Material], np.ndarray], moved: list[ParameterEstimate], linear: bool
    ) -> np.ndarray:
        """Slope of a quantity by a number; by those of several channels, of the last axis each by its channel's."""
        low, high = (
            {p.label: min(max(p.value + sign * p.standard_uncertainty, p.low), p.high) for p in moved}
            for sign in (-1, 1)
        )
        width = {label: high[label] - low[label] if low[label] < high[label] else np.nan for label in low}
        if np.isnan(list(width.values())).all():
            return np.full_like(quantity(self.material), np.nan)
        low, high = ({k: v for k, v in ends.items() if np.isfinite(width[k])} for ends in (low, high))
        brdfs = [self._with_numbers(moved, ends) for ends in (high, low)]
        above, below = changed_terms(*brdfs) if linear else brdfs
        difference = self._of(quantity, above) - self._of(quantity, below)
        if len(moved) == 1:
            return difference / width[moved[0].label]
        by = {p.channel: width[p.label] for p in moved}
        return difference / np.array([by.get(name, np.inf) for name in self.channels.names])

    def _of(self, quantity: Callable[[Material], np.ndarray], brdf: AbstractBRDF) -> np.ndarray:
        # Without what a file holds of the fit: to sum its residuals up takes longer than the quantity.
        return quantity(Material(self.table or "fit", brdf, self.expression, self.channels))

    def _with_numbers(self, moved: list[ParameterEstimate], values: dict[str, float]) -> AbstractBRDF:
        """The model with one of its numbers changed, in one or several channels: values by label."""
        of_channel = {p.channel: values[p.label] for p in moved if p.label in values}
        return with_number(self.expression, self.channels.names, moved[0].name, of_channel)

    @property
    def exit_status(self) -> int:
        """1 where the fit failed, by its judgement, or does not keep the tolerance of a scene; else 0."""
        beyond = self.scene is not None and not self.scene["keeps"]
        return 1 if self.judgement.verdict == FAILED or beyond else 0

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

        name = printable(Path(path).name).removesuffix(".toml").removesuffix(".fit")
        with new_file(path, force) as part:
            part.write_text(tomli_w.dumps(self.to_material_dict(name)), encoding="utf-8")
        return Path(path)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the model itself, as what JSON and TOML can hold."""
        models = ("brdf", "channels", "evidence", "uncertainty")
        content = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name not in models}
        content |= self._covariances()
        content["correlated"] = self.correlated
        content["colour_difference"] = self.colour_difference
        content["judgement"] = self.judgement._asdict()
        content["residuals"] = None if self.residuals is None else self.residuals.to_dict()
        content["parameters"] = [dataclasses.asdict(p) for p in self.parameters]
        content["channels"] = list(self.channels.names)
        for name, in_files in (("expression", "spelling"), ("requested", "asked")):
            content[in_files] = content.pop(name)
        return unboxed(content)

    def _covariances(self) -> dict[str, Any]:
        """The covariance as files keep it: in full, or of each channel's numbers with the shared ones."""
        if len(self.free_names) <= MOST_IN_FULL:
            return {"covariance": self.covariance, "correlation": self.correlation}
        return {"covariance_by_channel": [{"numbers": i, "covariance": c} for i, c in self._views()]}

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


def _spread(slopes: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """√(gᵀ C g) of slopes g (K, ...) by numbers with a covariance C (K, K)."""
    return np.sqrt(np.maximum(np.einsum("i...,ij,j...->...", slopes, covariance, slopes), 0.0))

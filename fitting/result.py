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
from gonio.fitting.fit_model import FitTask
from gonio.fitting.judgement import ALBEDO_TOLERANCE, FAILED, FitJudgement, judge_fit
from gonio.fitting.problem.parameterisation import of_channel
from gonio.fitting.residuals.colour_difference import sphere_difference
from gonio.fitting.residuals.energy import LargestAlbedo, confirmed, largest_albedo
from gonio.fitting.residuals.metrics import metrics
from gonio.fitting.residuals.summary import Evidence, ResidualSummary, summarise
from gonio.fitting.solver.levenberg_marquardt import eps, is_double
from gonio.fitting.uncertainty.bootstrap import bootstrap, bootstrap_summary
from gonio.fitting.uncertainty.clusters import with_clusters
from gonio.fitting.uncertainty.identifiability import MOST_ALIKE, listed, undetermined_sentences
from gonio.fitting.uncertainty.joint_covariance import JointCovariance
from gonio.fitting.uncertainty.optimum import Optimum, ParameterEstimate
from gonio.fitting.uncertainty.profile_likelihood import with_profiles
from gonio.models.brdf import AbstractBRDF
from gonio.models.catalog import MODELS
from gonio.models.deprecation import renamed_attribute
from gonio.models.display import Displayed
from gonio.models.errors import printable
from gonio.models.expression.builder import build, frame, number_label, to_expression
from gonio.models.expression.parser import FACTOR, Term, Value, calls, changed, numbers, parse

CORRELATED = 0.95  # from which on a correlation is reported
MOST_CORRELATED = 5
FEW_CHANNELS = 4  # whose albedos are all computed to a bound
MOST_IN_FULL = 64  # free numbers whose covariance files keep in full
JUDGED = ("converged", "reason", "metrics", "undetermined")  # attributes
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
        cost: ½Σr² of the loss; `bic`: compares models on the same readings and loss; `metrics`: differences by name.
        samples, cells, negative_readings: what was fitted; `counts`: readings by what became of them.
        starts, starts_agreed: descents, and how many ended at the best cost.
        undetermined, active_bounds, notes: sentences and labels.
        alternatives: the other models, as plain data; `bootstrap`: what the refits gave.
        seconds: wall time by stage; `table`: name of the table; `scene`: what is promised in the scene of the fit.
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
    evidence: Evidence | None = dataclasses.field(default=None, repr=False, compare=False)

    asked = renamed_attribute("asked", "requested")
    spelling = renamed_attribute("spelling", "expression")

    def facts(self) -> dict[str, str]:
        """Verdict, model, the first free numbers with their standard uncertainties, and how well they fit."""
        free = [p for p in self.parameters if p.status != "fixed"]
        numbers = {p.label: f"{p.value:.6g} ± {p.standard_uncertainty:.2g}, {p.status}" for p in free[:MOST_SHOWN]}
        more = {"…": f"{len(free) - MOST_SHOWN} more"} if len(free) > MOST_SHOWN else {}
        metrics = (
            f"relative rms {self.metrics['relative_rms']:.3g}, {self.samples:,} readings of {self.table or 'a table'}"
        )
        return {"verdict": self.judgement.sentence, "model": self.requested, **numbers, **more, "fit": metrics}

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

    def propagated(self, quantity: Callable[[Material], np.ndarray], by_channel: bool = False) -> np.ndarray:
        """Standard uncertainty of a quantity of the material from the covariance of the fit.

        By central differences over one standard uncertainty on either side, within the domain [JCGM 100:2008, eq. 13].
        Numbers on an active bound add nothing; NaN where the readings leave a number without a covariance.

        Args:
            quantity: array of a material.
            by_channel: the array's last axis is the channels, and a channel's values depend on no other channel's
                numbers: those of all channels are then moved at once.
        """
        free = [p for p in self.parameters if p.status != "fixed"]
        moving = [k for k, p in enumerate(free) if not p.status.startswith("at ")]
        if not moving:
            return np.zeros_like(quantity(self.material))
        if not by_channel:
            j = np.stack(np.broadcast_arrays(*(self._slope(quantity, [free[k]]) for k in moving)))
            return _spread(j, self.covariance[np.ix_(moving, moving)])
        groups: dict[str, list[ParameterEstimate]] = {}
        for k in moving:
            groups.setdefault(free[k].name, []).append(free[k])
        slopes = {name: self._slope(quantity, group) for name, group in groups.items()}
        spreads, views, free_to_move = [], self._views(), set(moving)
        for c, channel in enumerate(self.channels.names):
            index, covariance = views[c if len(views) == len(self.channels) else 0]
            involved = [i for i, k in enumerate(index) if free[k].channel in (None, channel) and k in free_to_move]
            j = [slopes[free[index[i]].name][..., c] for i in involved]
            spreads.append(_spread(np.stack(j), covariance[np.ix_(involved, involved)]) if j else np.zeros(()))
        return np.stack(np.broadcast_arrays(*spreads), axis=-1)

    def _slope(self, quantity: Callable[[Material], np.ndarray], moved: list[ParameterEstimate]) -> np.ndarray:
        """Slope of a quantity by a number; by those of several channels, of the last axis each by its channel's."""
        low, high = (
            {p.label: min(max(p.value + sign * p.standard_uncertainty, p.low), p.high) for p in moved}
            for sign in (-1, 1)
        )
        width = {label: high[label] - low[label] if low[label] < high[label] else np.nan for label in low}
        if np.isnan(list(width.values())).all():
            return np.full_like(quantity(self.material), np.nan)
        low, high = ({k: v for k, v in ends.items() if np.isfinite(width[k])} for ends in (low, high))
        difference = quantity(self._with_numbers(moved, high)) - quantity(self._with_numbers(moved, low))
        if len(moved) == 1:
            return difference / width[moved[0].label]
        by = {p.channel: width[p.label] for p in moved}
        return difference / np.array([by.get(name, np.inf) for name in self.channels.names])

    def _with_numbers(self, moved: list[ParameterEstimate], values: dict[str, float]) -> Material:
        """The material with one of its numbers changed, in one or several channels: values by label."""
        terms = parse(self.expression)
        frames = tuple(frame(t) for t in terms)
        of_channel = {p.channel: values[p.label] for p in moved if p.label in values}

        def value_at(v: Value) -> Value:
            if None in of_channel or not isinstance(v.number, tuple):
                return Value(next(iter(of_channel.values())))
            return Value(tuple(map(of_channel.get, self.channels.names, v.number)))

        terms = tuple(
            changed(
                t, {n.path: value_at(n.value) for n in numbers(t) if number_label(frames, k, n.path) == moved[0].name}
            )
            for k, t in enumerate(terms)
        )
        return dataclasses.replace(self.material, brdf=build(terms))

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


def assemble_result(task: FitTask, optima: list[Optimum], seconds: dict[str, float]) -> FitResult:
    """The result of one joint optimum, or of one optimum for each channel."""
    settings, readings, channels = task.settings, task.readings, task.channels
    optima, notes = _widened(task, optima)
    clustered = [with_clusters(e, settings.seed) for e in optima]
    optima, notes = [e for e, _ in clustered], [*notes, *dict.fromkeys(note for _, note in clustered if note)]
    optima = [with_profiles(e, vague) if (vague := e.vague_numbers()) else e for e in optima]
    of_channel = [None] if len(optima) == 1 else list(channels.names)
    estimates = [e.estimates(channels, name) for e, name in zip(optima, of_channel, strict=True)]
    free = [p for each in estimates for p in each]
    labels = [p.label for p in free]
    for e, each in zip(optima, estimates, strict=True):
        if e.unfollowed:
            these = listed([each[k].label for k in e.unfollowed])
            notes.append(
                f"95 % intervals of {these}: they come from the covariance matrix; the profile likelihood did not "
                "reach its limit"
            )
    cost = float(sum(e.cost for e in optima))
    f = np.concatenate([e.model_f for e in optima], axis=1)
    brdf = build(fitted := optima[0].parameters.filled(task.terms, [e.p for e in optima]))
    measures = metrics(f, readings)
    measures["unexplained"] = _unexplained(optima)
    measures["largest_albedo"] = (albedo := _largest_albedo(optima, fitted)).value
    if albedo.value > 1.0 + ALBEDO_TOLERANCE:
        notes.insert(0, _creates_energy(albedo, channels))
    if task.likelihood:
        measures["reduced_chi2"] = 2.0 * cost / max(readings.count - len(free), 1)
    return FitResult(
        expression=to_expression(brdf), requested=task.requested, brdf=brdf, channels=channels,
        parameters=free + _fixed(task.terms, optima[0], channels), free_names=labels,
        uncertainty=[e.covariance for e in optima], converged=all(e.converged for e in optima),
        reason=_reason(optima), stationarity=max(e.projected_gradient for e in optima),
        exact=all(e.exact for e in optima), loss=task.loss, weight=task.weight, cost=cost, metrics=measures,
        samples=readings.count, cells=readings.f.shape[0],
        negative_readings=int(np.count_nonzero(readings.valid & (readings.f < 0))),
        starts=sum(e.starts for e in optima), starts_agreed=sum(e.agreed for e in optima),
        bic=_bic(task, optima, cost, len(free)),
        undetermined=_undetermined(optima, estimates),
        active_bounds=[p.label for p in free if p.status.startswith("at ")], seconds=seconds,
        theta_max=settings.theta_max, table=task.table, counts=task.counts,
        notes=[*notes, *sorted({n for e in optima for n in e.notes}), *_kept_defaults(task.terms)],
        floor=[float(e.problem.samples.floor) for e in optima], robust=settings.robust,
        evidence=_evidence(task, optima, f, cost), bootstrap=_bootstrap(task, optima, labels),
    )  # fmt: skip


def _kept_defaults(terms: tuple[Term, ...]) -> list[str]:
    """A note for each model on the parameters that have a default, which the expression does not name."""
    notes = []
    for call in calls(terms):
        defaults = {f.name: f.default for f in dataclasses.fields(MODELS[call.name]) if "parameter" in f.metadata}
        kept = [
            f"{name}={default:g}"
            for name, default in defaults.items()
            if name not in call.values and isinstance(default, int | float)
        ]
        if kept:
            notes.append(f"{call.name} keeps {', '.join(kept)}: not fitted; write name=? to free one")
    return notes


def _unexplained(optima: list[Optimum]) -> float:
    """Σr² over that of the best Lambertian of each channel: the share of what there is to explain that is left."""
    remaining = total = 0.0
    for e in optima:
        y, linear = np.where(e.problem.weight > 0, e.readings.f, 0.0), e.problem.linearised().weight
        share = np.where(np.isfinite(linear), linear, 0.0) ** 2
        mean = np.sum(share * y, axis=0) / np.maximum(np.sum(share, axis=0), 1e-300)
        total += float(np.sum(e.problem.residuals(np.broadcast_to(mean, y.shape)) ** 2))
        remaining += 2.0 * float(e.cost)
    return remaining / total if total > 0 else float("nan")


def _largest_albedo(optima: list[Optimum], fitted: tuple[Term, ...]) -> LargestAlbedo:
    each = [largest_albedo(functools.partial(e.problem.values_at, e.p), e.parameters.channels) for e in optima]
    channel = int(np.argmax([a.value for a in each]))
    worst = each[channel] if len(each) == 1 else each[channel]._replace(channel=channel)
    if max(len(each), optima[0].parameters.channels) <= FEW_CHANNELS:
        return confirmed(worst, build(fitted))
    return confirmed(worst, build(of_channel(fitted, worst.channel)))._replace(channel=worst.channel)


def _creates_energy(a: LargestAlbedo, channels: Channels) -> str:
    channel = f" in channel {channels.names[a.channel]}" if len(channels) > 1 and a.channel < len(channels) else ""
    return (
        f"the fitted model reflects more than it receives: {a.value:.3f} of the light at θi "
        f"{np.degrees(a.theta_i):.0f}°{channel}; do not use it where energy counts"
    )


def _undetermined(optima: list[Optimum], estimates: list[list[ParameterEstimate]]) -> list[str]:
    unclear = [
        (e, each)
        for e, each in zip(optima, estimates, strict=True)
        if e.covariance.undetermined.any() or any(p.status == "undetermined" for p in each) or e.combinations
    ]
    if len(unclear) <= MOST_ALIKE:
        return [sentence for e, each in unclear for sentence in undetermined_sentences(e, each)]
    names = [each[0].channel or "" for _, each in unclear[1:]]
    return [
        *undetermined_sentences(*unclear[0]),
        f"numbers of {len(names)} other channels are open too: {listed(names)}",
    ]


def _bootstrap(task: FitTask, optima: list[Optimum], labels: list[str]) -> dict[str, Any] | None:
    o = task.settings
    if not (o.bootstrap and labels):
        return None
    return bootstrap_summary(optima, [bootstrap(e, o.bootstrap, o.bootstrap_kind, o.seed) for e in optima], labels)


def _evidence(task: FitTask, optima: list[Optimum], f: np.ndarray, cost: float) -> Evidence:
    robust = optima[0].downweighted
    if robust is not None:
        kept = np.concatenate([e.downweighted.kept for e in optima if e.downweighted], axis=1)
        robust = dataclasses.replace(robust, kept=kept)
    return Evidence(
        task.readings, f, np.concatenate([e.problem.weight for e in optima], axis=1), task.loss,
        np.array([float(e.problem.samples.floor) for e in optima]), task.likelihood, all(e.exact for e in optima),
        sum(e.p.size for e in optima), 2.0 * cost if task.likelihood else None, robust, task.layout,
        task.settings.seed,
    )  # fmt: skip


def _widened(task: FitTask, optima: list[Optimum]) -> tuple[list[Optimum], list[str]]:
    """Where residuals exceed the known noise, uncertainties grow by Birge's ratio √χ²ᵣ [Birge 1932], with a note."""
    if not task.likelihood:
        return optima, []
    freedom = max(task.readings.count - sum(e.p.size for e in optima), 1)
    chi2 = 2.0 * sum(e.cost for e in optima) / freedom
    if chi2 <= 1.0 + 5.0 * np.sqrt(2.0 / freedom):
        return optima, []
    return [e.widened(chi2) for e in optima], [
        f"the residuals exceed the known noise (reduced χ² {chi2:.3g}): the model leaves something out; the standard "
        f"uncertainties are widened by {np.sqrt(chi2):.3g}"
    ]


def _reason(optima: list[Optimum]) -> str:
    reasons = []
    for e in optima:
        if not np.isfinite(e.cost):
            reasons.append("the cost is not finite")
        elif e.exact:
            reasons.append("exact: the residual is rounding")
        elif e.projected_gradient <= e.limit:
            single = f"stationary to {e.limit:.1g}, which single precision allows"
            reasons.append("stationary" if is_double() else single)
        else:
            reasons.append(f"not stationary: the projected gradient is {e.projected_gradient:.1e}, above {e.limit:.1g}")
    return "; ".join(dict.fromkeys(reasons))


def _bic(task: FitTask, optima: list[Optimum], cost: float, free: int) -> float:
    """Schwarz's criterion [Schwarz 1978], up to what models on the same readings share; lower is better."""
    count = task.readings.count
    if task.likelihood:
        return 2.0 * cost - 2.0 * sum(e.log_weight for e in optima) + free * np.log(count)
    least = sum(e.problem.target_norm_squared for e in optima) * (1e3 * eps()) ** 2
    return float(count * np.log(max(2.0 * cost, least, 1e-300) / count) + free * np.log(count))


def _fixed(terms: tuple[Term, ...], e: Optimum, channels: Channels) -> list[ParameterEstimate]:
    """The numbers that the expression fixes."""
    estimates = []
    for index, term in enumerate(terms):
        for n in (n for n in numbers(term) if n.path in e.problem.fixed[index]):
            high = np.inf if n.name == FACTOR else n.info.high
            values = np.atleast_1d(np.asarray(n.value.number, float)).tolist()
            for c, value in enumerate(values):
                channel = channels.names[c] if len(values) > 1 else None
                name, domain = number_label(e.parameters.frames, index, n.path), (n.info.low, high)
                nothing = (value, value)
                estimates.append(ParameterEstimate(name, channel, value, 0.0, nothing, "fixed", n.info.unit, *domain))
    return estimates

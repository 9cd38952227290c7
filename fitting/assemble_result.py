"""From the optima of a fit to its result: estimates, intervals, undetermined combinations, notes, metrics."""

import dataclasses
from typing import Any

import numpy as np

from gonio.data.table import Channels
from gonio.fitting.fit_model import FitTask
from gonio.fitting.residuals.metrics import metrics
from gonio.fitting.residuals.summary import Evidence
from gonio.fitting.result import FitResult, ParameterEstimate
from gonio.fitting.solver.convergence import eps, is_double
from gonio.fitting.uncertainty.bootstrap import bootstrap, bootstrap_summary
from gonio.fitting.uncertainty.covariance import NORMAL_95
from gonio.fitting.uncertainty.identifiability import undetermined_sentences
from gonio.fitting.uncertainty.optimum import Optimum
from gonio.fitting.uncertainty.profile_likelihood import with_profiles
from gonio.models.expression.builder import build, to_expression
from gonio.models.expression.labels import number_label
from gonio.models.expression.parser import Term
from gonio.models.expression.paths import FACTOR, last, numbers


def assemble_result(task: FitTask, optima: list[Optimum], seconds: dict[str, float]) -> FitResult:
    """The result of one joint optimum, or of one optimum for each channel."""
    settings, readings, channels = task.settings, task.readings, task.channels
    brdf = build(optima[0].parameters.filled(task.terms, [e.p for e in optima]))
    f = np.concatenate([e.model_f for e in optima], axis=1)
    optima, notes = _widened(task, optima)
    optima = [with_profiles(e) for e in optima]
    of_channel = [None] if len(optima) == 1 else list(channels.names)
    estimates = [_estimates(e, channels, name) for e, name in zip(optima, of_channel, strict=True)]
    free = [p for each in estimates for p in each]
    labels = [p.label for p in free]
    for e, each in zip(optima, estimates, strict=True):
        if e.unfollowed:
            these = ", ".join(each[k].label for k in e.unfollowed)
            notes.append(
                f"95 % intervals of {these}: they come from the covariance matrix; the profile likelihood did not "
                "reach its limit"
            )
    covariance, correlation = _joint_covariance(optima)
    cost = float(sum(e.cost for e in optima))
    measures = metrics(f, readings)
    if task.likelihood:
        measures["reduced_chi2"] = 2.0 * cost / max(readings.count - len(free), 1)
    return FitResult(
        expression=to_expression(brdf), requested=task.requested, brdf=brdf, channels=channels,
        parameters=free + _fixed(task.terms, optima[0], channels), free_names=labels,
        covariance=covariance, correlation=correlation, converged=all(e.converged for e in optima),
        reason=_reason(optima), stationarity=max(e.projected_gradient for e in optima),
        exact=all(e.exact for e in optima), loss=task.loss, weight=task.weight, cost=cost, metrics=measures,
        samples=readings.count, cells=readings.f.shape[0],
        negative_readings=int(np.count_nonzero(readings.valid & (readings.f < 0))),
        starts=sum(e.starts for e in optima), starts_agreed=sum(e.agreed for e in optima),
        bic=_bic(task, optima, cost, len(free)),
        undetermined=[s for e, each in zip(optima, estimates, strict=True) for s in undetermined_sentences(e, each)],
        active_bounds=[p.label for p in free if p.status.startswith("at ")], seconds=seconds,
        theta_max=settings.theta_max, notes=notes + sorted({n for e in optima for n in e.notes}), table=task.table,
        counts=task.counts, floor=[e.problem.floor for e in optima], robust=settings.robust,
        evidence=_evidence(task, optima, f, cost), bootstrap=_bootstrap(task, optima, labels),
    )  # fmt: skip


def _joint_covariance(optima: list[Optimum]) -> tuple[np.ndarray, np.ndarray]:
    """(covariance, correlation) of the numbers of all optima, which do not depend on each other."""
    size, first = sum(e.p.size for e in optima), 0
    covariance = np.zeros((size, size))
    for e in optima:
        covariance[first : first + e.p.size, first : first + e.p.size] = e.covariance.matrix
        first += e.p.size
    with np.errstate(invalid="ignore"):
        deviations = np.sqrt(np.diagonal(covariance))
        return covariance, covariance / np.outer(deviations, deviations)


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
        np.array([e.problem.floor for e in optima]), task.likelihood, all(e.exact for e in optima),
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
        f"uncertainties are widened by {np.sqrt(chi2):.3g} and still hold for noise only"
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


def _estimates(e: Optimum, channels: Channels, only: str | None) -> list[ParameterEstimate]:
    """The free numbers of an optimum of all channels, or of the channel `only`."""
    infos, estimates = e.parameters.each(lambda g: g.info), []
    for k, (name, c) in enumerate(e.parameters.labels()):
        value, u = float(e.p[k]), float(e.covariance.standard[k])
        u = max(u, float(np.finfo(float).eps) * abs(value)) if np.isfinite(u) else u
        low, high = float(e.domains.low[k]), float(e.domains.high[k])
        spread = NORMAL_95 * u if np.isfinite(u) else np.inf
        interval = e.profile.get(k, (max(low, value - spread), min(high, value + spread)))
        if e.active_bound[k]:
            inside = e.reach[k] if np.isfinite(e.reach[k]) else high - low
            lower = value - low <= high - value
            status = "at lower bound" if lower else "at upper bound"
            interval = (value, min(high, value + inside)) if lower else (max(low, value - inside), value)
        else:
            lost = e.covariance.undetermined[k] or not np.isfinite(u)
            status = "undetermined" if lost else "determined"
        channel = only or (None if c is None else channels.names[c])
        estimates.append(ParameterEstimate(name, channel, value, u, interval, status, infos[k].unit, low, high))
    return estimates


def _fixed(terms: tuple[Term, ...], e: Optimum, channels: Channels) -> list[ParameterEstimate]:
    """The numbers that the expression fixes."""
    estimates = []
    for index, term in enumerate(terms):
        for n in (n for n in numbers(term) if n.path in e.problem.fixed[index]):
            high = np.inf if last(n.path) == FACTOR else n.info.high
            values = np.atleast_1d(np.asarray(n.value.number, float)).tolist()
            for c, value in enumerate(values):
                channel = channels.names[c] if len(values) > 1 else None
                name, domain = number_label(e.parameters.frames, index, n.path), (n.info.low, high)
                nothing = (value, value)
                estimates.append(ParameterEstimate(name, channel, value, 0.0, nothing, "fixed", n.info.unit, *domain))
    return estimates

"""From the end of a fit to what is said of it."""

import dataclasses
import re

import numpy as np

from gonio.data.table import Channels
from gonio.fitting.problem.parameterisation import count, domains_of, label, labels
from gonio.fitting.problem.readings import Readings
from gonio.fitting.residuals.metrics import metrics
from gonio.fitting.residuals.summary import Evidence
from gonio.fitting.result import FitResult, ParameterEstimate
from gonio.fitting.solver.convergence import eps, is_double
from gonio.fitting.uncertainty.bootstrap import bootstrap, told
from gonio.fitting.uncertainty.covariance import NORMAL_95
from gonio.fitting.uncertainty.identifiability import in_words
from gonio.fitting.uncertainty.informative_directions import advice
from gonio.fitting.uncertainty.profile_likelihood import with_profiles
from gonio.models.expression.builder import build, to_expression
from gonio.models.expression.parser import Term, Value
from gonio.models.expression.paths import FACTOR, changed, last, numbers


def state(
    asked, terms: tuple[Term, ...], endings, readings: Readings, channels: Channels, options, seconds
) -> FitResult:
    """The result of one joint ending, or of one ending for each channel."""
    brdf = build(_filled(terms, endings))
    f = endings[0].model_f if len(endings) == 1 else np.concatenate([e.model_f for e in endings], axis=1)
    endings, notes = _widened(endings, readings, options)
    endings = [with_profiles(e) for e in endings]
    estimates, names, these_of = [], [], []
    for c, e in enumerate(endings):
        of_channel = channels.names[c] if len(endings) > 1 else None
        these = _estimates(e, channels, of_channel)
        estimates += these
        these_of.append(these)
        names += [p.label for p in these]
    estimates += _held(terms, endings[0], channels)
    matrix = _block_diagonal([e.covariance.matrix for e in endings])
    with np.errstate(invalid="ignore"):
        deviations = np.sqrt(np.diagonal(matrix))
        correlation = matrix / np.outer(deviations, deviations)
    undetermined, at, size = [], 0, len(names)
    for c, e in enumerate(endings):
        mine = names[at : at + e.structure.size]
        seen = readings.channel(c) if len(endings) > 1 else readings
        linear = np.array([g.linear for g in e.structure.groups for _ in range(count(e.structure, g))], bool)
        undetermined += [
            f"{in_words(variance, change, e.p, mine, linear)}; {advice(e, k, seen)}"
            for k, (variance, change) in enumerate(e.covariance.combinations)
        ]
        silent = np.flatnonzero(e.covariance.undetermined & (np.diagonal(np.asarray(e.total.matrix)) <= 0))
        undetermined += [f"{mine[k]} does not change the residuals at all" for k in silent]
        undetermined += _unnamed(these_of[c], undetermined)
        if e.unfollowed:
            these = ", ".join(mine[k] for k in e.unfollowed)
            notes.append(f"95 % intervals of {these}: by the covariance, the cost was not followed to their ends")
        at += e.structure.size
    measured = metrics(f, readings)
    cost = float(sum(float(e.total.cost) for e in endings))
    if options.likelihood:
        measured["reduced_chi2"] = 2.0 * cost / max(readings.count - size, 1)
    return FitResult(
        expression=to_expression(brdf), asked=asked, brdf=brdf, channels=channels, parameters=estimates,
        free_names=names,
        covariance=matrix, correlation=correlation, converged=all(e.converged for e in endings),
        reason=_reason(endings), stationarity=max(e.stationarity for e in endings), exact=all(e.exact for e in endings),
        loss=options.loss, weight=options.weight, cost=cost, metrics=measured, samples=readings.count,
        cells=readings.f.shape[0], negative_readings=int(np.count_nonzero(readings.valid & (readings.f < 0))),
        starts=sum(e.starts for e in endings), starts_agreed=sum(e.agreed for e in endings),
        bic=_bic(endings, cost, readings.count, size, options), undetermined=undetermined,
        active_bounds=[p.label for p in estimates if p.status.startswith("at ")], seconds=seconds,
        theta_max=options.theta_max, notes=notes + sorted({n for e in endings for n in e.notes}), table=options.table,
        counts=options.counts, floor=[float(e.problem.data.floor) for e in endings], robust=options.robust,
        evidence=_evidence(endings, readings, options, f, cost, size),
        bootstrap=_drawn_again(endings, readings, options, names),
    )  # fmt: skip


def _drawn_again(endings, readings: Readings, options, names: list[str]) -> dict | None:
    if not (options.bootstrap and names):
        return None
    drawn = []
    for c, e in enumerate(endings):
        these = readings.channel(c) if len(endings) > 1 else readings
        drawn.append(bootstrap(e, these, options.bootstrap, options.bootstrap_kind, options.seed))
    return told(endings, drawn, names)


def _evidence(endings, readings: Readings, options, f: np.ndarray, cost: float, size: int) -> Evidence:
    aside = endings[0].aside
    if aside is not None:
        aside = dataclasses.replace(aside, kept=np.concatenate([e.aside.kept for e in endings], axis=1))
    return Evidence(
        readings, f, np.concatenate([e.weight for e in endings], axis=1), options.loss,
        np.array([float(e.problem.data.floor) for e in endings]), options.likelihood,
        all(e.exact for e in endings), size, 2.0 * cost if options.likelihood else None, aside, options.layout,
        options.seed,
    )  # fmt: skip


def _widened(endings, readings: Readings, options):
    """Where residuals exceed the known noise, uncertainties grow by Birge's ratio √χ²ᵣ [Birge 1932], and it is said."""
    if not options.likelihood:
        return endings, []
    freedom = readings.count - sum(e.structure.size for e in endings)
    chi2 = 2.0 * sum(float(e.total.cost) for e in endings) / max(freedom, 1)
    if chi2 <= 1.0 + 5.0 * np.sqrt(2.0 / max(freedom, 1)):
        return endings, []
    grown = [
        dataclasses.replace(e, covariance=e.covariance.scaled(chi2, e.domains, e.p), reach=e.reach * np.sqrt(chi2))
        for e in endings
    ]
    return grown, [
        f"the residuals exceed the known noise (reduced χ² {chi2:.3g}): the model leaves something out; the standard "
        f"uncertainties are widened by {np.sqrt(chi2):.3g} and still hold for noise only"
    ]


def _reason(endings) -> str:
    said = []
    for e in endings:
        if not np.isfinite(float(e.total.cost)):
            said.append("the cost is not finite")
        elif e.exact:
            said.append("exact: the residual is rounding")
        elif e.stationarity <= e.limit:
            said.append("stationary" if is_double() else f"stationary to {e.limit:.1g}, which single precision allows")
        else:
            said.append(f"not stationary: the projected gradient is {e.stationarity:.1e}, above {e.limit:.1g}")
    return "; ".join(dict.fromkeys(said))


def _unnamed(estimates: list[ParameterEstimate], said: list[str]) -> list[str]:
    """A sentence for the undetermined numbers that those `said` pass over: their shares of open combinations are small
    beside another's, but not beside what is known of them.
    """
    every = "\n".join(said)

    def named(p: ParameterEstimate) -> bool:
        one, all_channels = re.escape(p.label), re.escape(f"{p.name} (every channel)")
        return re.search(rf"(?<![\w.])(?:{one}(?![\w\[(]| \(every)|{all_channels})", every) is not None

    left = [p for p in estimates if p.status == "undetermined" and not named(p)]
    if not left:
        return []
    each = [f"{p.label} (95 % interval {p.interval95[0]:.3g} to {p.interval95[1]:.3g})" for p in left]
    return [f"{' and '.join(each)} {'is' if len(each) == 1 else 'are'} not determined by these readings either"]


def _bic(endings, cost: float, count: int, free: int, options) -> float:
    """Schwarz's criterion [Schwarz 1978], up to what models on the same readings share; lower is better."""
    if options.likelihood:
        return 2.0 * cost - 2.0 * sum(e.log_weight for e in endings) + free * np.log(count)
    least = sum(e.target_norm_squared for e in endings) * (1e3 * eps()) ** 2
    return float(count * np.log(max(2.0 * cost, least, 1e-300) / count) + free * np.log(count))


def _estimates(e, channels: Channels, of_channel: str | None) -> list[ParameterEstimate]:
    s, d = e.structure, domains_of(e.structure)
    infos = [g.info for g in s.groups for _ in range(s.channels if g.per_channel else 1)]
    found = []
    for k, (name, c) in enumerate(labels(s)):
        value, u = float(e.p[k]), float(e.covariance.standard[k])
        u = max(u, float(np.finfo(float).eps) * abs(value)) if np.isfinite(u) else u
        low, high = float(d.low[k]), float(d.high[k])
        if e.pinned[k]:
            status = "at lower bound" if value - low <= high - value else "at upper bound"
        else:
            lost = e.covariance.undetermined[k] or not np.isfinite(u)
            status = "undetermined" if lost else "determined"
        interval = (
            (max(low, value - NORMAL_95 * u), min(high, value + NORMAL_95 * u)) if np.isfinite(u) else (low, high)
        )
        interval = e.profile.get(k, interval)
        if e.pinned[k]:
            inside = e.reach[k] if np.isfinite(e.reach[k]) else high - low
            lower = status == "at lower bound"
            interval = (value, min(high, value + inside)) if lower else (max(low, value - inside), value)
        channel = of_channel or (None if c is None else channels.names[c])
        found.append(ParameterEstimate(name, channel, value, u, interval, status, infos[k].unit, low, high))
    return found


def _held(terms: tuple[Term, ...], e, channels: Channels) -> list[ParameterEstimate]:
    found = []
    for index, term in enumerate(terms):
        for n in numbers(term):
            if n.path not in e.fixed[index]:
                continue
            values = np.atleast_1d(np.asarray(n.value.number, float))
            name, info = label(e.structure, index, n.path), n.info
            for c, value in enumerate(values):
                channel = channels.names[c] if values.size > 1 else None
                nothing = (float(value), float(value))
                high = np.inf if last(n.path) == FACTOR else info.high
                found.append(
                    ParameterEstimate(name, channel, float(value), 0.0, nothing, "fixed", info.unit, info.low, high)
                )
    return found


def _block_diagonal(blocks: list[np.ndarray]) -> np.ndarray:
    sizes = [b.shape[0] for b in blocks]
    whole, at = np.zeros((sum(sizes), sum(sizes))), 0
    for b, n in zip(blocks, sizes, strict=True):
        whole[at : at + n, at : at + n] = b
        at += n
    return whole


def _filled(terms: tuple[Term, ...], endings) -> tuple[Term, ...]:
    """The terms with every free number in its place: one for all channels, or a list."""
    found: dict[tuple[int, str], Value] = {}
    for g in endings[0].structure.groups:
        parts = [e.p[g.first : g.first + (e.structure.channels if g.per_channel else 1)] for e in endings]
        n = np.concatenate(parts)
        found[g.term, g.name] = Value(tuple(n.tolist()) if n.size > 1 else float(n[0]))
    return tuple(changed(t, lambda path, v, i=i: found.get((i, path), v)) for i, t in enumerate(terms))

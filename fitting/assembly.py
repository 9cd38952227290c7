"""From the optima of a fit to its result: uncertainties, quality, notes."""

import dataclasses
import functools
from typing import Any

import numpy as np

from gonio.data.table import Channels
from gonio.fitting.apertures import aperture_facts
from gonio.fitting.fit_model import FitTask
from gonio.fitting.judgement import ALBEDO_TOLERANCE
from gonio.fitting.problem.parameterisation import of_channel
from gonio.fitting.problem.readings import evenly_spaced, transform_slope, transformed, uses_cosine
from gonio.fitting.residuals.energy import LargestAlbedo, bounded_largest_albedo, confirmed, largest_albedo
from gonio.fitting.residuals.metrics import metrics
from gonio.fitting.residuals.summary import Evidence
from gonio.fitting.result import FitResult
from gonio.fitting.solver.lm_step import eps, is_double
from gonio.fitting.uncertainty.bootstrap import bootstrap, bootstrap_summary
from gonio.fitting.uncertainty.clusters import with_clusters
from gonio.fitting.uncertainty.identifiability import MOST_ALIKE, listed, undetermined_sentences
from gonio.fitting.uncertainty.optimum import Optimum, ParameterEstimate
from gonio.fitting.uncertainty.profile_likelihood import with_profiles
from gonio.fitting.uncertainty.rounding import with_rounding
from gonio.fitting.uncertainty.scatter_pattern import with_scatter_pattern
from gonio.models.brdf import AbstractBRDF
from gonio.models.catalog import MODELS
from gonio.models.evaluation import channel_count
from gonio.models.expression.builder import build, number_label, to_expression
from gonio.models.expression.parser import FACTOR, Term, Value, calls, numbers
from gonio.models.geometry.sides import Hemispheres

FEW_CHANNELS = 4  # whose albedos are all computed to a bound
MOST_COMPARED = 1 << 18  # readings that are compared with a diffuser
NOTHING_FREE = (
    "nothing was fitted: all numbers of the model are given, and the readings are compared with it as it is; write "
    "name=? in place of a number to fit it"
)
BRUSHED_CHANNELS = 32  # the same of brushed lobes, whose brightest channel a rough sum may mistake


def assemble_result(task: FitTask, optima: list[Optimum], seconds: dict[str, float]) -> FitResult:
    """The result of one joint optimum, or of one optimum for each channel."""
    settings, readings, channels = task.settings, task.readings, task.channels
    optima, notes = _beyond_noise(task, *_widened(task, optima))
    optima = [with_profiles(e, vague) if (vague := e.vague_numbers()) else e for e in optima]
    only = [None] if len(optima) == 1 else list(channels.names)
    estimates = [e.estimates(channels, name) for e, name in zip(optima, only, strict=True)]
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
    f = _joined([e.model_f for e in optima])
    apertures = aperture_facts(optima, estimates)
    brdf = build(fitted := _fitted_terms(task, optima))
    measures = metrics(f, readings)
    measures["unexplained"] = _unexplained(optima)
    measures["largest_albedo"] = (albedo := _largest_albedo(optima, fitted, brdf)).value
    if albedo.value > 1.0 + ALBEDO_TOLERANCE:
        notes.insert(0, _creates_energy(albedo, channels, Hemispheres.TRANSMISSION in brdf.hemispheres))
    if task.likelihood:
        measures["reduced_chi2"] = 2.0 * cost / max(readings.count - len(free), 1)
    return FitResult(
        expression=to_expression(brdf), requested=task.requested, brdf=brdf, channels=channels,
        parameters=free + _fixed(task.terms, optima[0], channels), free_names=labels,
        uncertainty=[e.covariance for e in optima], converged=all(e.converged for e in optima),
        reason=_reason(optima), stationarity=max(e.projected_gradient for e in optima),
        exact=all(e.exact for e in optima), loss=task.loss, weight=task.weight, cost=cost, metrics=measures,
        samples=readings.count, cells=readings.f.shape[0],
        negative_readings=readings.negative,
        starts=sum(e.starts for e in optima), starts_agreed=sum(e.agreed for e in optima),
        bic=_bic(task, optima, cost, len(free)),
        undetermined=_undetermined(optima, estimates),
        active_bounds=[p.label for p in free if p.status.startswith("at ")], seconds=seconds,
        theta_max=settings.theta_max, table=task.table, counts=task.counts,
        notes=[*notes, *sorted({n for e in optima for n in e.notes}), *_model_notes(task.terms, brdf, labels)],
        floor=[e.problem.floor for e in optima], robust=settings.robust,
        apertures=apertures, evidence=_evidence(task, optima, f, cost), bootstrap=_bootstrap(task, optima, labels),
    )  # fmt: skip


def _fitted_terms(task: FitTask, optima: list[Optimum]) -> tuple[Term, ...]:
    """Filled terms of as many channels as the table: of grey ones the first scale is written once for each."""
    parameters, count = optima[0].parameters, len(task.channels)
    terms = parameters.filled(task.terms, [e.p for e in optima])
    # What was fitted to each channel has channels: to count those of a model traces it, as long as a small fit takes.
    of_channels = any(g.per_channel or len(optima) > 1 for g in parameters.free)
    if count == 1 or of_channels or channel_count(build(terms)) not in (None, 1):
        return terms
    first, *others = terms
    scale = 1.0 if first.scale is None or first.scale.number is None else float(np.ravel(first.scale.number)[0])
    return (dataclasses.replace(first, scale=Value((scale,) * count)), *others)


def _model_notes(terms: tuple[Term, ...], brdf: AbstractBRDF, labels: list[str]) -> list[str]:
    """Where the model leaves what it is made for, and what of it was not fitted: its labels name what was."""
    notes = list(brdf.validity_notes) if labels else [NOTHING_FREE, *brdf.validity_notes]
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
    """Σr² over that of the best Lambertian of each channel: the share of what there is to explain that is left.

    From at most `MOST_COMPARED` readings: of more, evenly spaced channels.
    """
    remaining = total = 0.0
    for e in optima:
        n, number = e.model_f.shape
        channels = evenly_spaced(number, max(1, MOST_COMPARED // n))
        some = slice(None) if channels.size == number else channels
        loss, floor, targets = e.problem.loss, e.problem.floor, e.problem.targets
        # Where no cosine is compared, neither is one multiplied, and a Lambertian has one level.
        cosines = e.readings.cos_i if uses_cosine(loss) else None
        shares = np.zeros((2, channels.size))
        for rows in e.readings.chunks(channels.size):
            weight, cosine = e.problem.weight[rows, some], 1.0 if cosines is None else cosines[rows, None]
            y = np.where(weight > 0, e.readings.f[rows, some], 0.0)
            with np.errstate(all="ignore"):
                share = np.nan_to_num((weight * transform_slope(loss, y * cosine, floor) * cosine) ** 2, posinf=0.0)
            shares += np.sum(share * y, axis=0), np.sum(share, axis=0)
        mean = shares[0] / np.maximum(shares[1], 1e-300)
        for rows in e.readings.chunks(channels.size):
            weight, target = e.problem.weight[rows, some], targets[rows, some]
            cosine = 1.0 if cosines is None else cosines[rows, None]
            level = transformed(loss, mean * cosine, floor)
            total += float(np.sum(np.where(weight > 0, weight * (level - target), 0.0) ** 2))
            if channels.size < number:
                model = transformed(loss, e.model_f[rows, some] * cosine, floor)
                remaining += float(np.sum(np.where(weight > 0, weight * (model - target), 0.0) ** 2))
        if channels.size == number:
            remaining += 2.0 * e.cost
    return remaining / total if total > 0 else float("nan")


def _largest_albedo(optima: list[Optimum], fitted: tuple[Term, ...], brdf: AbstractBRDF) -> LargestAlbedo:
    if Hemispheres.TRANSMISSION in brdf.hemispheres:
        return bounded_largest_albedo(brdf)
    each = [
        largest_albedo(functools.partial(e.problem.values_at, e.p), e.parameters.channels, brdf.isotropic)
        for e in optima
    ]
    channel = int(np.argmax([a.value for a in each]))
    worst = each[channel] if len(each) == 1 else each[channel]._replace(channel=channel)
    count = max(len(each), optima[0].parameters.channels)
    if count <= FEW_CHANNELS or (count <= BRUSHED_CHANNELS and not brdf.isotropic):
        return confirmed(worst, brdf)
    return confirmed(worst, build(of_channel(fitted, worst.channel)))._replace(channel=worst.channel)


def _creates_energy(a: LargestAlbedo, channels: Channels, transmits: bool) -> str:
    channel = f" in channel {channels.names[a.channel]}" if len(channels) > 1 and a.channel < len(channels) else ""
    return (
        f"the fitted model reflects {'and transmits ' * transmits}more than it receives: {a.value:.3f} of the light at "
        f"θi {np.degrees(a.theta_i):.0f}°{channel}; do not use it where energy counts"
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
        task.readings, f, _joined([e.problem.weight for e in optima]), task.loss,
        np.array([e.problem.floor for e in optima]), task.likelihood, all(e.exact for e in optima),
        sum(e.p.size for e in optima), 2.0 * cost if task.likelihood else None, robust, task.layout,
        task.settings.seed,
    )  # fmt: skip


def _joined(of_channels: list[np.ndarray]) -> np.ndarray:
    """Columns (n, C) of each optimum side by side; no copy of a single one."""
    return of_channels[0] if len(of_channels) == 1 else np.concatenate(of_channels, axis=1)


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


def _beyond_noise(task: FitTask, optima: list[Optimum], notes: list[str]) -> tuple[list[Optimum], list[str]]:
    """Uncertainties that hold what neighbouring readings share, and what rounding moves, with notes."""
    seed = task.settings.seed
    patterned = [with_scatter_pattern(e, seed) if task.likelihood else (e, None) for e in optima]
    clustered = [with_clusters(e, seed, task.likelihood) for e, _ in patterned]
    rounded = [with_rounding(e, task.likelihood) for e, _ in clustered]
    more = dict.fromkeys(note for _, note in [*patterned, *clustered, *rounded] if note)
    return [e for e, _ in rounded], [*notes, *more]


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

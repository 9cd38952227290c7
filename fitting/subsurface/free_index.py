"""A profile's fit with the index of the material free: by the profile likelihood over it, which says what is open."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.fitting.subsurface.result import ProfileFit
from gonio.fitting.uncertainty.covariance import NORMAL_95
from gonio.fitting.uncertainty.optimum import ParameterEstimate

LOW, HIGH = 1.0, 2.0
"""Of the indices that are tried: matched to the outside, to that of the densest glasses."""
NODES, HALVINGS = 11, 12
DELTA = NORMAL_95**2
"""Rise of Σr², in units of the noise's variance, at the ends of a 95 % interval of one number."""


def fit_with_free_index(
    fitted_at: Callable[[float], ProfileFit], followed_at: Callable[[float], ProfileFit]
) -> ProfileFit:
    """The best of the fits at given indices, whose intervals hold what the index leaves open.

    All channels have one index. Its interval is where Σr² rises by no more than `DELTA` noise variances, the noise
    being the stored one, or what the best fit leaves where that is more or nothing is stored.

    Args:
        fitted_at: the fit of σa and σs' with a given index.
        followed_at: the same with intervals that follow the cost where it is no parabola.
    """
    known = {float(eta): fitted_at(float(eta)) for eta in np.linspace(LOW, HIGH, NODES)}

    def cost(eta: float) -> float:
        if eta not in known:
            known[eta] = fitted_at(eta)
        return known[eta].cost

    _descended(cost, sorted(known))
    best = min(known, key=cost)
    limit = cost(best) + DELTA * _variance(known[best])
    low, high = (_end(cost, known, best, way, limit) for way in (-1, 1))
    inside = [eta for eta, fit in known.items() if low <= eta <= high and fit.cost <= limit * (1 + 1e-9)] or [best]
    known |= {eta: followed_at(eta) for eta in {best, min(inside), max(inside)}}
    return _widened(known[best], [known[eta] for eta in inside], (best, low, high))


def _descended(cost: Callable[[float], float], nodes: list[float]) -> None:
    """Evaluates the cost between the two nodes about the best one, ever closer (golden section)."""
    k = int(np.argmin([cost(eta) for eta in nodes]))
    a, b = nodes[max(k - 1, 0)], nodes[min(k + 1, len(nodes) - 1)]
    ratio = (math.sqrt(5) - 1) / 2
    for _ in range(HALVINGS):
        c, d = b - ratio * (b - a), a + ratio * (b - a)
        a, b = (a, d) if cost(c) < cost(d) else (c, b)


def _variance(fit: ProfileFit) -> float:
    """Variance of the noise in units of the weights'; channels that err together are fewer."""
    numbers = sum(p.status != "fixed" for p in fit.parameters) + 1
    spread = fit.cost / max(fit.samples - numbers, 1)
    together = fit.residuals["noisiness"]["channel_effect"]
    return together * (max(1.0, spread) if fit.noise_stated else spread)


def _end(cost: Callable[[float], float], known: dict[float, ProfileFit], best: float, way: int, limit: float) -> float:
    """Where the cost passes a limit on one side of the best index; the end of the domain where it does not."""
    beyond = [eta for eta in known if way * (eta - best) > 0 and cost(eta) > limit]
    if not beyond:
        return HIGH if way > 0 else LOW
    outside = min(beyond, key=lambda eta: abs(eta - best))
    inside = max((eta for eta in known if way * (outside - eta) > 0 and cost(eta) <= limit), key=lambda eta: way * eta)
    for _ in range(HALVINGS):
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if cost(middle) <= limit else (inside, middle)
    return inside


def _widened(fit: ProfileFit, inside: list[ProfileFit], index: tuple[float, float, float]) -> ProfileFit:
    """The fit with the intervals of all that the index leaves possible, and the index as a number of its own."""
    best, low, high = index
    open_ended = low <= LOW and high >= HIGH
    parameters = []
    for k, p in enumerate(fit.parameters):
        if p.name.endswith(".eta"):
            status = "undetermined" if open_ended else "determined"
            if not open_ended and (low <= LOW or high >= HIGH):
                status = "at lower bound" if best <= LOW else "at upper bound" if best >= HIGH else status
            u = (high - low) / (2 * NORMAL_95)
            parameters.append(
                dataclasses.replace(p, value=best, standard_uncertainty=u, interval95=(low, high), status=status)
            )
        else:
            parameters.append(_over(p, [other.parameters[k] for other in inside]))
    sentences = list(fit.undetermined)
    if open_ended:
        ranges = "; ".join(
            f"{p.label} is from {p.interval95[0]:.4g} to {p.interval95[1]:.4g} {p.unit}"
            for p in parameters
            if not p.name.endswith(".eta") and p.status != "fixed"
        )
        sentences.append(
            f"eta is not determined beside sigma_a and sigma_s: any from {LOW:g} to {HIGH:g} follows the profile; "
            f"over these {ranges}; give the index, such as eta=1.3"
        )
    covariance = _covariance(fit, inside, math.nan if open_ended else (high - low) / (2 * NORMAL_95))
    return dataclasses.replace(fit, parameters=parameters, undetermined=sentences, covariance_by_channel=covariance)


def _over(p: ParameterEstimate, same: list[ParameterEstimate]) -> ParameterEstimate:
    """A number with the interval of it over several fits."""
    if p.status == "fixed":
        return p
    values, ends = [q.value for q in same], [q.interval95 for q in same]
    spread = (max(values) - min(values)) / (2 * NORMAL_95)
    interval = min(a for a, _ in ends), max(b for _, b in ends)
    return dataclasses.replace(p, standard_uncertainty=math.hypot(p.standard_uncertainty, spread), interval95=interval)


def _covariance(fit: ProfileFit, inside: list[ProfileFit], u: float) -> list[dict[str, Any]]:
    """That of σa, σs and the index of each channel: at one index, and what the index's uncertainty u moves them by."""
    ends = [min(inside, key=_index), max(inside, key=_index)]
    step = _index(ends[1]) - _index(ends[0])
    made, start = [], 0
    for part in fit.covariance_by_channel:
        old = np.array(part["covariance"], float)
        # The numbers of a channel stand together, the index last
        places = [k for k, p in enumerate(fit.parameters) if p.status != "fixed"][start : start + len(old)]
        rows = [[end.parameters[k].value for k in places] for end in ends]
        slope = np.append((np.array(rows[1]) - rows[0]) / step if step else np.full(len(old), math.nan), 1.0)
        whole = np.outer(slope, slope) * u**2
        whole[:-1, :-1] += old
        first = start + len(made)
        made.append({"numbers": list(range(first, first + len(whole))), "covariance": whole.tolist()})
        start += len(old)
    return made


def _index(fit: ProfileFit) -> float:
    return next(p.value for p in fit.parameters if p.name.endswith(".eta"))

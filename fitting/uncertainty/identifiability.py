"""Sentences about numbers, and combinations of numbers, that the data leave open."""

import re

import numpy as np

from gonio.fitting.result import ParameterEstimate
from gonio.fitting.uncertainty.informative_directions import advice
from gonio.fitting.uncertainty.optimum import Optimum

SMALL = 0.1  # of the largest change, below which a number is no part of a combination
ALIKE = 0.1  # difference of two relative changes, or of an exponent from ±1, that words pass over


def undetermined_sentences(e: Optimum, estimates: list[ParameterEstimate]) -> list[str]:
    """What an optimum leaves open, and which readings would determine it; `estimates` of its free numbers in turn."""
    names = [p.label for p in estimates]
    sentences = [
        f"{describe_combination(variance, change, e.p, names, e.parameters.linear)}; {advice(e, k)}"
        for k, (variance, change) in enumerate(e.covariance.combinations)
    ]
    silent = e.covariance.undetermined & (np.diagonal(np.asarray(e.equations.matrix)) <= 0)
    sentences += [f"{names[k]} does not change the residuals at all" for k in np.flatnonzero(silent)]
    return sentences + unnamed_numbers(estimates, sentences)


def unnamed_numbers(estimates: list[ParameterEstimate], sentences: list[str]) -> list[str]:
    """A sentence for the undetermined numbers that other sentences pass over: their shares of open combinations are
    small beside another's, but not beside what is known of them.
    """
    every = "\n".join(sentences)

    def named(p: ParameterEstimate) -> bool:
        one, all_channels = re.escape(p.label), re.escape(f"{p.name} (every channel)")
        return re.search(rf"(?<![\w.])(?:{one}(?![\w\[(]| \(every)|{all_channels})", every) is not None

    rest = [p for p in estimates if p.status == "undetermined" and not named(p)]
    if not rest:
        return []
    each = [f"{p.label} (95 % interval {p.interval95[0]:.3g} to {p.interval95[1]:.3g})" for p in rest]
    return [f"{' and '.join(each)} {'is' if len(each) == 1 else 'are'} not determined by these readings either"]


def describe_combination(
    variance: float, change: np.ndarray, p: np.ndarray, names: list[str], linear: np.ndarray
) -> str:
    """What is determined and what is not, as one sentence without its end.

    Args:
        variance: of the combination, as in `Covariance.combinations`.
        change: the open combination (P,).
        p: the numbers (P,).
        names: of the numbers, such as ``ggx.scale[R]``.
        linear: which of them f is proportional to.
    """
    members = _members(change, p, names)
    first, *others = members
    if not others:
        return f"{first} is not determined by these readings"
    if len(others) == 1:
        (a, (rate_a, i)), (b, (rate_b, j)) = members.items()
        both = f"{a} and {b} are not"
        if linear[i] and linear[j]:
            ratio = -change[j] / change[i]
            if ratio > 0:
                # a F₁ + b F₂ stays as it is where F₂ = −F₁ δa/δb.
                factor = "" if abs(ratio - 1) < ALIKE else f"{1 / ratio:.2g} × "
                return f"only the combination {a} + {factor}{b} is determined by these readings: {both}"
        elif rate_a and rate_b:
            return f"only the combination {_power(a, b, -rate_a / rate_b)} is determined by these readings: {both}"
    lead = members[first][0] or 1.0
    rates = ", ".join(f"{n} by {members[n][0] / lead:+.3g} %" for n in others[:4])
    more = f" and {len(others) - 4} more" if len(others) > 4 else ""
    how = "nothing" if not np.isfinite(variance) else "less in the residuals than noise does"
    return (
        f"raising {first} by 1 % together with {rates}{more} changes {how}: only their combination is determined by "
        "these readings"
    )


def _members(change: np.ndarray, p: np.ndarray, names: list[str]) -> dict[str, tuple[float, int]]:
    """{name: (relative change, an index)}: channels that change alike are one member, largest change first."""
    rate = np.divide(change, np.abs(p), out=change.copy(), where=p != 0)
    size = np.abs(rate) / np.max(np.abs(rate))
    order = [k for k in np.argsort(-size, kind="stable") if size[k] > SMALL]
    groups: dict[str, list[int]] = {}
    for k in order:
        groups.setdefault(names[k].split("[")[0], []).append(k)
    members: dict[str, tuple[float, int]] = {}
    for base, members_at in groups.items():
        every = [k for k, n in enumerate(names) if n.split("[")[0] == base]
        if len(members_at) == len(every) > 1 and np.ptp(rate[members_at]) < ALIKE * np.max(np.abs(rate[members_at])):
            members[f"{base} (every channel)"] = (float(np.mean(rate[members_at])), members_at[0])
        else:
            members |= {names[k]: (float(rate[k]), k) for k in members_at}
    return members


def _power(a: str, b: str, exponent: float) -> str:
    """What stays while a rises by r_a and b by r_b: a·b^(−r_a/r_b)."""
    if abs(abs(exponent) - 1) < ALIKE:
        return f"{a}·{b}" if exponent > 0 else f"{a}/{b}"
    return f"{a}·{b}^{exponent:.2g}" if exponent > 0 else f"{a}/{b}^{-exponent:.2g}"

"""Combinations of numbers that the data leave open, in the words of whoever asked for them."""

import numpy as np

SMALL = 0.1  # of the largest change, below which a number is no part of a combination
ALIKE = 0.1  # difference of two relative changes, or of an exponent from ±1, that words pass over


def in_words(variance: float, change: np.ndarray, p: np.ndarray, names: list[str], linear: np.ndarray) -> str:
    """What is determined and what is not, as one sentence without its end.

    `change` (P,): the open combination; `variance` as in `Covariance.combinations`; `names` such as ``ggx.scale[R]``;
    `linear` (P,): numbers that f is proportional to.
    """
    members = _members(change, p, names)
    said = list(members)
    if len(said) == 1:
        return f"{said[0]} is not determined by these readings"
    if len(said) == 2:
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
    lead = members[said[0]][0] or 1.0
    others = ", ".join(f"{n} by {members[n][0] / lead:+.3g} %" for n in said[1:5])
    more = f" and {len(said) - 5} more" if len(said) > 5 else ""
    how = "nothing" if not np.isfinite(variance) else "less in the residuals than noise does"
    return (
        f"raising {said[0]} by 1 % together with {others}{more} changes {how}: only their combination is determined by "
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
    found: dict[str, tuple[float, int]] = {}
    for base, at in groups.items():
        every = [k for k, n in enumerate(names) if n.split("[")[0] == base]
        if len(at) == len(every) > 1 and np.ptp(rate[at]) < ALIKE * np.max(np.abs(rate[at])):
            found[f"{base} (every channel)"] = (float(np.mean(rate[at])), at[0])
        else:
            found |= {names[k]: (float(rate[k]), k) for k in at}
    return found


def _power(a: str, b: str, exponent: float) -> str:
    # What stays while a rises by r_a and b by r_b is a·b^(−r_a/r_b).
    if abs(abs(exponent) - 1) < ALIKE:
        return f"{a}·{b}" if exponent > 0 else f"{a}/{b}"
    return f"{a}·{b}^{exponent:.2g}" if exponent > 0 else f"{a}/{b}^{-exponent:.2g}"

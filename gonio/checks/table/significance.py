"""Readings that should be equal, tested pair by pair and region by region against their stored uncertainties.

Half of the level goes to the single pairs, half to the regions: in a band of polar angles a violation has a sign (the
larger value is on the same side), so that its mean shows where no single pair does. Beside each p-value stands the size
of the effect: the least violation that would explain it at that level, and the largest that is not excluded, both as
2|a−b|/(|a|+|b|). That tells what is significant but tiny from what is not significant but noisy.
"""

import dataclasses

import numpy as np

from gonio.checks.certificate import Property, verdict_of
from gonio.checks.model.reciprocity import spoken, where_of
from gonio.checks.table.count_statistics import (
    critical,
    decimal_step,
    deviates,
    difference_p,
    family_p,
    normal_p,
    quantum,
    sidak,
)
from gonio.checks.table.pairs import Pairs

LEVEL = 0.01
"""Chance that an honest table is called significantly wrong."""

BAND = 10.0
"""Width of a region, degrees of the larger polar angle."""

FEWEST_KNOWN = 0.5
"""Share of the pairs that must have stored uncertainties for them to decide."""

ROUNDING = 2 * float(np.finfo(np.float32).eps)


@dataclasses.dataclass(frozen=True)
class Tested:
    """What the family of tests found, all violations relative; rows are (pair, channel) tests or regions."""

    p_value: float
    tests: int
    regions: int
    where: dict
    where_p: float
    least: float
    """The least violation that explains the readings at the level; 0 where nothing is significant."""
    least_where: dict
    estimate: float
    """Of the region, or the significant pair, that leaves most open."""
    uncertain: float
    """Half of the width of its interval, at the level."""
    region: dict
    """Where that is: a region, or a single pair that is significant and leaves more open."""
    detectable: float
    """Median over the pairs of the violation that would show in a single pair."""
    channels: list
    """p-value of each channel, corrected for all its tests."""
    p_map: dict


def decided_by_uncertainty(pairs: Pairs) -> bool:
    """Whether the stored uncertainties of most pairs are known and not all zero."""
    found = np.isfinite(pairs.a) & np.isfinite(pairs.b)
    return bool(found.any() and np.mean(_usable(pairs)[found]) >= FEWEST_KNOWN)


def _usable(pairs):
    variance = pairs.u_a**2 + pairs.u_b**2
    return np.isfinite(pairs.a) & np.isfinite(pairs.b) & np.isfinite(variance) & (variance > 0)


def _quanta(pairs: Pairs) -> tuple[np.ndarray, np.ndarray]:
    n = len(pairs.a)
    q = np.zeros((2 * n, pairs.a.shape[1]))
    theta = np.concatenate([pairs.angles[:, 0], pairs.angles[:, 2]])
    for c in range(pairs.a.shape[1]):
        f, u = (np.concatenate([x[:, c], y[:, c]]) for x, y in ((pairs.a, pairs.b), (pairs.u_a, pairs.u_b)))
        ok = np.isfinite(f) & np.isfinite(u) & (u > 0)
        if ok.any():
            q[ok, c] = quantum(theta[ok], f[ok], u[ok])
    return q[:n], q[n:]


def tested(pairs: Pairs, sign: np.ndarray, level: float, error: float = 0.0) -> Tested:
    """Tests the family of all pairs and regions.

    `sign` (n,) says which way a violation would go in each pair (0: unknown). `error` is a relative error of the
    partner's value, allowed for in full.
    """
    ok = _usable(pairs)
    row, channel = np.nonzero(ok)
    a, b, u_a, u_b = (v[ok].astype(float) for v in (pairs.a, pairs.b, pairs.u_a, pairs.u_b))
    q_a, q_b = (q[ok] for q in _quanta(pairs))
    mean = np.maximum((np.abs(a) + np.abs(b)) / 2, 1e-300)
    sigma = np.hypot(u_a, u_b)
    # Two rounded readings differ by up to a whole step more.
    step = decimal_step(np.concatenate([a, b]))
    p = difference_p(a, b, u_a, u_b, q_a, q_b, (error + ROUNDING) * mean + step)
    several = pairs.a.shape[1] > 1
    tests = p.size

    threshold = sidak(level / 2, tests)
    z, limit = deviates(p), critical(threshold)
    over = np.maximum(np.abs(a - b) - error * mean - step, 0) / mean
    least = np.where(p < threshold, over * (1 - limit / np.maximum(z, limit)), 0.0)
    regions = _regions(pairs, sign, row, channel, (a - b) / sigma, mean / sigma, level / 2, error, step / sigma)
    k, r = int(np.argmin(p)), int(np.argmin(regions["p"])) if regions["p"].size else None
    p_pairs = float(family_p(p[k], tests))
    p_regions = float(family_p(regions["p"][r], regions["p"].size)) if r is not None else 1.0
    by_pair = p_pairs <= p_regions
    strongest, m = int(np.argmax(least)), int(np.argmax(regions["least"])) if r is not None else None
    pair_leads = m is None or least[strongest] >= regions["least"][m]

    def place(i):
        return where_of(pairs.angles[row[i]], int(channel[i]) if several else None)

    open_ = [_at_large((a - b) / sigma, float(np.median(sigma / mean)), critical(level))]
    if r is not None:
        w = int(np.argmax(np.abs(regions["estimate"]) + regions["half"]))
        open_ = [(float(abs(regions["estimate"][w])), float(regions["half"][w]), regions["where"][w])]
    if least[strongest] > 0:
        half = over * limit / np.maximum(z, limit)
        w = int(np.argmax(np.where(least > 0, over + half, -1.0)))
        open_.append((float(over[w]), float(half[w]), place(w)))
    estimate, uncertain, region = max(open_, key=lambda o: o[0] + o[1])

    return Tested(
        p_value=float(family_p(min(p_pairs, p_regions), 2)),
        tests=tests,
        regions=int(regions["p"].size),
        where=place(k) if by_pair else regions["where"][r],
        where_p=float(p[k]) if by_pair else float(regions["p"][r]),
        least=float(least[strongest] if pair_leads else regions["least"][m]),
        least_where=place(strongest) if pair_leads else regions["where"][m],
        estimate=estimate,
        uncertain=uncertain,
        region=region,
        detectable=float(np.median(limit * sigma / mean)),
        channels=_by_channel(p, channel, regions, pairs.a.shape[1]),
        p_map=_p_map(pairs, p, row),
    )


def _at_large(z, noise, limit):
    # Without signs: the root mean square violation that the mean of z² leaves, and its upper limit (normal in n).
    more = max(float(np.mean(z**2)) - 1, 0.0)
    highest = more + limit * np.sqrt(2 * (1 + 2 * more) / z.size)
    return noise * np.sqrt(more), noise * (np.sqrt(highest) - np.sqrt(more)), {}


def _band(pairs, row):
    return (np.degrees(np.maximum(pairs.angles[:, 0], pairs.angles[:, 2]))[row] / BAND + 1e-9).astype(int)


def _regions(pairs, sign, row, channel, z, brightness, level, error, step):
    # Mean of the signed standardised differences, and what it makes of the mean standardised value: all weights come
    # from the uncertainties, none from readings, so that no noise is in them.
    signed = sign[row] != 0
    key = _band(pairs, row)[signed] * 1000 + channel[signed]
    names, group = np.unique(key, return_inverse=True)
    count = np.bincount(group, minlength=names.size)
    enough = count >= 12
    total = np.bincount(group, sign[row][signed] * z[signed], minlength=names.size)
    bright, rounded = (np.bincount(group, v[signed], minlength=names.size) for v in (brightness, step))
    deviate = total / np.sqrt(np.maximum(count, 1))
    deviate, bright, rounded, count, names = (v[enough] for v in (deviate, bright, rounded, count, names))
    error = error + rounded / bright
    estimate, one = deviate * np.sqrt(count) / bright, np.sqrt(count) / bright
    estimate = np.sign(estimate) * np.maximum(np.abs(estimate) - error, 0)
    p = normal_p(estimate / one)
    limit = critical(sidak(level, max(p.size, 1)))
    several = pairs.a.shape[1] > 1
    where = [
        {"theta_from": float(n // 1000 * BAND), "theta_to": float((n // 1000 + 1) * BAND)}
        | ({"channel": int(n % 1000)} if several else {})
        for n in names
    ]
    return {
        "p": p,
        "estimate": estimate,
        "half": limit * one + error,
        "least": np.maximum(np.abs(estimate) - limit * one, 0.0),
        "where": where,
        "channel": names % 1000,
    }


def _by_channel(p, channel, regions, channels):
    found = []
    for c in range(channels):
        own, bands = p[channel == c], regions["p"][regions["channel"] == c]
        ps = [float(family_p(v.min(), v.size)) for v in (own, bands) if v.size]
        found.append(float(family_p(min(ps), len(ps))) if ps else None)
    return found


def _p_map(pairs, p, row):
    # The least p-value of each square of polar angles, corrected for the tests in it.
    squares = np.sort(np.floor(np.degrees(pairs.angles[:, [0, 2]])[row] / BAND + 1e-9), axis=1).astype(int)
    side = int(90 // BAND)
    key, smallest, count = squares[:, 0] * side + squares[:, 1], np.ones(side * side), np.zeros(side * side, int)
    np.minimum.at(smallest, key, p)
    np.add.at(count, key, 1)
    shown = np.where(count > 0, family_p(smallest, np.maximum(count, 1)), np.nan).reshape(side, side)
    shown = np.where(np.isfinite(shown), shown, shown.T)
    used = np.flatnonzero(np.isfinite(shown).any(axis=1))
    return {"theta_deg": [(i + 0.5) * BAND for i in used], "p": shown[np.ix_(used, used)].tolist()}


def judged_by_level(
    name: str, found: Tested, how: str, pairs: int, tolerance: float, level: float, what: str, facts: dict
) -> Property:
    """The property that a family of tests decides.

    fail: more than the tolerance is needed to explain the readings; pass: no region may differ by more; else undecided.
    """
    if found.least > tolerance:
        # Of the violation only its lower limit is claimed.
        residual, bound, where = found.least, 0.0, found.least_where
    else:
        residual, bound, where = found.estimate, found.uncertain, found.region
    significant = found.p_value < level
    verdict = verdict_of(residual, bound, tolerance)
    facts |= {
        "level": level,
        "p_value": found.p_value,
        "significant": significant,
        "tests": found.tests,
        "regions": found.regions,
        "least_violation": found.least,
        "largest_violation": max(found.estimate + found.uncertain, found.least),
        "detectable_in_one_pair": found.detectable,
        "p_value_by_channel": found.channels,
        "strongest_at": found.where,
        "strongest_p": found.where_p,
    }
    differ = f"{what} over {pairs:,} {how}, below 70°"
    if significant:
        size = f"a violation of at least {found.least:.2%} is needed to explain it"
        detail = (
            f"{differ}, differ by more than their uncertainties allow: {_p(found.p_value)} of a family of"
            f" {found.tests + found.regions:,} tests (level {level:g}), strongest at {_spoken(found.where)}; {size}"
            f" ({_spoken(found.least_where)})."
        )
    else:
        detail = (
            f"{differ}, differ by no more than their uncertainties explain: {_p(found.p_value)} of a family of"
            f" {found.tests + found.regions:,} tests (level {level:g}); a single pair would show"
            f" {found.detectable:.2g} at the median."
        )
    if verdict == "pass":
        detail += f" No region of it differs by more than {found.estimate + found.uncertain:.2%}."
        if significant:
            detail += " That is significant, and within the tolerance."
    elif verdict == "undecided":
        detail += (
            f" In {_spoken(found.region)} up to {found.estimate + found.uncertain:.2%} is not excluded: too noisy to"
            f" say that it is within {tolerance:.2%}."
            if found.least <= tolerance and not significant
            else f" Whether it exceeds the tolerance of {tolerance:.2%} the noise leaves open (up to"
            f" {found.estimate + found.uncertain:.2%})."
        )
    return Property(name, verdict, residual, bound, tolerance, where, detail, facts, {"p_map": found.p_map})


def _p(p: float) -> str:
    return f"p = {p:.2g}" if p > 1e-99 else "p < 1e-99"


def _spoken(where: dict) -> str:
    if not where:
        return "the whole of it"
    if "theta_from" not in where:
        return spoken(where)
    channel = f", channel {where['channel']}" if "channel" in where else ""
    return f"the band of {where['theta_from']:g}–{where['theta_to']:g}°{channel}"

"""Readings that should be equal, tested pair by pair and region by region against their stored uncertainties.

Half of the level goes to the single pairs, half to the regions: in a region a violation has a sign (the
larger value is on the same side), so that its mean shows where no single pair does. Beside each p-value stands the size
of the effect: the least violation that would explain it at that level, and the largest that is not excluded, both as
2|a−b|/(|a|+|b|). That separates what is significant but tiny from what is not significant but noisy.
"""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from gonio.checks.certificate import PASS, UNDECIDED, Property, place_of, verdict_of
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.pairs.equal_pairs import BAND, SIDE, Pairs, bands
from gonio.checks.table.regions import region_in_words, region_place, regions_of
from gonio.checks.table.statistics.counts import (
    critical,
    decimal_step,
    deviates,
    difference_p,
    family_p,
    quantum,
    sidak,
    sum_p,
)
from gonio.models.display import percent

FEWEST_KNOWN = 0.5
"""Share of the pairs that must have stored uncertainties for them to decide."""

DARK = 2.0
"""Relative difference of a reading and of one that is dark."""

ROUNDING = 2 * float(np.finfo(np.float32).eps)


def decided_by_uncertainty(pairs: Pairs) -> bool:
    """Whether the stored uncertainties of most pairs are known and not all zero; where nothing was met they may be."""
    dark = (pairs.a == 0) & (pairs.b == 0) & (pairs.u_a == 0) & (pairs.u_b == 0)
    comparable = np.isfinite(pairs.a) & np.isfinite(pairs.b) & ~dark
    return bool(comparable.any() and np.mean(_usable(pairs)[comparable]) >= FEWEST_KNOWN)


def _usable(pairs: Pairs) -> np.ndarray:
    variance = pairs.u_a**2 + pairs.u_b**2
    return np.isfinite(pairs.a) & np.isfinite(pairs.b) & np.isfinite(variance) & (variance > 0)


class _Rows(NamedTuple):
    """The readings of pairs that can be tested, row by row of (pair, channel)."""

    a: np.ndarray
    b: np.ndarray
    u_a: np.ndarray
    u_b: np.ndarray
    q_a: np.ndarray
    """What one count adds to the reading, 1/sr."""
    q_b: np.ndarray
    pair: np.ndarray
    channel: np.ndarray
    angles: np.ndarray
    error: np.ndarray
    """Relative error of b."""

    @property
    def mean(self) -> np.ndarray:
        return np.maximum((np.abs(self.a) + np.abs(self.b)) / 2, 1e-300)

    @property
    def sigma(self) -> np.ndarray:
        return np.hypot(self.u_a, self.u_b)


def _rows(pairs: Pairs) -> _Rows:
    usable = _usable(pairs)
    pair, channel = np.nonzero(usable)
    a, b, u_a, u_b = (v[usable].astype(float) for v in (pairs.a, pairs.b, pairs.u_a, pairs.u_b))
    q_a, q_b = _count_sizes(pairs)
    error = np.broadcast_to(np.asarray(pairs.error, float), pairs.a.shape)
    return _Rows(a, b, u_a, u_b, q_a[usable], q_b[usable], pair, channel, pairs.angles[pair], error[usable])


def _count_sizes(pairs: Pairs) -> tuple[np.ndarray, np.ndarray]:
    n = len(pairs.a)
    q = np.zeros((2 * n, pairs.a.shape[1]))
    theta_i, theta_o = np.concatenate(pairs.theta_i), np.concatenate(pairs.theta_o)
    # Each pair of sides by itself: between media what goes through is scaled.
    sides = 2 * (theta_i > np.pi / 2) + (theta_o > np.pi / 2)
    for c in range(q.shape[1]):
        f, u = (np.concatenate([x[:, c], y[:, c]]) for x, y in ((pairs.a, pairs.b), (pairs.u_a, pairs.u_b)))
        ok = np.isfinite(f) & np.isfinite(u) & (u > 0)
        if ok.any():
            q[ok, c] = quantum(theta_i[ok], f[ok], u[ok], sides[ok])
    return q[:n], q[n:]


class _Violation(NamedTuple):
    """An estimate of a relative violation, half of the width of its interval at the level, and its place."""

    estimate: float
    half: float
    where: dict[str, Any]

    @property
    def largest(self) -> float:
        return _at_most(self.estimate + self.half, self.estimate)


def _at_most(violation: float, estimate: float) -> float:
    """A violation without what no readings of light can differ by: no more than one of them being dark."""
    return min(violation, max(DARK, estimate))


@dataclasses.dataclass(frozen=True)
class _Tests:
    """Tests of single pairs, or of regions, (n,): p-values and relative violations, with the places."""

    p: np.ndarray
    estimate: np.ndarray
    half: np.ndarray
    """Half of the width of the interval of the violation, at the level."""
    least: np.ndarray
    """The least violation that explains the readings at the level; 0 where none is needed."""
    channel: np.ndarray
    place: np.ndarray | list[dict[str, Any]]
    """(n, 4) angles, radians, of pairs, or what a certificate calls the regions."""
    evidence: TableEvidence
    family: float
    """The p-value of all of them together."""

    def where(self, k: int) -> dict[str, Any]:
        if isinstance(self.place, list):
            return self.place[k]
        return place_of(self.place[k], self.evidence.channel(int(self.channel[k])))

    def violation(self, k: np.intp) -> _Violation:
        return _Violation(float(abs(self.estimate[k])), float(self.half[k]), self.where(int(k)))


def _tests_of_pairs(rows: _Rows, step: float, level: float, evidence: TableEvidence) -> _Tests:
    mean = rows.mean
    p = difference_p(*rows[:6], (rows.error + ROUNDING) * mean + step)
    p = np.where(rows.error > 0, 1.0, p)  # one interpolated partner proves nothing
    threshold = sidak(level, p.size)
    z, limit = deviates(p), critical(threshold)
    over = np.maximum(np.abs(rows.a - rows.b) - rows.error * mean - step, 0) / mean
    share = limit / np.maximum(z, limit)
    least = np.where(p < threshold, over * (1 - share), 0.0)
    family = float(family_p(p.min(), p.size))
    return _Tests(p, over, over * share, least, rows.channel, rows.angles, evidence, family)


def _tests_of_regions(rows: _Rows, sign: np.ndarray, step: float, level: float, evidence: TableEvidence) -> _Tests:
    # Mean of the signed standardised differences, and what it makes of the mean standardised value: all weights come
    # from the uncertainties, none from readings, so that no noise is in them.
    sign = sign[rows.pair]
    sigma = rows.sigma
    z, bright, uncertain = sign * (rows.a - rows.b) / sigma, rows.mean / sigma, rows.error * rows.mean
    up, down = _by_sign(rows, sign)
    estimates, channels, where, ps = [], [], [], []
    for channel in np.unique(rows.channel):
        of_channel = np.flatnonzero((rows.channel == channel) & (sign != 0))
        for size, number, some in regions_of(rows.angles[of_channel]):
            group = of_channel[some]
            weight = bright[group].sum()
            error = float(np.sum((uncertain[group] + step) / sigma[group]) / weight)
            total, root = float(z[group].sum()), float(np.sqrt(group.size))
            estimates.append((total / weight, root / weight, error))
            beyond = np.sign(total) * max(abs(total) - error * weight, 0.0) / root
            ps.append(sum_p(beyond, _some(up, group), _some(down, group)))
            channels.append(channel)
            where.append(region_place(size, number, evidence.channel(int(channel))))
    estimate, one, error = np.array(estimates).reshape(-1, 3).T
    estimate = np.sign(estimate) * np.maximum(np.abs(estimate) - error, 0)
    p, threshold = np.array(ps), sidak(level, len(ps))
    limit = critical(threshold)
    half = np.maximum(limit * one, np.abs(estimate) * np.minimum(limit / np.maximum(deviates(p), 1e-9), 1.0))
    least = np.maximum(np.abs(estimate) - half, 0.0)
    family = float(family_p(p.min(), p.size)) if p.size else 1.0
    return _Tests(p, estimate, half + error, least, np.array(channels, int), where, evidence, family)


_Side = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Readings, their uncertainties and the sizes of a count, (n,) each."""


def _by_sign(rows: _Rows, sign: np.ndarray) -> tuple[_Side, _Side]:
    """The readings that a violation makes larger, and the others."""
    b_larger = sign < 0

    def side(first: _Side, other: _Side) -> _Side:
        f, u, q = (np.where(b_larger, y, x) for x, y in zip(first, other, strict=True))
        return f, u, q

    a, b = (rows.a, rows.u_a, rows.q_a), (rows.b, rows.u_b, rows.q_b)
    return side(a, b), side(b, a)


def _some(side: _Side, group: np.ndarray) -> _Side:
    f, u, q = side
    return f[group], u[group], q[group]


def _everywhere(rows: _Rows, level: float) -> _Violation:
    # Without signs: the root mean square violation that the mean of z² leaves, and its upper limit (normal in n).
    z, noise = (rows.a - rows.b) / rows.sigma, float(np.median(rows.sigma / rows.mean))
    more = max(float(np.mean(z**2)) - 1, 0.0)
    highest = more + critical(level) * np.sqrt(2 * (1 + 2 * more) / z.size)
    return _Violation(noise * np.sqrt(more), noise * (np.sqrt(highest) - np.sqrt(more)), {})


def judged_by_level(
    name: str, evidence: TableEvidence, pairs: Pairs, sign: np.ndarray, tolerance: float, what: str
) -> Property:
    """The property that a family of tests of all pairs and regions decides at the level of the evidence.

    fail: more than the tolerance is needed to explain the readings; pass: no region may differ by more; else undecided.
    `sign` (n,) is that of a violation in each pair (0: unknown).
    """
    level, rows = evidence.level, _rows(pairs)
    # Two rounded readings differ by up to a whole step more.
    step = decimal_step(np.concatenate([rows.a, rows.b]))
    single = _tests_of_pairs(rows, step, level / 2, evidence)
    regions = _tests_of_regions(rows, sign, step, level / 2, evidence)
    kinds = [single, regions] if regions.p.size else [single]
    strongest = min(kinds, key=lambda tests: tests.family)
    leading = max(kinds, key=lambda tests: tests.least.max())
    least, least_where = float(leading.least.max()), leading.where(int(np.argmax(leading.least)))
    widest = (
        regions.violation(np.argmax(np.abs(regions.estimate) + regions.half))
        if regions.p.size
        else _everywhere(rows, level)
    )
    if single.least.max() > 0:
        k = np.argmax(np.where(single.least > 0, single.estimate + single.half, -1.0))
        widest = max(widest, single.violation(k), key=lambda violation: violation.largest)
    if least > tolerance:
        # Of the violation only its lower limit is claimed.
        residual, bound, where = least, 0.0, least_where
    else:
        residual, where = widest.estimate, widest.where
        bound = max(widest.largest - residual, residual - least)  # no more is claimed than the tests together need
    k, p_value = int(np.argmin(strongest.p)), float(family_p(strongest.family, 2))
    facts = {
        "level": level,
        "p_value": p_value,
        "significant": p_value < level,
        "tests": single.p.size,
        "regions": regions.p.size,
        "least_violation": least,
        "largest_violation": max(widest.largest, least),
        "detectable_in_one_pair": float(np.median(critical(sidak(level / 2, single.p.size)) * rows.sigma / rows.mean)),
        "p_value_by_channel": [_of_channel(c, kinds) for c in range(pairs.a.shape[1])],
        "strongest_at": strongest.where(k),
        "strongest_p": float(strongest.p[k]),
    }
    verdict = verdict_of(residual, bound, tolerance)
    differ = f"{what} over {int(np.isfinite(pairs.a + pairs.b).any(axis=1).sum()):,} pairs ({pairs.how})"
    detail = f"{differ} {_statement(facts, least_where)}{_reason(verdict, facts, widest, tolerance)}"
    return Property(name, verdict, residual, bound, tolerance, where, detail, facts, {"p_map": _p_map(single)})


def _of_channel(channel: int, kinds: list[_Tests]) -> float | None:
    of_channel = [tests.p[tests.channel == channel] for tests in kinds]
    ps = [float(family_p(p.min(), p.size)) for p in of_channel if p.size]
    return float(family_p(min(ps), len(ps))) if ps else None


def _p_map(single: _Tests) -> dict[str, list]:
    # The least p-value of each square of polar angles, corrected for the tests in it.
    angles = np.asarray(single.place)
    squares, side = bands(angles), SIDE
    key, smallest, count = squares[:, 0] * side + squares[:, 1], np.ones(side * side), np.zeros(side * side, int)
    np.minimum.at(smallest, key, single.p)
    np.add.at(count, key, 1)
    shown = np.where(count > 0, family_p(smallest, np.maximum(count, 1)), np.nan).reshape(side, side)
    shown = np.where(np.isfinite(shown), shown, shown.T)
    used = np.flatnonzero(np.isfinite(shown).any(axis=1))
    return {"theta_deg": [(i + 0.5) * BAND for i in used], "p": shown[np.ix_(used, used)].tolist()}


def _statement(facts: dict[str, Any], least_where: dict[str, Any]) -> str:
    p = f"p = {facts['p_value']:.2g}" if facts["p_value"] > 1e-99 else "p < 1e-99"
    family = f"{p} of a family of {facts['tests'] + facts['regions']:,} tests (level {facts['level']:g})"
    if facts["significant"]:
        return (
            f"differ by more than their uncertainties allow: {family}, strongest: {_words(facts['strongest_at'])}; a"
            f" violation of at least {percent(facts['least_violation'], 3)} is needed to explain it"
            f" ({_words(least_where)})."
        )
    return (
        f"differ by no more than their uncertainties explain: {family}; a single pair would show"
        f" {percent(facts['detectable_in_one_pair'])} at the median."
    )


def _reason(verdict: str, facts: dict[str, Any], widest: _Violation, tolerance: float) -> str:
    if verdict == PASS:
        remark = " That is significant, and within the tolerance." if facts["significant"] else ""
        return f" No region of it differs by more than {percent(widest.largest, 3)}.{remark}"
    if verdict != UNDECIDED:
        return ""
    if facts["least_violation"] <= tolerance and not facts["significant"]:
        return (
            f" At {_words(widest.where)} up to {percent(widest.largest, 3)} is not excluded: too noisy to say that it"
            f" is within {percent(tolerance)}."
        )
    most = percent(widest.largest, 3)
    return f" Whether it exceeds the tolerance of {percent(tolerance)} the noise leaves open (up to {most})."


def _words(where: dict[str, Any]) -> str:
    return region_in_words(where)

"""Readings that should be equal, judged region by region: the verdict is that of the region that differs most.

A region is a square of `BAND` × `BAND` in both polar angles with a sector of azimuth difference; with few pairs in it,
the whole square, or the band of the larger polar angle. In a region a violation has a sign (the larger reading is on
the same side), so that its mean and median keep it while noise averages out.

Without stored uncertainties the noise is that of the pairs themselves (`pair_noise`). What differs by more than the
tolerance and six of its noise is no noise; its share is part of the verdict.
"""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from gonio.checks.certificate import FAIL, PASS, UNDECIDED, Property, place_in_words, place_of
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.pairs.pairs import FEWEST, Column, Pairs
from gonio.checks.table.pairs.places import BAND, SAME_POLAR, SECTOR, SIDE, places
from gonio.checks.table.statistics.counts import critical, sidak
from gonio.checks.table.statistics.pair_noise import Regions, noise_of_pairs
from gonio.checks.table.statistics.quantiles import median
from gonio.checks.table.statistics.shared_differences import least_shared
from gonio.models.display import percent
from gonio.models.special.scipy_functions import stdtrit

ENOUGH = 0.1
MOST_UNCOVERED = 0.05
"""Share of the readings, by squares of polar angles in which nothing was compared, above which nothing passes."""

OUTLYING = 6.0
"""Noise, in standard deviations, beyond which a pair differs surely."""

MANY = 0.01
"""Share of pairs that differ surely from which the table fails; fewer leave it undecided."""

NOT_ALONE = 3
"""Pairs that must differ surely for it: one or two may be a reading that went wrong."""

MEDIAN = 1.2533
"""Standard errors of a mean in that of a median of normal deviates."""

ALONE = " Neighbouring pairs do not surely differ alike: noise, which is not stated, may be all of it."
"""Why what differs does not fail where the sign of a violation is not known."""

LOPSIDED = 1.5
"""Ratio of the scatter of a region's pairs to their noise above which they are not alike."""

ROUNDING = 4 * float(np.finfo(np.float32).eps)
"""Tables may be stored in single precision."""


def region_in_words(place: dict[str, Any]) -> str:
    """`place_in_words`, where no place means all of them."""
    return place_in_words(place) or "all angles together"


def region_place(level: str, number: int, channel: str | None) -> dict[str, Any]:
    """What a certificate calls a region of one of the three sizes."""
    if level == "everywhere":
        return {} if channel is None else {"channel": channel}
    square = number // 100 if level == "sector" else number
    high, low = divmod(square, SIDE) if level != "band" else (square, None)
    place: dict[str, Any] = {"theta_from": high * BAND, "theta_to": (high + 1) * BAND}
    if low is not None and low != high:
        place |= {"other_theta_from": low * BAND, "other_theta_to": (low + 1) * BAND}
    if level == "sector":
        place |= {"delta_phi_from": number % 100 * SECTOR, "delta_phi_to": (number % 100 + 1) * SECTOR}
    return place if channel is None else {**place, "channel": channel}


def regions_of(angles: np.ndarray) -> Regions:
    """(size, number, indices) of the regions of pairs: those that hold `FEWEST`, and all pairs together."""
    regions = []
    for level, numbers in places(angles)._asdict().items():
        order = np.argsort(numbers, kind="stable")
        groups = np.split(order, np.flatnonzero(np.diff(numbers[order])) + 1)
        regions += [(level, int(numbers[group[0]]), group) for group in groups if group.size >= FEWEST]
    if len(angles) >= FEWEST:
        regions.append(("everywhere", 0, np.arange(len(angles))))
    return regions


def uncovered(angles: np.ndarray, compared: np.ndarray, every: bool = False) -> tuple[float, str]:
    """The share of readings in squares of polar angles where too few were compared, and where these are.

    Enough are `FEWEST` pairs, or as many as take in `ENOUGH` of a square's readings.

    Args:
        angles: (m, 4), radians, of all readings.
        compared: (n, 4), radians, of the pairs.
        every: whether readings of θo = θi count, which are their own partners of exchanged directions, or mirrored.
    """
    angles = angles if every else angles[np.abs(angles[:, 0] - angles[:, 2]) > SAME_POLAR]
    square = places(angles).square
    readings, pairs = (np.bincount(v, minlength=SIDE * SIDE) for v in (square, places(compared).square))
    missing = ((pairs < FEWEST) & (2 * pairs < ENOUGH * readings))[square]
    if not missing.any():
        return 0.0, ""
    high = np.max(angles[:, [0, 2]], axis=1)
    edge = np.degrees(high[~missing].max()) if (~missing).any() else 0.0
    if np.all(np.degrees(high[missing]) > edge - BAND):
        return float(missing.mean()), f"beyond θ {np.degrees(high[missing].min()):.3g}°"
    worst = np.bincount(square[missing]).argmax()
    return float(missing.mean()), f"such as at {region_in_words(region_place('square', int(worst), None))}"


@dataclasses.dataclass(frozen=True)
class _Differences:
    """Signed relative differences of the pairs of one channel, their interpolation errors, and their noise."""

    d: np.ndarray
    error: np.ndarray
    noise: np.ndarray
    pair: np.ndarray
    """Their numbers."""
    signed: np.ndarray
    regions: Regions
    angles: np.ndarray
    """(n, 4), radians."""
    tolerance: float


def _differences(column: Column, pairs: Pairs, sign: np.ndarray, whole: Regions, tolerance: float) -> _Differences:
    """Those of a channel; `whole`: the regions of all pairs."""
    a, b, *_, error = column
    use = np.flatnonzero(np.isfinite(a) & np.isfinite(b))
    a, b, sign = a[use], b[use], sign[use]
    angles = pairs.angles[use]
    regions = whole if use.size == len(pairs) else regions_of(angles)
    size = np.maximum((np.abs(a) + np.abs(b)) / 2, 1e-300)
    d = np.where(sign < 0, -1.0, 1.0) * (a - b) / size
    error = (error[use] if isinstance(error, np.ndarray) else np.full(use.size, error)) + ROUNDING
    noise = noise_of_pairs(d, size, regions)
    return _Differences(d, error, noise, use, sign != 0, regions, angles, tolerance)


class _Estimate(NamedTuple):
    """A relative difference with the half width of its interval, and its place."""

    difference: float
    half: float
    where: dict[str, Any]
    most: float = np.inf
    """The largest difference of its pairs: a region cannot differ by more than each of them."""

    @property
    def least(self) -> float:
        return self.difference - self.half

    @property
    def largest(self) -> float:
        return min(self.difference + self.half, self.most)


def _estimates(rows: _Differences, level: float, channel: str | None) -> list[_Estimate]:
    """The mean and the median of each region, at a level of all of them together; without signs, of their sizes."""
    signed = rows.signed.any()
    regions = rows.regions
    if signed and not rows.signed.all():
        regions = [(size, number, group[rows.signed[group]]) for size, number, group in regions]
    regions = [region for region in regions if region[2].size >= FEWEST]
    one, estimates = sidak(level, 2 * max(len(regions), 1)), []
    for size, number, group in regions:
        d, root = rows.d[group], np.sqrt(group.size)
        noise, scatter = float(np.sqrt(np.mean(rows.noise[group] ** 2))), float(np.std(d, ddof=1))
        error, where = float(np.mean(rows.error[group])), region_place(size, number, channel)
        half = critical(one) * noise / root
        if not signed:
            half = float(-stdtrit(group.size - 1, one / 2)) * float(np.std(np.abs(d), ddof=1)) / root + error
            estimates.append(_without_sign(rows, group, half, one, where))
            continue
        most = float(np.max(np.abs(d) + rows.error[group]))
        estimates.append(_Estimate(abs(float(np.median(d))), MEDIAN * half + error, where, most))
        if scatter > LOPSIDED * noise:  # a part of the region differs: its mean is as uncertain as they scatter
            half = float(-stdtrit(group.size - 1, one / 2)) * scatter / root
        estimates.append(_Estimate(abs(float(np.mean(d))), half + error, where, most))
    return estimates


def _without_sign(rows: _Differences, group: np.ndarray, half: float, level: float, where: dict[str, Any]) -> _Estimate:
    """The mean size of the differences of a region, of which noise may be all that neighbouring pairs do not share."""
    d = rows.d[group]
    difference = float(np.mean(np.abs(d)))
    most = difference + half
    if difference - half > rows.tolerance:
        half = max(half, difference - least_shared(d, rows.angles[group], level))
    return _Estimate(difference, half, where, most)


def _single_pairs(rows: _Differences, pairs: Pairs, channel: str | None) -> tuple[tuple[float, int], _Estimate]:
    """The share and number of the pairs that differ surely, each by itself, and the one that does so most."""
    # One interpolated partner proves nothing: what lies between near readings may be a peak.
    measured = rows.error <= ROUNDING
    beyond = np.where(measured, np.abs(rows.d) - OUTLYING * rows.noise, -1.0) - rows.error
    k, sure = int(np.argmax(beyond)), int(np.sum(beyond > rows.tolerance))
    worst = _Estimate(
        abs(float(rows.d[k])), float(abs(rows.d[k]) - beyond[k]), place_of(pairs.angles[rows.pair[k]], channel)
    )
    return (sure / max(int(np.sum(measured)), 1), sure), worst


def judged_by_regions(
    name: str,
    evidence: TableEvidence,
    pairs: Pairs,
    sign: np.ndarray,
    by_channel: np.ndarray,
    tolerance: float,
    compared: str,
) -> Property:
    """The property of pairs without known uncertainties: fail, if a region surely differs by more than the tolerance.

    It fails also where `MANY` of the pairs differ surely. It passes where no region can differ by more, and no pair
    does. `sign` (n,) is that of a violation in each pair (0: unknown), `by_channel` (channels,) the number of pairs
    that can be compared; `compared`: what with what, and how.
    """
    known = np.flatnonzero(by_channel >= FEWEST)
    whole, noises = regions_of(pairs.angles), np.full((len(known), len(pairs)), np.nan, np.float32)
    estimates, shares, pairs_worst = [], [], []
    for channel, kept in zip(map(int, known), noises, strict=True):
        rows = _differences(pairs.column(channel), pairs, sign, whole, tolerance)
        kept[: rows.noise.size] = rows.noise
        estimates += _estimates(rows, evidence.level / len(known), evidence.channel(channel))
        of_channel, worst = _single_pairs(rows, pairs, evidence.channel(channel))
        shares.append(of_channel)
        pairs_worst.append(worst)
    single, share = max(pairs_worst, key=lambda e: e.least), max(shares)[0]
    surest = max(estimates, key=lambda e: e.least, default=single)
    widest = max(estimates, key=lambda e: (round(e.largest, 9), e.difference), default=single)
    if surest.least > tolerance:
        verdict, decides = FAIL, surest
    elif any(of_channel >= MANY and sure >= NOT_ALONE for of_channel, sure in shares):
        verdict, decides = FAIL, single
    elif share > 0:
        verdict, decides = UNDECIDED, single
    else:
        verdict, decides = PASS if estimates and widest.largest <= tolerance else UNDECIDED, widest
    noise = median(noises)
    facts = {
        "regions": len(estimates) // 2,
        "region": f"{BAND:g}° × {BAND:g}° of polar angles × {SECTOR:g}° of azimuth difference",
        "share_beyond_tolerance": share,
        "least_violation": max(surest.least, 0.0),
        "largest_violation": max(widest.largest, single.least),
        "noise_of_pairs": noise,
    }
    half = decides.half if verdict == FAIL else decides.largest - decides.difference
    detail = f"{compared}: {_sentence(decides._replace(half=half), tolerance, share, noise)}"
    if verdict == UNDECIDED and not share and decides.difference > tolerance and not sign.any():
        detail += ALONE
    return Property(name, verdict, decides.difference, half, tolerance, decides.where, detail, facts)


def _sentence(decides: _Estimate, tolerance: float, share: float, noise: float) -> str:
    where = region_in_words(decides.where)
    what = "pair" if "theta_i" in decides.where else "region"
    size = f"{percent(decides.difference, 3)} (±{percent(decides.half)})"
    text = f"the {what} that differs most ({where}) does so by {size}"
    if share > 0:
        text += f"; {percent(share)} of the pairs differ by more than {percent(tolerance)} and their noise"
    return f"{text}. The pairs themselves scatter by {percent(noise)}." if noise > 10 * ROUNDING else f"{text}."

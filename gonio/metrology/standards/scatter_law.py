"""f in the plane of incidence against |sinθs − sinθi|, fitted in log f by ABg and Harvey–Shack's law [Harvey 1976]."""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gonio.data.angles import SLACK
from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.table import Table
from gonio.metrology.quantity import Quantity
from gonio.metrology.standards.evaluation import Undecided
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import from_spherical

GROUP = "scatter law"
INCIDENCES = np.radians([0.0, 30.0, 60.0])
"""Of a model."""
OFFSETS = np.geomspace(1e-3, 1.5, 32)
LARGEST_SINE = math.sin(math.radians(85.0))
IN_PLANE = math.radians(0.1)
FEWEST = 8
"""Readings of a fit."""
RANGES = 8
"""Of offsets, each with as many readings, in which a law may miss f in one direction."""
MOST_CHANNELS = 12
"""Channels that the laws are fitted to, spread evenly: a spectrum of hundreds would take longer than all else."""
HOLDS = 10.0
"""Per cent by which incidences may differ where f depends on the offset alone."""
STARTS = (1.0, 2.0, 3.0)
MOST_STEPS, DAMPING, LARGEST = 200, 1e-2, 1e12
"""Of a descent."""
LEAST_DAMPING = 1e-12
"""Over the diagonal: far above rounding, by which the normal matrix of numbers that change nothing is singular."""
STEADY, LITTLE = 1e-9, 1e-9
"""Relative changes of the numbers, or of the cost, at which it ends."""
Law = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""log f (..., n) of three numbers (..., 3) and log x (n,), and its derivatives by the numbers (..., n, 3)."""


class Profile(NamedTuple):
    """Readings in the plane of incidence: θi (n,), radians, offsets |sinθs − sinθi| (n,), f and u(f) (n, C)."""

    theta_i: np.ndarray
    offset: np.ndarray
    f: np.ndarray
    u_f: np.ndarray | None = None
    """Of no stated uncertainty 0; None of a model."""


def abg(p: np.ndarray, log_x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """log of A/(B + x^g), of p = (log A, log B, g), and its slopes."""
    log_a, log_b, g = np.moveaxis(p, -1, 0)[..., None]
    rise, share = _softplus(g * log_x - log_b)
    return log_a - log_b - rise, np.stack([np.ones_like(share), share - 1, -log_x * share], axis=-1)


def harvey_shack(p: np.ndarray, log_x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """log of b0 (1 + (x/l)²)^(s/2), of p = (log b0, log l, s), and its slopes."""
    log_b0, log_l, s = np.moveaxis(p, -1, 0)[..., None]
    rise, share = _softplus(2 * (log_x - log_l))
    return log_b0 + s / 2 * rise, np.stack([np.ones_like(rise), -s * share, rise / 2], axis=-1)


def _softplus(v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """log(1 + eᵛ), and its slope."""
    small = np.exp(-np.abs(v))
    return np.maximum(v, 0.0) + np.log1p(small), np.where(v > 0, 1.0, small) / (1.0 + small)


LAWS: dict[str, tuple[Law, tuple[str, str, str], float]] = {
    "ABg": (abg, ("A", "B", "g"), 1.0),
    "Harvey–Shack": (harvey_shack, ("b0", "l", "s"), -1.0),
}
"""The law, its numbers, the first two as logarithms, and the sign of the third."""


def of_model(brdf: AbstractBRDF) -> Profile:
    """The profile of a model at a few incidences, on both sides of the mirror direction."""
    theta, offset = (a.ravel() for a in np.meshgrid(INCIDENCES, np.concatenate([-OFFSETS, OFFSETS]), indexing="ij"))
    sine = np.sin(theta) + offset
    inside = np.abs(sine) <= LARGEST_SINE
    theta, offset, theta_o = theta[inside], offset[inside], np.arcsin(sine[inside])
    wi = from_spherical(theta, np.zeros_like(theta), np)
    wo = from_spherical(np.abs(theta_o), np.where(theta_o >= 0, np.pi, 0.0), np)
    return Profile(theta, np.abs(offset), evaluate_in_blocks(brdf, wi, wo))


def of_table(table: Table) -> Profile:
    """The readings of a table in the plane of incidence, valid in all channels, with light and detector in front."""
    theta_i, phi_i, theta_o, phi_o = (np.asarray(a) for a in table.layout.angles())
    turn = phi_o - phi_i
    normal, sines = theta_i < IN_PLANE, (np.sin(theta_i), np.sin(theta_o))
    across = np.abs(np.sin(turn)) * np.where(normal, sines[1], np.minimum(*sines))
    plane = across < math.sin(IN_PLANE)
    if not (plane & normal & (theta_o > IN_PLANE)).any():  # light along the normal: every plane is one of incidence
        plane |= normal
    cells = np.flatnonzero(plane & (np.maximum(theta_i, theta_o) < np.pi / 2))
    block = table.values_at(cells)
    use = (block["flag"] == Flag.VALID).all(axis=1)
    cells, f = cells[use], np.asarray(block["f"], float)[use]
    u_f = None if table.u_f is None else np.nan_to_num(np.asarray(block["u_f"], float)[use])
    along, beside = (np.sin(theta_o[cells]) * side(turn[cells]) for side in (np.cos, np.sin))
    offset = np.hypot(along + np.sin(theta_i[cells]), beside)
    return Profile(theta_i[cells], np.where(offset < SLACK, 0.0, offset), f, u_f)


def scatter_laws(profile: Profile, channels: Channels) -> tuple[list[Quantity], list[Undecided]]:
    """Numbers of both laws with their uncertainties, and by how much incidences differ at one offset."""
    rows: list[Quantity] = []
    undecided: dict[str, Undecided] = {}
    x, range_text = profile.offset, _range(profile)
    count = len(channels.names)
    some = np.unique(np.linspace(0, count - 1, min(count, MOST_CHANNELS)).round().astype(int))
    for c, channel in ((int(c), channels.names[c]) for c in some):
        use = profile.f[:, c] > 0
        if np.count_nonzero(use) < FEWEST or np.unique(np.round(x[use], 6)).size < FEWEST:
            undecided["ABg"] = Undecided("ABg, Harvey–Shack", "", GROUP, f"fewer than {FEWEST} readings in the plane")
            continue
        logs = np.log(profile.f[use, c])
        for name, law in LAWS.items():
            made = _fitted(name, law, profile.theta_i[use], x[use], logs, f"{range_text}", channel)
            if all(q.decided for q in made):
                rows += made
            else:
                undecided[name] = Undecided(name, "", GROUP, "f follows no such law, or does not fall far enough")
        u = np.zeros(logs.size) if profile.u_f is None else profile.u_f[use, c] / profile.f[use, c]
        spread = _between_incidences(profile.theta_i[use], x[use], logs, u)
        rows += [] if spread is None else [_difference(spread, channel, range_text)]
    if some.size < count:
        reason = f"fitted to {some.size} of {count} channels alone; Table.only takes others"
        undecided["channels"] = Undecided("ABg, Harvey–Shack", "", GROUP, reason)
    return rows, list(undecided.values())


class Spread(NamedTuple):
    """Rms difference between incidences, per cent, its standard uncertainty, and how far it may be off."""

    value: float
    u: float
    bound: float


def _difference(spread: Spread, channel: str, range_text: str) -> Quantity:
    """By how much incidences differ, and whether f depends on the offset alone."""
    row = Quantity(
        "difference of incidences", "shift invariance not decided", channel, spread.value, spread.bound, {}, "%",
        "Harvey 1976", "rms difference of f at one |sinθs − sinθi|; " + range_text, GROUP, spread.u,
    )  # fmt: skip
    if spread.value + 2 * row.u <= HOLDS:  # what may be too much of it makes it smaller
        return dataclasses.replace(row, place="shift invariance holds")
    sure = spread.value - spread.bound - 2 * row.u > HOLDS
    return dataclasses.replace(row, place="shift invariance does not hold") if sure else row


def _range(profile: Profile) -> str:
    positive = profile.offset[profile.offset > SLACK]
    theta = np.unique(np.round(np.degrees(profile.theta_i), 3))
    if not positive.size:
        return ""
    listed = ", ".join(f"{t:g}°" for t in theta[:6]) + (" …" if theta.size > 6 else "")
    return f"|sinθs − sinθi| {positive.min():.2g} to {positive.max():.2g} in the plane of incidence, θi {listed}"


def _fitted(
    name: str,
    law: tuple[Law, tuple[str, str, str], float],
    theta_i: np.ndarray,
    x: np.ndarray,
    logs: np.ndarray,
    where: str,
    channel: str,
) -> list[Quantity]:
    """The numbers of one law of one channel, with standard uncertainties by the scatter about it."""
    names, (p, covariance, scatter) = law[1], _optimum(name, theta_i.tobytes(), x.tobytes(), logs.tobytes())
    u = np.sqrt(np.abs(np.diagonal(covariance)))
    with np.errstate(over="ignore", invalid="ignore"):
        values = [math.exp(min(p[0], 700)), math.exp(min(p[1], 700)), float(p[2])]
        sizes = [values[0] * u[0], values[1] * u[1], u[2]]
    geometry = f"fitted in log f, rms {100 * scatter:.2g} % about it; {where}"
    return [
        Quantity(f"{name} {n}", "", channel, v, 0.0, {}, "1", "ASTM E2387", geometry, GROUP, float(s))
        for n, v, s in zip(names, values, sizes, strict=True)
    ]


@functools.lru_cache(maxsize=64)
def _optimum(name: str, incidences: bytes, offsets: bytes, logs: bytes) -> tuple[np.ndarray, np.ndarray, float]:
    """(numbers, covariance, rms) of a law fitted to float64 offsets and log f: a page lists them and draws them.

    Readings that a law misses are missed together, over a range of offsets or at an incidence: the covariance is that
    of such groups, each by itself [Liang and Zeger 1986], and not below that of independent scatter.
    """
    (curve, _, sign), x, y = LAWS[name], np.frombuffer(offsets), np.frombuffer(logs)
    theta_i = np.frombuffer(incidences)
    knee = math.log(max(float(np.median(x)), 1e-6))
    starts = [(y.max() + (s * knee if sign > 0 else 0.0), s * knee if sign > 0 else knee, sign * s) for s in STARTS]
    log_x = np.log(np.maximum(x, 1e-12))
    ends, costs = descended(lambda p: curve(p, log_x), np.array(starts), y)
    best = ends[int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))]
    value, slopes = curve(best, log_x)
    scatter = math.sqrt(float(np.sum((value - y) ** 2)) / max(x.size - 3, 1))
    normal = slopes.T @ slopes
    singular = not np.isfinite(normal).all() or np.linalg.cond(normal) > 1e12
    if singular:
        return best, np.full((3, 3), np.inf), scatter
    inverse, pulls = np.linalg.inv(normal), slopes * (value - y)[:, None]
    alone = inverse * scatter**2
    offset = np.round(x, 9)  # readings of one offset stand in one range
    ranges = np.unique(np.searchsorted(np.sort(offset), offset) * RANGES // x.size, return_inverse=True)[1]
    nodes = np.unique(np.round(theta_i, 6), return_inverse=True)[1]
    together = inverse @ (_of_groups(pulls, ranges) + _of_groups(pulls, nodes)) @ inverse
    wider = np.sqrt(np.maximum(np.diagonal(together) / np.maximum(np.diagonal(alone), 1e-300), 1.0))
    return best, alone * np.outer(wider, wider), scatter


def _of_groups(pulls: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Covariance (P, P) of the sum of pulls (n, P) whose groups (n,) are independent of each other; 0 of one group."""
    count = int(group.max()) + 1
    sums = np.zeros((count, pulls.shape[1]))
    np.add.at(sums, group, pulls)
    return sums.T @ sums * (count / (count - 1) if count > 1 else 0.0)


def descended(
    curve: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], starts: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(ends (S, P), costs ½Σr² (S,)) of descents side by side [Marquardt 1963, scaled as Moré 1978].

    Args:
        curve: gives values (S, n) and slopes (S, n, P) at numbers (S, P).
        starts: numbers (S, P).
        y: what the values are to be (n,).
    """

    def sums_at(p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        value, slopes = curve(p)
        r, by = value - y, slopes.swapaxes(-1, -2)
        return 0.5 * np.sum(r * r, axis=-1), (by @ r[..., None])[..., 0], by @ slopes

    p, damping = starts.astype(float), np.full(len(starts), DAMPING)
    scale, going = np.zeros_like(p), np.arange(len(starts))
    sums = sums_at(p)
    for _ in range(MOST_STEPS):
        cost, gradient, matrix = (a[going] for a in sums)
        scale[going] = np.maximum(scale[going], matrix.diagonal(axis1=-2, axis2=-1))
        added = damping[going, None] * np.maximum(scale[going], 1e-30)
        step = -np.linalg.solve(matrix + np.eye(p.shape[1]) * added[:, None], gradient[..., None])[..., 0]
        with np.errstate(over="ignore", invalid="ignore"):
            now = sums_at(p[going] + step)
        better = now[0] < cost
        taken = going[better]
        small = (np.abs(step) <= STEADY * (np.abs(p[going]) + STEADY)).all(axis=1)
        small |= better & (cost - now[0] <= LITTLE * cost)
        p[taken] += step[better]
        for before, after in zip(sums, now, strict=True):
            before[taken] = after[better]
        damping[going] = np.maximum(damping[going] * np.where(better, 1 / 8, 4.0), LEAST_DAMPING)
        going = going[~small & (damping[going] < LARGEST)]
        if not going.size:
            break
    return p, sums[0]


def _between_incidences(theta: np.ndarray, x: np.ndarray, logs: np.ndarray, u: np.ndarray) -> Spread | None:
    """Rms difference of f between incidences at one offset; None of one incidence.

    Its bound is what the noise u (n,) of log f adds to it by itself, and what log f bends between the first
    incidence's offsets: as much as it changes where every second of these is left out.
    """
    nodes = np.unique(np.round(theta, 6))
    first = np.abs(theta - nodes[0]) < 1e-6
    # Both sides of one light have the same offsets, to the rounding of angles: the mean stands for them.
    _, place, count = np.unique(np.round(x[first], 6), return_inverse=True, return_counts=True)
    level = logs[first][0]  # equal readings have their own mean
    offsets, means = (np.bincount(place, v) / count for v in (x[first], logs[first] - level))
    here = ~first & (x >= offsets[0] - SLACK) & (x <= offsets[-1] + SLACK)
    if not here.any():
        return None
    at_node = np.min(np.abs(x[here, None] - offsets), axis=1) < 1e-6
    difference = logs[here] - level - np.interp(x[here], offsets, means)
    some = np.unique(np.append(np.arange(0, offsets.size, 2), offsets.size - 1))
    bends = np.interp(x[here], offsets[some], means[some]) - np.interp(x[here], offsets, means)
    bend = float(np.sqrt(np.mean(np.where(at_node, 0.0, bends) ** 2)))
    noise, u_rms = _noise_of_rms(difference, u[here], (place, count, u[first]), (x[here], offsets))
    rms = float(np.sqrt(np.mean(difference**2)))
    return Spread(100 * rms, 100 * u_rms, 100 * (rms - math.sqrt(max(rms**2 - noise, 0.0)) + bend))


def _noise_of_rms(
    difference: np.ndarray,
    u: np.ndarray,
    first: tuple[np.ndarray, np.ndarray, np.ndarray],
    between: tuple[np.ndarray, np.ndarray],
) -> tuple[float, float]:
    """(the mean variance of differences (m,), the standard uncertainty of their rms).

    Args:
        difference: of readings of uncertainty u (m,) from what is interpolated between means.
        first: (which mean, readings of each mean, uncertainties) of the readings that are averaged.
        between: (offsets of the differences (m,), offsets of the means).
    """
    (place, count, u_first), (x, offsets) = first, between
    variance = np.bincount(place, u_first**2) / count**2
    right = np.clip(np.searchsorted(offsets, x), min(1, offsets.size - 1), offsets.size - 1)
    before = np.maximum(right - 1, 0)
    share = np.clip((x - offsets[before]) / np.maximum(offsets[right] - offsets[before], SLACK), 0.0, 1.0)
    of_each = u**2 + (1 - share) ** 2 * variance[before] + share**2 * variance[right]
    pull = sum(np.bincount(n, difference * w, offsets.size) for n, w in ((before, 1 - share), (right, share)))
    of_square = 4 * (np.sum((difference * u) ** 2) + np.sum(pull**2 * variance)) + 2 * np.sum(of_each**2)
    square, noise = float(np.sum(difference**2)), float(np.mean(of_each))
    return noise, float(np.sqrt(of_square / (4 * square * difference.size))) if square > 0 else math.sqrt(noise)

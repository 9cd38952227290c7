"""Sentences about what the data leave open: numbers, combinations of numbers, and the readings that would tell them."""

import re
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from gonio.fitting.problem.lobes import sensitivities
from gonio.fitting.problem.readings import Readings, evenly_spaced
from gonio.fitting.problem.table_rows import rows_of
from gonio.fitting.solver.robust_weights import NORMAL_MAD
from gonio.fitting.uncertainty.covariance import LOST, open_from
from gonio.fitting.uncertainty.joint_covariance import Combination, View
from gonio.fitting.uncertainty.optimum import Optimum, ParameterEstimate
from gonio.models.display import percent
from gonio.models.geometry.directions import Direction, from_spherical

MOST_LISTED, MOST_ALIKE = 6, 3  # numbers that are named, and channels that leave the same open with a sentence each
SMALL = 0.1  # of the largest change, below which a number is no part of a combination
ALIKE = 0.1  # difference of two relative changes, or of an exponent from ±1, that words pass over

STEP = 5.0  # degrees
HIGHEST = 85.0
INCIDENCES = 16
MOST_CELLS = 1 << 16  # of a large table whose residuals tell its noise
EACH = 128  # directions of each incidence
LEAST_NOISE = 1e-3  # of f: what readings without noise are taken to have
SEPARATED = 1 / 16  # variance of what counts as separated: a quarter of the uncertainty that counts as open
MANY = 200.0  # times as many readings: beyond that nobody measures


class _Probes(NamedTuple):
    """Directions of possible readings: polar angles (n,), ∂f/∂(free parameter) (n, groups, C), f (n, C)."""

    theta_i: np.ndarray
    theta_o: np.ndarray
    rows: np.ndarray
    f: np.ndarray


def advice(e: Optimum, combination: Combination) -> str:
    """What would determine an open combination of an optimum, as a clause.

    Readings at a grid of directions, with the noise of readings as bright as these, are added to what is known of the
    numbers of its view together, in order of their larger polar angle: the first angle up to which the combination's
    variance falls below what counts as open is the answer.
    """
    view, variance = combination.view, combination.variance
    channels = _channels(e, view)
    columns = np.searchsorted(view.index, e.parameters.columns[channels], sorter=np.argsort(view.index))
    columns = np.argsort(view.index)[columns]
    probes = _probes(e)
    sigma = _noise(e.readings, e.model_f, probes.f)[:, channels]
    rows = probes.rows[:, :, channels]
    known, reach, change = _precision(e, view), open_from(e.domains, e.p)[view.index], combination.change[view.index]
    lowest = min(float(np.min(np.abs(np.asarray(w.z)))) for part in e.readings.parts() for w in (part.wi, part.wo))
    top = float(np.degrees(np.arccos(min(lowest, 1.0))))
    outer = np.degrees(np.max([np.minimum(t, np.pi - t) for t in (probes.theta_i, probes.theta_o)], axis=0))

    def separated(cells: np.ndarray) -> bool:
        more = _information(columns, rows[cells], sigma[cells], change.size)
        return bool(cells.any()) and _determined(known + more, reach, change)

    for angle in np.arange(STEP * (np.floor(top / STEP + 0.01) + 1), HIGHEST + 1e-9, STEP):
        cells = (outer > top + 0.1 * STEP) & (outer <= angle + 1e-6)
        if separated(cells):
            along = np.stack([rows[:, :, c] @ change[these] for c, these in enumerate(columns)], axis=1)
            best = int(np.argmax(np.sum((along / sigma) ** 2, axis=1) * cells))
            theta_i, theta_o = (np.degrees(t[best]) for t in (probes.theta_i, probes.theta_o))
            return (
                f"readings up to {angle:.0f}° (these end at {top:.0f}°) would separate them, most of all at "
                f"θi {theta_i:.0f}°, θo {theta_o:.0f}°"
            )
    if separated(outer <= top + 0.1 * STEP):
        return "readings at all azimuths, at polar angles as these, would separate them"
    if variance / SEPARATED < MANY:
        return f"no angles separate them, {np.ceil(variance / SEPARATED):.0f} times as many readings would"
    return "no readings would separate them: hold one of them at a known value (name=value)"


def _determined(matrix: np.ndarray, reach: np.ndarray, change: np.ndarray) -> bool:
    """Whether the combination's variance, in units of what counts as open, is well below 1, all numbers being free."""
    if not np.isfinite(matrix).all():
        return False
    direction = change / np.linalg.norm(change / reach) / reach**2
    known_ones = np.diagonal(matrix) > 0
    if np.abs(change / reach)[~known_ones].max(initial=0.0) > 0.1 * np.abs(change / reach).max():
        return False
    lengths = np.sqrt(np.diagonal(matrix)[known_ones])
    values, vectors = np.linalg.eigh(matrix[np.ix_(known_ones, known_ones)] / np.outer(lengths, lengths))
    along = vectors.T @ (direction[known_ones] / lengths)
    lost = values < LOST * values.size
    if np.abs(along[lost]).max(initial=0.0) > 1e-3 * np.linalg.norm(along):
        return False
    return bool(np.sum(along[~lost] ** 2 / values[~lost]) < SEPARATED)


def _channels(e: Optimum, view: View) -> np.ndarray:
    """The channels whose readings a view sees."""
    return np.arange(e.parameters.channels) if view.channel is None else np.array([view.channel])


def _precision(e: Optimum, view: View) -> np.ndarray:
    """Inverse covariance (K, K) of a view's open numbers: the normal matrix over the residuals' own variance."""
    matrix, moving = view.information, ~e.active_bound[view.index]
    free = np.outer(moving, moving)
    if e.exact:
        # Without noise everything that is visible at all is determined: as much is taken as the further readings have.
        scale = LEAST_NOISE**2 * max(e.problem.target_norm_squared, 1e-300) / e.model_f.size
        return np.where(free, matrix, 0.0) / scale
    known = np.diagonal(view.covariance.matrix)
    known_ones = np.isfinite(known) & (known > 0)
    # Where the covariance is not the inverse of the matrix (robust, or noise not known) their ratio is the variance.
    scale = 1.0
    if known_ones.any():
        inverse = np.diagonal(np.linalg.pinv(matrix[np.ix_(known_ones, known_ones)], rcond=1e-14, hermitian=True))
        visible = inverse > 0
        if visible.any():
            with np.errstate(over="ignore"):
                scale = float(np.median(known[known_ones][visible] / inverse[visible]))
    return np.where(free, matrix, 0.0) / max(scale, 1e-300)


def _probes(e: Optimum) -> _Probes:
    """Possible readings at incidences every few degrees: in the plane and out of it."""
    incidence = np.radians(np.append(np.arange(10, 86, STEP)[: INCIDENCES - 1], HIGHEST))
    polar = np.radians(np.linspace(2.5, HIGHEST, EACH // 4))
    theta_i = np.repeat(incidence, EACH)
    theta_o = np.tile(np.tile(polar, 4), INCIDENCES)
    phi = np.tile(np.repeat(np.radians([180.0, 0.0, 175.0, 120.0]), EACH // 4), INCIDENCES)
    # The mirror direction itself belongs to every incidence: a lobe is often narrower than the grid.
    theta_o[:: EACH // 4] = theta_i[:: EACH // 4]
    # On the sides of the sample that were read.
    lit, read = np.repeat(np.array(e.readings.sides).T, theta_i.size, axis=1) < 0
    theta_i, theta_o, phi = (np.tile(a, len(e.readings.sides)) for a in (theta_i, theta_o, phi))
    theta_i, theta_o = np.where(lit, np.pi - theta_i, theta_i), np.where(read, np.pi - theta_o, theta_o)
    pair = (from_spherical(theta_i, 0.0, np), from_spherical(theta_o, phi, np))
    wi, wo = (Direction(*(jnp.asarray(c) for c in w)) for w in pair)
    f, rows = sensitivities(e.parameters, jnp.asarray(e.p), e.problem.fixed, wi, wo)
    return _Probes(theta_i, theta_o, np.asarray(rows), np.asarray(f))


def _information(columns: np.ndarray, rows: np.ndarray, sigma: np.ndarray, size: int) -> np.ndarray:
    """Normal matrix (K, K) of readings with standard deviations sigma (n, C), whose rows have these columns (C, G)."""
    matrix = np.zeros((size, size))
    for c, these in enumerate(columns):
        j = rows[:, :, c] / sigma[:, c : c + 1]
        matrix[np.ix_(these, these)] += j.T @ j
    return matrix


def _noise(readings: Readings, model: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Standard deviation of readings as bright as f, (n, C), from the residuals of 16 classes of brightness.

    Of readings that stay in their table, evenly spaced cells tell.
    """
    if readings.rows is not None:
        cells = evenly_spaced(readings.rows.shape[0], MOST_CELLS)
        readings, model = readings.part(cells), rows_of(model, cells)
    valid = readings.valid & (np.abs(model) > 0)
    level, deviation = np.abs(model[valid]), np.abs((readings.f - model)[valid])
    if level.size < 2:
        return LEAST_NOISE * np.maximum(np.abs(f), 1e-30)
    order = np.array_split(np.argsort(level), min(16, level.size))
    x = np.array([np.median(level[o]) for o in order])
    share = np.array([NORMAL_MAD * np.median(deviation[o]) for o in order]) / x
    size = np.maximum(np.abs(f), 1e-3 * x[0] + 1e-300)
    return np.maximum(np.interp(np.log(size), np.log(x), share), LEAST_NOISE) * size


def undetermined_sentences(e: Optimum, estimates: list[ParameterEstimate]) -> list[str]:
    """What an optimum leaves open, and which readings would determine it; `estimates` of its free numbers in turn."""
    names, sentences, covered = [p.label for p in estimates], [], np.zeros(len(estimates), bool)
    alike: dict[frozenset[str], list[Combination]] = {}
    for c in e.combinations:
        kinds = frozenset(name.split("[")[0] for name in _members(c.change, e.p, names))
        alike.setdefault(kinds, []).append(c)
    for same in alike.values():
        # What many channels leave open alike is one sentence.
        for c in same if len(same) <= MOST_ALIKE else same[:1]:
            words = describe_combination(c.variance, c.change, e.p, names, e.parameters.linear)
            sentences.append(f"{words}; {advice(e, c)}")
        if len(same) > MOST_ALIKE:
            sentences[-1] += f" (and likewise in {len(same) - 1} other channels)"
            for c in same:
                covered[_relative(c.change, e.p)[1] > SMALL] = True
    silent = e.covariance.undetermined & _without_effect(e)
    if silent.any():
        do = "does" if silent.sum() == 1 else "do"
        sentences.append(f"{listed([names[k] for k in np.flatnonzero(silent)])} {do} not change the residuals at all")
    rest = [p for p, named in zip(estimates, covered | silent, strict=True) if not named]
    return sentences + unnamed_numbers(rest, sentences)


def listed(words: list[str]) -> str:
    """Words with commas and "and": of many, the first ones and how many more there are."""
    if len(words) > MOST_LISTED:
        words = [*words[: MOST_LISTED - 1], f"{len(words) - MOST_LISTED + 1} more"]
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def _without_effect(e: Optimum) -> np.ndarray:
    """Which numbers (P,) no residual depends on."""
    silent = np.zeros(e.p.size, bool)
    for view in e.covariance.views:
        silent[view.index] = np.diagonal(view.information) <= 0
    return silent


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
    return [f"{listed(each)} {'is' if len(each) == 1 else 'are'} not determined by these readings either"]


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
    shares = [(n, members[n][0] / lead / 100) for n in others[:4]]
    rates = ", ".join(f"{n} by {'+' if share > 0 else ''}{percent(share, 3)}" for n, share in shares)
    more = f" and {len(others) - 4} more" if len(others) > 4 else ""
    how = "nothing" if not np.isfinite(variance) else "less in the residuals than noise does"
    return (
        f"raising {first} by 1 % together with {rates}{more} changes {how}: only their combination is determined by "
        "these readings"
    )


def _members(change: np.ndarray, p: np.ndarray, names: list[str]) -> dict[str, tuple[float, int]]:
    """{name: (relative change, an index)}: channels that change alike are one member, largest change first."""
    rate, size = _relative(change, p)
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


def _relative(change: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(relative changes (P,), their sizes as a share of the largest)."""
    rate = np.divide(change, np.abs(p), out=change.copy(), where=p != 0)
    return rate, np.abs(rate) / np.max(np.abs(rate))


def _power(a: str, b: str, exponent: float) -> str:
    """What stays while a rises by r_a and b by r_b: a·b^(−r_a/r_b)."""
    if abs(abs(exponent) - 1) < ALIKE:
        return f"{a}·{b}" if exponent > 0 else f"{a}/{b}"
    return f"{a}·{b}^{exponent:.2g}" if exponent > 0 else f"{a}/{b}^{-exponent:.2g}"

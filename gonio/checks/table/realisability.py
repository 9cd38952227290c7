"""Realisability of Mueller matrices: whether each is a mixture of what optics do with polarised light.

A Mueller matrix is a sum of those of Jones matrices with positive weights exactly where its coherency matrix has no
negative eigenvalue [Cloude 1986]; the least one, in units of m00, is judged. Means of realisable matrices are
realisable too: regions of directions are judged by their means, in which noise cancels.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gonio.checks.certificate import (
    FAIL,
    NOT_TESTABLE,
    PASS,
    UNDECIDED,
    Property,
    place_of,
    verdict_of,
    without_residual,
)
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.mueller_regions import RegionMeans, matrices_in_blocks
from gonio.checks.table.pairs.places import angles_of
from gonio.data.polarisation import matrices_of
from gonio.data.table import Table
from gonio.models.display import listed, percent

MOST_BEYOND = 0.01
"""Share of the matrices that noise does not explain from which on a table fails that stores no uncertainties."""
ORDER = (PASS, NOT_TESTABLE, UNDECIDED, FAIL)
PAULI = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])
COHERENCY = np.einsum("iab,jcd->ijacbd", PAULI, PAULI.conj()).reshape(16, 16) / 4
"""The coherency matrix of each element, row by row; its eigenvalues sum to m00."""
EVERY = frozenset((r, c) for r in range(4) for c in range(4))
WITHOUT_45 = frozenset((r, c) for r, c in EVERY if r // 2 == c // 2)
"""The elements that a surface has on average with its mirror image."""
WITHOUT_CIRCULAR = frozenset((r, c) for r, c in EVERY if (r == 3) == (c == 3))
HANDEDNESS = np.where(np.arange(16) >= 12, -1.0, 1.0)
"""Signs that change the handedness of the detector's circular light."""

Places = frozenset[tuple[int, int]]
Elements = Mapping[tuple[int, int], int]
"""The channel of each row and column."""


class Judged(NamedTuple):
    """Least eigenvalues over m00 of matrices (parts, n), negative where one is not realisable; their error by noise."""

    least: np.ndarray
    error: np.ndarray

    @property
    def surely(self) -> np.ndarray:
        """By how much each is surely below 0."""
        return -self.least - np.nan_to_num(self.error, nan=np.inf)


class Alone(NamedTuple):
    """Matrices each by itself: how many are surely not realisable, and what is judged of the one that is so most."""

    surely: int
    perhaps: int
    """How many are not, as they were read, by more than the tolerance."""
    most: float
    """The largest violation but for a share of `MOST_BEYOND`."""
    residual: float
    error: float
    cell: int


def table_realisability(evidence: TableEvidence, tolerance: float) -> Property | None:
    """Whether the Mueller matrices of a table are realisable, the worst of several; None where it has none."""
    every = matrices_of(evidence.table.channels.names).values()
    judged = [_of_matrix(evidence, elements, tolerance) for elements in every]
    return max(judged, key=lambda p: (ORDER.index(p.verdict), p.residual or 0.0), default=None)


def least_eigenvalues(matrices: np.ndarray) -> np.ndarray:
    """The least eigenvalue (n,) of the coherency matrices of Mueller matrices (n, 16), row by row."""
    return np.linalg.eigvalsh((matrices @ COHERENCY).reshape(-1, 4, 4))[:, 0]


def parts_of(read: Places) -> list[Places]:
    """Sets of elements that are those of a realisable matrix exactly where they are with 0 in place of all others.

    In means with turned frames, of light or of detector, and with mirror images the others cancel.
    """
    if read == EVERY:
        return [EVERY]
    rows = [{(r, c) for r in (0, k) for c in range(4) if {(0, c), (k, c)} <= read} for k in range(4)]
    columns = [{(r, c) for c in (0, k) for r in range(4) if {(r, 0), (r, k)} <= read} for k in range(4)]
    made = {frozenset(part) for part in (*rows, *columns) if len(part) > 1}
    made |= {part for part in (WITHOUT_45, WITHOUT_CIRCULAR) if part <= read}
    return sorted((p for p in made if (0, 0) in p and not any(p < other for other in made)), key=sorted)


def _of_matrix(evidence: TableEvidence, elements: Elements, tolerance: float) -> Property:
    table = evidence.table
    name = table.channels.names[elements[0, 0]]
    parts = parts_of(frozenset(elements))
    regions = RegionMeans.of(table, elements)
    count = int(regions.count.sum())
    if not parts or not count:
        reason = f"Not testable: no matrix of {name} was read with an element beside it."
        return without_residual("realisability", NOT_TESTABLE, tolerance, reason, matrices=0)
    chance = evidence.level / (len(parts) * (count + regions.count.size))
    means = _judged(regions.mean, regions.error, parts, chance)
    alone = _alone(table, elements, parts, regions, chance, tolerance)
    part, k = np.unravel_index(np.argmax(means.surely), means.least.shape)
    place = {**regions.regions.place(int(regions.number[k])), "channel": name}
    residual, error = -float(means.least[part, k]), float(np.nan_to_num(means.error[part, k], nan=np.inf))
    if alone.surely > (0 if regions.stated else MOST_BEYOND * count):
        residual, error = alone.residual, alone.error
        place = place_of(angles_of(table.layout, np.array([alone.cell]))[0], name)
    elif means.surely.max() <= tolerance and alone.perhaps <= MOST_BEYOND * count:
        # Noise lowers least eigenvalues, which are concave: what is realisable as it was read is so without it.
        residual, error, place = alone.most, 0.0, {}
    elif means.surely.max() <= tolerance:
        part, k = np.unravel_index(np.argmax(_most(means)), means.least.shape)
        residual, error = -float(means.least[part, k]), float(np.nan_to_num(means.error[part, k], nan=np.inf))
        place = {**regions.regions.place(int(regions.number[k])), "channel": name}
    bound = error if residual > 0 else max(residual + error, 0.0)
    verdict = verdict_of(residual, error, tolerance)
    judged = Property("realisability", verdict, max(residual, 0.0), bound, tolerance, place)
    judged.facts = {"matrices": count, "regions": int(regions.number.size), "surely_not": alone.surely}
    judged.facts |= {"not_as_read": alone.perhaps}
    judged.detail = _in_words(judged, regions)
    if verdict == FAIL:
        judged.detail += _hint(regions, parts, chance, tolerance)
    return _with_unread(judged, elements, parts)


def _judged(matrices: np.ndarray, u: np.ndarray, parts: Sequence[Places], chance: float) -> Judged:
    """Matrices (n, 16) and their uncertainties, in units of m00, by each of the parts."""
    masks = [np.array([float(place in part) for place in sorted(EVERY)]) for part in parts]
    least = [least_eigenvalues(matrices * mask) for mask in masks]
    return Judged(np.stack(least), np.stack([_error(u * mask, chance) for mask in masks]))


def _error(u: np.ndarray, chance: float) -> np.ndarray:
    """How far noise alone lowers least eigenvalues (n,), but for a chance, by uncertainties (n, 16) of the elements.

    By no more than the norm of the noise's coherency matrix, half the root of a weighted sum of squares, the tail of
    which is that of Laurent & Massart 2000, lemma 1.
    """
    x, variance = -np.log(chance), u**2
    norm = np.sqrt((variance**2).sum(axis=1))
    return np.sqrt(variance.sum(axis=1) + 2 * np.sqrt(x) * norm + 2 * x * variance.max(axis=1)) / 2


def _most(judged: Judged) -> np.ndarray:
    """By how much each may be below 0."""
    return np.nan_to_num(judged.error, nan=np.inf) - judged.least


def _alone(
    table: Table, elements: Elements, parts: Sequence[Places], regions: RegionMeans, chance: float, tolerance: float
) -> Alone:
    """Each reading, by its uncertainty or by the noise of its region."""
    surely = perhaps = 0
    worst, violations = (-np.inf, np.inf, 0), [np.zeros(0)]
    for cells, matrices, u in matrices_in_blocks(table, elements):
        first = matrices[:, :1]
        if not regions.stated:
            u = regions.noise[np.searchsorted(regions.number, regions.regions.numbers(table, cells))] * first
        judged = _judged(matrices / first, u / first, parts, chance)
        size = -judged.least.min(axis=0)
        surely += int(np.count_nonzero(judged.surely.max(axis=0) > tolerance))
        perhaps += int(np.count_nonzero(size > tolerance))
        part, k = np.unravel_index(np.argmax(judged.surely), judged.surely.shape)
        if judged.surely[part, k] > worst[0] - worst[1]:
            worst = -float(judged.least[part, k]), float(judged.error[part, k]), int(cells[k])
        violations.append(size)
    return Alone(surely, perhaps, float(np.quantile(np.concatenate(violations), 1 - MOST_BEYOND)), *worst)


def _in_words(judged: Property, regions: RegionMeans) -> str:
    """What was found, in how many matrices, and by what its error is known."""
    count, beyond = judged.facts["matrices"], judged.facts["not_as_read"]
    words = {
        PASS: "The Mueller matrices are mixtures of what optics do",
        FAIL: "No optics do what the Mueller matrices say",
        UNDECIDED: "The readings are too noisy, or too few, to say whether optics do what the Mueller matrices say",
    }[judged.verdict]
    noise = "by their stored uncertainties" if regions.stated else "by how neighbours differ"
    residual, bound = judged.residual or 0.0, judged.bound if judged.bound is not None else np.inf
    error = f"±{percent(bound)}" if np.isfinite(bound) else "with an error that has no bound"
    size = "as they were read" if judged.verdict == PASS and not judged.where else f"{error}, {noise}"
    least = f"of {percent(-residual)} of m00 at the least" if residual else "that is surely below 0"
    return (
        f"{words}: their coherency matrices have {'no' if not residual else 'an'} eigenvalue {least} ({size}), over"
        f" {count:,} matrices; {beyond:,} are not realisable by more than the tolerance, each as it was read."
    )


def _hint(regions: RegionMeans, parts: Sequence[Places], chance: float, tolerance: float) -> str:
    """What readings that are not realisable may be instead: of the other handedness, or ratios to m00."""

    def all_pass(matrices: np.ndarray) -> bool:
        return bool(_judged(matrices, regions.error, parts, chance).surely.max() <= tolerance)

    if all_pass(regions.mean * HANDEDNESS):
        return " With the other handedness of the detector's s, p and circular light they would be realisable."
    ratios = np.concatenate([regions.mean[:, :1], regions.mean[:, 1:] * regions.brightness[:, None]], axis=1)
    if np.abs(regions.mean[:, 1:] * regions.brightness[:, None]).max() <= 1 + tolerance and all_pass(ratios):
        return " As ratios to m00 they would be realisable: multiply them by m00."
    return ""


def _with_unread(judged: Property, elements: Elements, parts: Iterable[Places]) -> Property:
    """The property with what was not looked at."""
    looked_at = frozenset[tuple[int, int]]().union(*parts)
    others = [f"m{r}{c}" for r, c in sorted(EVERY - looked_at)]
    judged.facts["not_looked_at"] = others
    if others:
        judged.detail += f" Not looked at: {listed(others)}, without which it is a necessary condition alone."
    return judged

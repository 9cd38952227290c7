"""Helmholtz reciprocity f(wi, wo) = f(wo, wi) of a model, at the worst place of the closed hemisphere.

`worst_difference` and `difference_property` serve every property that says two values of f are the same.
"""

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from gonio.checks.certificate import (
    FAIL,
    UNDECIDED,
    Property,
    place_in_words,
    place_of,
    relative_difference,
    verdict_of,
)
from gonio.checks.direction_search import PairMap, climb, moved_by_rounding, pair, precision, swapped, values
from gonio.checks.model.evidence import ModelEvidence
from gonio.checks.model.sides import evidence_from, ways_of, worst_of
from gonio.models.brdf import AbstractBRDF
from gonio.models.folded import seen_from
from gonio.models.geometry.directions import Direction

STARTS = 8
ROUNDING_STEPS = 8

Values = Callable[[Direction, Direction], np.ndarray]
"""f of n pairs of directions, (n, channels)."""


def rounding_floor(peak: float) -> float:
    """Values below this many 1/sr do not count: the square of the rounding, times the largest value."""
    return precision() ** 2 * peak + float(np.finfo(np.dtype(jnp.result_type(float))).tiny)


@dataclasses.dataclass(frozen=True)
class WorstDifference:
    """Where two values that should be equal differ most, relative to their size."""

    residual: float
    angles: np.ndarray
    """(4,) of the worst pair."""
    channel: int
    channels: int
    undefined: np.ndarray
    """(k, 4): pairs at which one of the values is not finite."""
    pairs: int
    """How many were evaluated."""
    floor: float
    starts: np.ndarray
    """(n, 4): the worst pairs before the search."""


def worst_difference(a: Values, b: Values, angles: np.ndarray, rounds: int = 24) -> WorstDifference:
    """The largest relative difference of a and b at the pairs of `angles`, refined from the worst by so many rounds."""
    first = a(*pair(angles))
    finite = np.isfinite(first).all(axis=-1)
    floor = rounding_floor(float(np.max(np.abs(first[finite]), initial=0.0)))
    evaluated = [len(angles)]

    def differences(where: np.ndarray) -> np.ndarray:
        evaluated.append(len(where))
        wi, wo = pair(where)
        with np.errstate(all="ignore"):
            return relative_difference(a(wi, wo), b(wi, wo), floor)

    everywhere = differences(angles)
    undefined = ~np.isfinite(everywhere).all(axis=-1)
    over_channels = np.where(undefined, -1.0, np.max(np.nan_to_num(everywhere), axis=-1))
    starts = angles[np.argsort(over_channels)[::-1][:STARTS]]
    best, refined = climb(lambda where: np.max(differences(where), axis=-1), starts, rounds)
    k = int(np.nanargmax(refined)) if np.isfinite(refined).any() else 0
    difference = np.nan_to_num(differences(best[k : k + 1])[0])
    return WorstDifference(
        float(refined[k]),
        best[k],
        int(np.argmax(difference)),
        difference.size,
        angles[undefined],
        sum(evaluated),
        floor,
        starts,
    )


def rounding_of(brdf: AbstractBRDF, partner: PairMap, worst: WorstDifference) -> float:
    """The rounding in the relative difference between f and f at its `partner`: the largest at the worst places.

    Every component is moved by one unit in its last place, up or down at random, several times over. A difference
    that the model means stays the same; one that rounding makes changes. Four times its spread, and eight roundings.
    """
    return rounding_of_values(lambda wi, wo: values(brdf, wi, wo), lambda wi, wo: values(brdf, *partner(wi, wo)), worst)


def rounding_of_values(a: Values, b: Values, worst: WorstDifference) -> float:
    """`rounding_of` of any two values."""
    return max(_rounding(a, b, angles, worst.floor) for angles in (worst.angles[None], worst.starts))


def _rounding(first: Values, second: Values, angles: np.ndarray, floor: float) -> float:
    rng = np.random.default_rng(1)
    signed = []
    for _ in range(ROUNDING_STEPS):
        wi, wo = (moved_by_rounding(w, rng) for w in pair(angles))
        a, b = first(wi, wo), second(wi, wo)
        signed.append(relative_difference(a, b, floor) * np.sign(a - b))
    return float(np.max(4 * np.max(np.ptp(np.stack(signed), axis=0), axis=-1) + 8 * precision()))


def difference_of_pairs(brdf: AbstractBRDF, partner: PairMap, angles: np.ndarray, rounds: int = 24) -> WorstDifference:
    """The worst difference of f and f at its `partner` pair."""
    return worst_difference(
        lambda wi, wo: values(brdf, wi, wo), lambda wi, wo: values(brdf, *partner(wi, wo)), angles, rounds
    )


def difference_property(
    name: str, evidence: ModelEvidence, worst: WorstDifference, bound: float, tolerance: float, detail: str
) -> Property:
    """The property that two values are equal; it does not pass where f is not finite."""
    verdict = verdict_of(worst.residual, bound, tolerance)
    undefined = len(worst.undefined)
    if undefined:
        detail += f" f is not finite at {undefined} pairs, such as {place_in_words(place_of(worst.undefined[0]))}."
        verdict = FAIL if verdict == FAIL else UNDECIDED
    where = place_of(worst.angles, evidence.channel(worst.channel, worst.channels))
    facts = {"pairs": worst.pairs, "floor_per_sr": worst.floor, "pairs_without_a_value": undefined}
    return Property(name, verdict, worst.residual, bound, tolerance, where, detail, facts)


def model_reciprocity(evidence: ModelEvidence, tolerance: float) -> Property:
    """The largest relative difference between f(wi, wo) and f(wo, wi) that a search of the closed hemisphere finds.

    Of a surface that transmits also f_t(wi, wo)/n_o² against f_t(wo, wi)/n_i², n the index on the side of the exit.
    """
    judges = {way: _through if way[0] != way[1] else _same_side for way in ways_of(evidence.brdf)}
    return worst_of({way: judge(evidence_from(evidence, *way), evidence, tolerance) for way, judge in judges.items()})


def _same_side(turned: ModelEvidence, evidence: ModelEvidence, tolerance: float) -> Property:
    """Of light and detector on the same side."""
    worst = difference_of_pairs(turned.brdf, swapped, turned.angles)
    detail = (
        f"The largest 2|a−b|/(|a|+|b|) of f(wi, wo) and f(wo, wi) is {worst.residual:.2g}, searched over"
        f" {worst.pairs:,} pairs of the closed hemisphere and refined from the worst; values below {worst.floor:.1g}"
        " /sr do not count."
    )
    bound = rounding_of(turned.brdf, swapped, worst)
    return difference_property("reciprocity", evidence, worst, bound, tolerance, detail)


def _through(turned: ModelEvidence, evidence: ModelEvidence, tolerance: float) -> Property:
    """Of light in front and the detector behind, against both exchanged."""
    n2, back = np.asarray(evidence.brdf.index_behind, float) ** 2, seen_from(evidence.brdf, -1, 1)

    def forth(wi: Direction, wo: Direction) -> np.ndarray:
        return values(turned.brdf, wi, wo) / n2

    def exchanged(wi: Direction, wo: Direction) -> np.ndarray:
        return values(back, wo, wi)

    worst = worst_difference(forth, exchanged, turned.angles)
    form = "f(wi, wo)" if np.all(n2 == 1) else "f(wi, wo)/n²"
    detail = (
        f"The largest 2|a−b|/(|a|+|b|) of {form}, from front to back, and f(wo, wi), from back to front, is"
        f" {worst.residual:.2g}, searched over {worst.pairs:,} pairs; values below {worst.floor:.1g} /sr do not count."
    )
    return difference_property(
        "reciprocity", evidence, worst, rounding_of_values(forth, exchanged, worst), tolerance, detail
    )

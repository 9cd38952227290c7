"""The sides between which a surface scatters, each judged as a surface that reflects."""

import functools
from collections.abc import Callable

from gonio.checks.certificate import FAIL, NOT_APPLICABLE, PASS, UNDECIDED, Property
from gonio.checks.model.evidence import ModelEvidence
from gonio.models.brdf import AbstractBRDF
from gonio.models.folded import seen_from
from gonio.models.geometry.sides import Hemispheres, side_in_words

Judge = Callable[[ModelEvidence, float], Property]

WAYS = {Hemispheres.REFLECTION: (1, 1), Hemispheres.TRANSMISSION: (1, -1), Hemispheres.BACK: (-1, -1)}
"""Sides of (light, detector), 1 in front and -1 behind, of what a surface may scatter."""


def ways_of(brdf: AbstractBRDF) -> list[tuple[int, int]]:
    """Sides of (light, detector) of what a surface scatters; light from behind through it is left to reciprocity."""
    return [way for one, way in WAYS.items() if one in brdf.hemispheres]


def worst_of(judged: dict[tuple[int, int], Property], in_words: Callable[[int, int], str] = side_in_words) -> Property:
    """The worst of the properties of several ways, its sentence led by the name of that way, `in_words`."""
    order = {FAIL: 0, UNDECIDED: 1, PASS: 2, NOT_APPLICABLE: 3}
    way, worst = min(judged.items(), key=lambda item: (order.get(item[1].verdict, 4), -(item[1].residual or 0.0)))
    if len(judged) > 1 or way != (1, 1):
        words = in_words(*way)
        worst.detail = f"{words[0].upper()}{words[1:]}: {worst.detail[0].lower()}{worst.detail[1:]}"
        worst.where |= {name: 180 - worst.where[name] for name, side in zip(("theta_i", "theta_o"), way, strict=True)
                        if side < 0 and name in worst.where}  # fmt: skip
    return worst


def on_every_side(judge: Judge) -> Judge:
    """The judge of a property for all that a surface scatters: each way by itself, and the worst counts."""

    @functools.wraps(judge)
    def judged(evidence: ModelEvidence, tolerance: float) -> Property:
        ways = ways_of(evidence.brdf)
        if evidence.reference is not None:
            ways += [way for way in ways_of(evidence.reference) if way not in ways]
        return worst_of({way: judge(evidence_from(evidence, *way), tolerance) for way in ways})

    return judged


def evidence_from(evidence: ModelEvidence, light: int, detector: int) -> ModelEvidence:
    """The evidence with light and detector on these sides, both turned to the front."""
    if (light, detector) == (1, 1):
        return evidence
    reference = evidence.reference
    turned = ModelEvidence(
        seen_from(evidence.brdf, light, detector),
        evidence.channels,
        None if reference is None else seen_from(reference, light, detector),
    )
    turned.__dict__["angles"] = evidence.angles  # those near the lobes of the surface itself
    return turned

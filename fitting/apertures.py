"""The apertures of a table, and what a fit says of having averaged over them or not."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from gonio.data.table import Table

if TYPE_CHECKING:
    from gonio.fitting.uncertainty.optimum import Optimum, ParameterEstimate

HALF_ANGLE_MAX = math.pi / 4
NOTEWORTHY = 0.5  # standard uncertainties that a number is off by
UNRESOLVED = 1.0  # standard uncertainties that what is neglected may move a number by
SIDES = ("source", "detector")


def half_angles_of(table: Table) -> tuple[float, float]:
    """Half-angles of the discs of light and detector, radians; 0 for points and where nothing is stated.

    From the solid angles that the table stores, else from the instrument of its provenance. Up to 45°: what is larger
    is no aperture of a gonioreflectometer, counts as a point, and is noted.
    """
    source, detector = (angle if angle <= HALF_ANGLE_MAX * (1 + 1e-9) else 0.0 for angle in _stated(table))
    return source, detector


def wide_notes(table: Table) -> list[str]:
    """A note on each aperture that is too wide to be averaged over."""
    return [
        f"the aperture of the {side} has a half-angle of {math.degrees(angle):.3g}°: averages are made up to 45°, and "
        "the model was compared at its centre"
        for side, angle in zip(SIDES, _stated(table), strict=True)
        if angle > HALF_ANGLE_MAX * (1 + 1e-9)
    ]


def _stated(table: Table) -> tuple[float, float]:
    instrument = table.provenance.get("instrument")
    stated = [instrument.get(f"{side}_half_angle_deg") if isinstance(instrument, dict) else None for side in SIDES]
    solid_angles = (table.source_solid_angle, table.receiver_solid_angle)
    source, detector = map(_half_angle, solid_angles, stated)
    return source, detector


def _half_angle(solid_angle: float | None, stated_deg: Any) -> float:
    if solid_angle is not None:
        angle = 2.0 * math.asin(min(math.sqrt(max(solid_angle, 0.0) / (4 * math.pi)), 1.0))
    else:
        angle = math.radians(stated_deg) if isinstance(stated_deg, int | float) and 0.0 < stated_deg <= 180 else 0.0
    return angle


def aperture_facts(optima: "list[Optimum]", estimates: "list[list[ParameterEstimate]]") -> dict[str, Any] | None:
    """What a result keeps of the averages over the apertures' discs; None for points."""
    averages = [e.averages for e in optima if e.averages is not None]
    if not averages:
        return None
    rules = np.concatenate([a.rules for a in averages])
    from gonio.fitting.problem.disc_averages import disc_rules

    counts = np.asarray(disc_rules(averages[0].half_angles).sizes)[rules]
    shifts = [
        {"name": p.label, "shift": float(d), "in_standard_uncertainties": float(d / p.standard_uncertainty)}
        for a, each in zip(averages, estimates, strict=True)
        for d, p in zip(a.shift, each, strict=True)
        if p.status == "determined" and p.standard_uncertainty > 0 and d
    ]
    largest = max(shifts, key=lambda s: abs(s["in_standard_uncertainties"]), default=None)
    facts = {
        "averaged": averages[0].made,
        "half_angles_deg": dict(zip(SIDES, map(math.degrees, averages[0].half_angles), strict=True)),
        "cells": rules.size, "cells_averaged": int(np.count_nonzero(rules)),
        "directions": [int(counts[rules > 0].min(initial=counts.max())), int(counts.max())],
        "neglected": max(a.neglected for a in averages), "at_the_centres": largest,
    }  # fmt: skip
    return facts | {"sentence": _sentence(facts)}


def _sentence(facts: dict[str, Any]) -> str:
    """What was done, and by how much it matters."""
    discs = " and ".join(f"{angle:.3g}° ({side})" for side, angle in facts["half_angles_deg"].items() if angle)
    largest, off = facts["at_the_centres"], ""
    if largest is not None:
        size, away = abs(largest["in_standard_uncertainties"]), "large" if largest["shift"] > 0 else "small"
        off = f"{largest['name']} {abs(largest['shift']):.2g} ({size:.2g} standard uncertainties) too {away}"
    if not facts["averaged"]:
        by = f"; by estimate {off}" if off else ""
        return (
            f"readings are averages over discs of half-angle {discs}, and the model was compared at their centres{by}"
        )
    few, many = facts["directions"]
    where = f"at {facts['cells_averaged']:,} of {facts['cells']:,} cells, over {few} to {many} pairs of directions"
    return (
        f"the model is averaged as the readings are, over discs of half-angle {discs}: "
        + (where if facts["cells_averaged"] else "nowhere, as the numbers do not notice it")
        + (f"; at the centres {off}" if off else "")
    )


def aperture_notes(facts: dict[str, Any] | None) -> list[str]:
    """A note where a number is off because no averages were made, or where they are not fine enough."""
    if facts is None:
        return []
    largest = facts["at_the_centres"]
    if not facts["averaged"]:
        noteworthy = largest is not None and abs(largest["in_standard_uncertainties"]) >= NOTEWORTHY
        return [f"{facts['sentence']}; leave out --aperture ignore"] if noteworthy else []
    if facts["neglected"] <= UNRESOLVED:
        return []
    return [
        "the averages over the apertures are not fine enough everywhere: what is neglected may move a number by "
        f"{facts['neglected']:.2g} standard uncertainties; leave out readings near the highlight or the horizon"
    ]

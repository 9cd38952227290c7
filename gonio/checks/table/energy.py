"""Energy conservation of a table: directional albedos at its incidences, with a bound from its resolution."""

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from gonio.checks.albedos import Albedos, energy_property, with_hemispherical
from gonio.checks.certificate import FAIL, PASS, UNDECIDED, Property, without_residual
from gonio.checks.hidden_lobes import NARROWEST, Features, at_width
from gonio.checks.table.albedos.two_sided import Part, albedos_of_parts, summed, two_sided_albedos
from gonio.checks.table.energy_words import degrees_up, incidences_judged, least_width, remedy, series_of, what_may_hide
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.further_readings import FurtherBySide
from gonio.checks.table.one_azimuth import ISOTROPIC, isotropy_at_normal_incidence, taken_as_mirrored
from gonio.checks.table.pairs.displacement import cosine_error, misalignment, miscalibration
from gonio.checks.table.states_of_light import (
    LightOfState,
    light_of_states,
    lit_by_states,
    not_all_of_the_light,
    states_not_looked_at,
    with_brightest_states,
)
from gonio.checks.table.statistics.counts import critical, sidak
from gonio.data.channels import Channels
from gonio.data.interpolation.sheets import sheet_of
from gonio.data.polarisation import is_polarised
from gonio.data.table import Table
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.models.geometry.sides import FRONT

if TYPE_CHECKING:
    from gonio.fitting.result import FitResult

IN_BOUNDS = " Bounds hold what the instrument states of its alignment and calibration (k = 2, up to {most})."
COMMON_IN_BOUNDS = (
    " Bounds hold what all readings share of their stored uncertainties (k = 2, up to {most}), as they scatter less."
)
CONTRADICTED = (
    " But at normal incidence f depends on the detector's azimuth: the surface is not isotropic, and the side of the"
    " plane of incidence that was not read may differ from the other."
)
ONE_SIDE = (
    " But one side of the plane of incidence was read, and no readings at normal incidence say that the surface is"
    " isotropic: a brushed or leaning one may send less to the other side."
)
STANDARD_UNCERTAINTIES = 2.0
"""How many of the readings' noise the bounds of albedos hold."""


def mirror_reach(table: Table, feature_width: float) -> float:
    """How near to the mirror direction a reading has to be, radians: the apertures', or the stated features' radius."""
    solid = [s or 0.0 for s in (table.source_solid_angle, table.receiver_solid_angle)]
    apertures = sum(np.arccos(np.clip(1 - s / (2 * np.pi), -1, 1)) for s in solid)
    return max(NARROWEST, float(apertures), feature_width / 2 + 1e-9)


def table_albedos(table: Table, feature_width: float = 0.0, further: Table | None = None) -> Albedos | str:
    """Directional albedos of a table of any layout, or why there are none; of both hemispheres their sum.

    No lobe is narrower than `feature_width`, radians; `further` readings limit what hides at the mirror direction.
    """
    if (sheet := sheet_of(table)) is not None:
        from gonio.checks.table.sheet import sheet_albedos

        return sheet_albedos(sheet, table.channels.names)
    features, beside = features_of(table, feature_width), FurtherBySide(further)
    if table.sides == FRONT:
        return _albedos(table, beside.added(features))
    return two_sided_albedos(table, lambda p: _albedos(p.table, beside.added(features, p.light, p.detector), p.bend))


def features_of(table: Table, feature_width: float) -> Features:
    """What lobes are looked for with that hide where the mirror direction was not read."""
    return Features(mirror_reach(table, 0.0), feature_width)


def albedos_by_side(table: Table, feature_width: float = 0.0) -> dict[tuple[int, int], Albedos | str]:
    """Directional albedos, or why there are none, by the sides of light and detector: 1 in front, −1 behind.

    Those with the detector on the other side are transmittances. Angles of incidence are from the light's normal. No
    lobe is narrower than `feature_width`, radians.
    """
    if (sheet := sheet_of(table)) is not None:
        from gonio.checks.table.sheet import sheet_albedos_by_side

        return sheet_albedos_by_side(sheet, table.channels.names)
    features = features_of(table, feature_width)
    if table.sides == FRONT:
        return {(1, 1): _albedos(table, features)}
    return albedos_of_parts(table, lambda part: _albedos(part.table, features, part.bend))


def _albedos(table: Table, features: Features, bend: float = 1.0) -> Albedos | str:
    """Those of the front; `bend`: a lobe hides at sin θo = bend · sin θi."""
    if table.interpolant is not None:
        from gonio.checks.table.albedos.scattered import warped_albedos

        return warped_albedos(table)
    if table.layout.outgoing_grid() is not None:
        from gonio.checks.table.albedos.on_grid import grid_albedos

        return grid_albedos(table, features, bend)
    if table.layout.in_half_vectors:
        from gonio.checks.table.albedos.half_difference import half_difference_albedos

        return half_difference_albedos(table, features)
    if table.layout.in_one_plane:
        return "readings in one plane do not cover the hemisphere"
    from gonio.checks.table.albedos.scattered import scattered_albedos

    return scattered_albedos(table.as_list() if table.layout.gridded else table, features, bend)


def table_energy(evidence: TableEvidence, tolerance: float) -> Property:
    """How far the albedo at the incidences of a table exceeds 1, as far as its resolution allows a statement.

    The level of the evidence: chance that the readings' stored noise alone exceeds its share of the bounds at any
    incidence.
    """
    names = evidence.table.channels.names
    judged = _by_readings_or_model(_of_states(evidence) if is_polarised(names) else evidence, tolerance)
    judged.detail += states_not_looked_at(names)
    lacking = not_all_of_the_light(names)
    if lacking and judged.verdict != FAIL and judged.residual is not None:
        judged.verdict = UNDECIDED
        judged.detail += lacking
    return _of_both_sides(judged, evidence) if taken_as_mirrored(evidence.table) else judged


def _of_states(evidence: TableEvidence) -> TableEvidence:
    """The same with what becomes of light of each state in place of polarised channels."""
    table, further = evidence.table, evidence.further
    states = _states(table, table.channels)
    further = None if further is None else lit_by_states(further, states)
    return dataclasses.replace(
        evidence, table=lit_by_states(table, states), further=further, albedos=None, made=None, polarised=table.channels
    )


def _states(table: Table, channels: Channels) -> list[LightOfState]:
    """The states of light of channels; of 45° and circular light mirror images cancel."""
    return light_of_states(channels.names, (1,) if taken_as_mirrored(table) else (1, 2, 3))


def _of_both_sides(judged: Property, evidence: TableEvidence) -> Property:
    """What is decided by readings on one side of the plane of incidence, for a surface that need not be symmetric.

    It stands where the readings at normal incidence are those of an isotropic surface. Else nothing fails but what one
    side alone sends back too much of; and a pass takes the surface as symmetric, unless those readings speak against.
    """
    if judged.verdict == UNDECIDED or judged.residual is None or judged.bound is None or judged.tolerance is None:
        return judged
    isotropy = isotropy_at_normal_incidence(evidence, ISOTROPIC)
    judged.facts["isotropy_at_normal_incidence"] = isotropy.verdict
    if isotropy.facts.get("largest_violation", np.inf) <= ISOTROPIC:
        return judged
    one_side = (1 + judged.residual - judged.bound) / 2
    if judged.verdict == FAIL and one_side > 1 + judged.tolerance:
        judged.detail += " The side that was read does so alone."
    elif isotropy.verdict != FAIL and judged.verdict == PASS:
        judged.assumes = "; ".join(filter(None, [judged.assumes, "the surface is mirror symmetric"]))
    else:
        judged.verdict = UNDECIDED
        judged.detail += CONTRADICTED if isotropy.verdict == FAIL else ONE_SIDE
    return judged


def _by_readings_or_model(evidence: TableEvidence, tolerance: float) -> Property:
    albedos = evidence.albedos
    if albedos is None:
        albedos = table_albedos(evidence.with_copies_as_one, evidence.feature_width, evidence.further)
    if isinstance(albedos, str):
        detail = f"The albedo of this table cannot be integrated: {albedos}."
        judged = without_residual("energy", UNDECIDED, tolerance, detail, incidences=0)
    else:
        judged = _judged(albedos, evidence, tolerance)
    if judged.verdict != UNDECIDED or evidence.model is None:
        return judged
    assisted = _assisted(evidence, albedos)
    if isinstance(assisted, str):
        judged.detail += f" A model does not help: {assisted}."
        return judged
    helped = _judged(assisted, evidence, tolerance)
    fitted = evidence.fitted
    if helped.verdict == UNDECIDED and evidence.refitted is not fitted:
        return _by_readings_or_model(dataclasses.replace(evidence, made=evidence.refitted, albedos=albedos), tolerance)
    helped.facts |= {
        "assisted_by": fitted.expression if fitted else "",
        "without_model": judged.facts.get("largest_albedo"),
    }
    helped.facts["bound_without_model"] = judged.bound
    if helped.verdict != UNDECIDED and fitted is not None:
        follows = f"between the readings the surface follows {fitted.requested} as it does at them"
        helped.assumes = "; ".join(filter(None, [follows, helped.assumes]))
    helped.detail += f" Without the model it is undecided: {judged.detail}"
    return helped


def deciding_by_side(evidence: TableEvidence) -> dict[tuple[int, int], Albedos | str]:
    """The albedos that leave energy undecided, by the sides of light and detector; of a model, if one helps."""
    assisted = "no model" if evidence.model is None else _assisted_by_side(evidence)
    if not isinstance(assisted, str) and not any(isinstance(of_side, str) for of_side in assisted.values()):
        return assisted
    alone = albedos_by_side(evidence.with_copies_as_one, evidence.feature_width)
    return (
        alone if isinstance(assisted, str) else {k: alone[k] if isinstance(a, str) else a for k, a in assisted.items()}
    )


def _assisted(evidence: TableEvidence, alone: Albedos | str) -> Albedos | str:
    """The albedos with the help of the model; `alone`: those of the table without it."""
    by_side = _assisted_by_side(evidence, alone)
    if isinstance(by_side, str):
        return by_side
    return by_side[1, 1] if evidence.table.sides == FRONT else summed(by_side)


def _assisted_by_side(
    evidence: TableEvidence, alone: Albedos | str | None = None
) -> dict[tuple[int, int], Albedos | str] | str:
    table, features = evidence.table, features_of(evidence.table, evidence.feature_width)
    if table.interpolant is not None:
        return "the table brings its own interpolation between the readings"
    if table.layout.in_one_plane:
        return "readings in one plane tell nothing of the rest of the hemisphere"
    try:
        fitted = evidence.fitted
    except GonioError as error:  # too few readings for the model
        return str(error)
    assert fitted is not None
    beside = FurtherBySide(evidence.further)
    if table.sides == FRONT:
        return {(1, 1): _assisted_front(Part(table), fitted, beside.added(features), alone)}
    return albedos_of_parts(table, lambda p: _assisted_front(p, fitted, beside.added(features, p.light, p.detector)))


def _assisted_front(
    part: Part, fitted: "FitResult", features: Features, alone: Albedos | str | None = None
) -> Albedos | str:
    """Those of one pair of sides; `fitted` was made to all of the table. Where readings alone bound them more closely
    than the model does, which may be badly determined, it is left out. `alone`: by readings, where known before."""
    assisted = _by_model(part, fitted, features)
    if alone is None:
        alone = _albedos(part.table, features, part.bend)
    return assisted if isinstance(assisted, str) or isinstance(alone, str) else assisted.with_closer(alone)


def _by_model(part: Part, fitted: "FitResult", features: Features) -> Albedos | str:
    table = part.table
    if table.layout.outgoing_grid() is not None:
        from gonio.checks.table.albedos.model_assisted import assisted_albedos

        return assisted_albedos(part, fitted, features)
    if part.bend != 1.0:
        return "lists of refracted light are integrated by their own readings alone"
    from gonio.checks.table.albedos.assisted_scattered import assisted_by_nearest

    listed = table if table.layout.in_half_vectors else table.as_list() if table.layout.gridded else table
    return assisted_by_nearest(part._replace(table=listed), fitted, features)


def _judged(albedos: Albedos, evidence: TableEvidence, tolerance: float) -> Property:
    enough = critical(sidak(evidence.level, albedos.noise.size))
    more = (max(enough, STANDARD_UNCERTAINTIES) - STANDARD_UNCERTAINTIES) * albedos.noise
    stated = _of_instrument(albedos, evidence.table)
    more = more + stated
    names = evidence.table.channels.names if len(evidence.table.channels) > 1 else ()
    albedos = dataclasses.replace(albedos, above=albedos.above + more, below=albedos.below + more, channels=names)
    if evidence.polarised is not None:
        groups = _states(evidence.table, evidence.polarised)
        albedos = with_brightest_states(albedos, groups, evidence.polarised.names)
    judged = with_hemispherical(energy_property(albedos, tolerance), albedos)
    judged.series = series_of(albedos)
    if evidence.polarised is not None:
        judged.facts["of_channels"] = list(albedos.channels)
    with np.errstate(invalid="ignore"):
        refused = ~np.all(albedos.value + albedos.above <= 1 + tolerance, axis=1)
    passes_below = float(np.degrees(albedos.theta_i[refused].min())) if refused.any() else 90.0
    judged.facts |= {
        "passes_below_theta_i_deg": passes_below,
        "noise_of_albedo": float(np.max(albedos.noise)),
        "incidences_without_mirror_direction": int(albedos.unseen.sum()),
        "not_judged_theta_i_deg": np.unique(np.round(np.degrees(albedos.theta_i[albedos.partial]), 3)).tolist(),
    }
    judged.detail += incidences_judged(albedos)
    if (most := float(np.nanmax(stated, initial=0.0))) > 0:
        judged.facts["instrument_uncertainty_of_albedo"] = most
        words = IN_BOUNDS if "instrument" in evidence.table.provenance else COMMON_IN_BOUNDS
        judged.detail += words.format(most=percent(most))
    if judged.verdict == UNDECIDED and passes_below > 1:
        judged.detail += f" Below θi {passes_below:.4g}° it passes."
    if albedos.unseen.any():
        _say_what_may_hide(judged, albedos, evidence.feature_width)
    elif judged.verdict == UNDECIDED:
        needed = albedos.step_needed[refused]
        step = float(np.degrees(np.nanmin(needed))) if np.isfinite(needed).any() else None
        judged.facts["step_needed_deg"] = step
        judged.detail += remedy(evidence.table.layout, step)
        if evidence.model is None and evidence.table.interpolant is None:
            judged.detail += " Or a model may carry the verdict, as far as the readings follow it: --model auto."
    return judged


def _of_instrument(albedos: Albedos, table: Table) -> np.ndarray:
    """What the instrument states of its alignment and calibration, in the albedos (n, C), k = 2.

    Light that comes from beside where it should lights the sample by another cosine.
    """
    share = miscalibration(table) + cosine_error(np.cos(albedos.theta_i), misalignment(table))
    return np.abs(albedos.value) * share[:, None]


def _say_what_may_hide(judged: Property, albedos: Albedos, width: float) -> None:
    """What a verdict assumes of lobes that no reading shows, or of which width on it would be a pass."""
    assert judged.tolerance is not None
    least = least_width(albedos, judged.tolerance)
    judged.facts |= {
        "passes_with_feature_width_deg": None if least is None else degrees_up(least),
        "most_hidden_albedo": float(np.max(at_width(albedos.hidden, width))),
    }
    if judged.verdict == PASS and width:
        judged.assumes = f"no lobe is narrower than {np.degrees(width):.3g}°"
    judged.detail += what_may_hide(albedos, judged.verdict, width, least)

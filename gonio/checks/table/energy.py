"""Energy conservation of a table: directional albedos at its incidences, with a bound from its resolution."""

import dataclasses

import numpy as np

from gonio.checks.albedos import Albedos, energy_property, with_hemispherical
from gonio.checks.certificate import UNDECIDED, Property, without_residual
from gonio.checks.table.count_statistics import critical, sidak
from gonio.checks.table.evidence import TableEvidence
from gonio.data.interpolation.scattering_blocks import sheet_of
from gonio.data.layouts import Layout
from gonio.data.table import Table
from gonio.models.errors import GonioError
from gonio.models.geometry.sides import FRONT

MIRROR_REACH = 1e-3
"""Radians: a lobe in the mirror direction is at least this wide, so that a node so near cannot miss it."""

OR_THROUGH = ", or where light goes straight through or is refracted to"

STANDARD_UNCERTAINTIES = 2.0
"""How many of the readings' noise the bounds of albedos hold."""


def mirror_reach(table: Table, feature_width: float) -> float:
    """How near to the mirror direction a reading has to be, radians: the apertures', or the stated features' radius."""
    solid = [s or 0.0 for s in (table.source_solid_angle, table.receiver_solid_angle)]
    apertures = sum(np.arccos(np.clip(1 - s / (2 * np.pi), -1, 1)) for s in solid)
    return max(MIRROR_REACH, float(apertures), feature_width / 2 + 1e-9)


def table_albedos(table: Table, feature_width: float = 0.0) -> Albedos | str:
    """Directional albedos of a table of any layout, or why there are none; of both hemispheres their sum."""
    if (sheet := sheet_of(table)) is not None:
        from gonio.checks.table.sheet import sheet_albedos

        return sheet_albedos(sheet, table.channels.names)
    reach = mirror_reach(table, feature_width)
    if table.sides == FRONT:
        return _albedos(table, reach)
    from gonio.checks.table.albedo_two_sided import two_sided_albedos

    return two_sided_albedos(table, lambda part, bend: _albedos(part, reach, bend))


def albedos_by_side(table: Table, feature_width: float = 0.0) -> dict[tuple[int, int], Albedos | str]:
    """Directional albedos, or why there are none, by the sides of light and detector: 1 in front, −1 behind.

    Those with the detector on the other side are transmittances. Angles of incidence are from the light's normal. No
    lobe is narrower than `feature_width`, radians.
    """
    if (sheet := sheet_of(table)) is not None:
        from gonio.checks.table.sheet import sheet_albedos_by_side

        return sheet_albedos_by_side(sheet, table.channels.names)
    reach = mirror_reach(table, feature_width)
    if table.sides == FRONT:
        return {(1, 1): _albedos(table, reach)}
    from gonio.checks.table.albedo_two_sided import albedos_of_parts

    return albedos_of_parts(table, lambda part, bend: _albedos(part, reach, bend))


def _albedos(table: Table, reach: float, bend: float = 1.0) -> Albedos | str:
    """Those of the front; `bend`: a lobe hides at sin θo = bend · sin θi."""
    if table.interpolant is not None:
        from gonio.checks.table.albedo_scattered import warped_albedos

        return warped_albedos(table)
    if table.layout.outgoing_grid() is not None:
        from gonio.checks.table.albedo_on_grid import grid_albedos

        return grid_albedos(table, reach, bend)
    if table.layout.in_half_vectors:
        from gonio.checks.table.albedo_half_difference import half_difference_albedos

        return half_difference_albedos(table, reach)
    if table.layout.in_one_plane:
        return "readings in one plane do not cover the hemisphere"
    from gonio.checks.table.albedo_scattered import scattered_albedos

    return scattered_albedos(table.as_list() if table.layout.gridded else table, reach, bend)


def table_energy(evidence: TableEvidence, tolerance: float) -> Property:
    """How far the albedo at the incidences of a table exceeds 1, as far as its resolution allows a statement.

    The level of the evidence: chance that the readings' stored noise alone exceeds its share of the bounds at any
    incidence.
    """
    albedos = table_albedos(evidence.table, evidence.feature_width)
    if isinstance(albedos, str):
        detail = f"The albedo of this table cannot be integrated: {albedos}."
        return without_residual("energy", UNDECIDED, tolerance, detail, incidences=0)
    judged = _judged(albedos, evidence, tolerance)
    if judged.verdict != UNDECIDED or evidence.model is None:
        return judged
    assisted = _assisted(evidence)
    if isinstance(assisted, str):
        judged.detail += f" A model does not help: {assisted}."
        return judged
    helped = _judged(assisted, evidence, tolerance)
    fitted = evidence.fitted
    helped.facts |= {
        "assisted_by": fitted.expression if fitted else "",
        "without_model": judged.facts["largest_albedo"],
    }
    helped.facts["bound_without_model"] = judged.bound
    helped.detail += f" Without the model it is undecided: {judged.detail}"
    return helped


def _assisted(evidence: TableEvidence) -> Albedos | str:
    if evidence.table.sides != FRONT:
        return "it helps tables of reflection from the front alone"
    from gonio.checks.table.albedo_on_grid import hemisphere_grid
    from gonio.checks.table.model_assisted import assisted_albedos

    grid = hemisphere_grid(evidence.table.layout)
    if isinstance(grid, str):
        return grid
    try:
        fitted = evidence.fitted
    except GonioError as error:  # too few readings for the model
        return str(error)
    assert fitted is not None
    return assisted_albedos(evidence.table, fitted, mirror_reach(evidence.table, evidence.feature_width))


def _judged(albedos: Albedos, evidence: TableEvidence, tolerance: float) -> Property:
    enough = critical(sidak(evidence.level, albedos.noise.size))
    more = (max(enough, STANDARD_UNCERTAINTIES) - STANDARD_UNCERTAINTIES) * albedos.noise
    names = evidence.table.channels.names if len(evidence.table.channels) > 1 else ()
    albedos = dataclasses.replace(albedos, above=albedos.above + more, below=albedos.below + more, channels=names)
    judged = with_hemispherical(energy_property(albedos, tolerance), albedos)
    judged.series = _series(albedos)
    with np.errstate(invalid="ignore"):
        refused = ~np.all(albedos.value + albedos.above <= 1 + tolerance, axis=1)
    passes_below = float(np.degrees(albedos.theta_i[refused].min())) if refused.any() else 90.0
    judged.facts |= {
        "passes_below_theta_i_deg": passes_below,
        "noise_of_albedo": float(np.max(albedos.noise)),
        "incidences_without_mirror_direction": int(albedos.unseen.sum()),
        "not_judged_theta_i_deg": np.unique(np.round(np.degrees(albedos.theta_i[albedos.partial]), 3)).tolist(),
    }
    judged.detail += _incidences(albedos)
    if judged.verdict == UNDECIDED and passes_below > 1:
        judged.detail += f" Below θi {passes_below:.4g}° it passes."
    if albedos.unseen.any():
        judged.detail += (
            f" The readings leave out the mirror direction{OR_THROUGH * bool(albedos.shares)}, where a lobe narrower"
            " than the grid may hide: read there too, or state the width of the narrowest feature."
        )
    elif judged.verdict == UNDECIDED:
        needed = albedos.step_needed[refused]
        step = float(np.degrees(np.nanmin(needed))) if np.isfinite(needed).any() else None
        judged.facts["step_needed_deg"] = step
        judged.detail += _remedy(evidence.table.layout, step)
        grid = evidence.table.sides == FRONT and evidence.table.layout.outgoing_grid() is not None
        if evidence.model is None and grid:
            judged.detail += " Or a model may carry the verdict, as far as the readings follow it: --model auto."
    return judged


def _incidences(albedos: Albedos) -> str:
    """Which incidences were judged, and which were read too little for it."""
    whole, part = (np.degrees(np.unique(np.round(albedos.theta_i[p], 6))) for p in (~albedos.partial, albedos.partial))
    ranges = [f"{a[0]:.4g}°" if a.size == 1 else f"{a[0]:.4g}–{a[-1]:.4g}° ({a.size})" for a in (whole, part) if a.size]
    text = f" Judged at θi {ranges[0]}." if whole.size else ""
    if part.size:
        text += (
            f" Undecided at θi {ranges[-1]}: too little of the hemisphere was read there; the albedo is at least that."
        )
    return text


def _remedy(layout: Layout, needed: float | None) -> str:
    if needed is None:
        return " The grid does not resolve the lobe well enough: a finer one, or half/difference angles, would."
    step = np.degrees(np.median(np.diff(layout.axes["theta_o"])))
    if needed >= step:
        return " Its noise, its rim or its missing cells leave that open, rather than its resolution."
    return (
        f" The grid does not resolve the lobe: by its height and slopes a step of about {needed:.2g}°"
        f" (here {step:.2g}°) is needed, or half/difference angles."
    )


def _series(albedos: Albedos) -> dict[str, list]:
    # From the front, or, where all light was behind, by its angles from the normal there.
    lit = albedos.theta_i < np.pi / 2
    from_normal = np.where(lit, albedos.theta_i, np.nan if lit.any() else np.pi - albedos.theta_i)
    theta = np.unique(from_normal[np.isfinite(from_normal)])
    groups = [from_normal == t for t in theta]
    value, bound = (np.stack([v[group].max(axis=0) for group in groups]) for v in (albedos.value, albedos.below))
    return {"theta_i_deg": np.degrees(theta).tolist(), "albedo": value.T.tolist(), "bound": bound.T.tolist()}

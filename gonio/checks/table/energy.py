"""Energy conservation of a table: directional albedos at its incidences, with a bound from its resolution."""

import numpy as np

from gonio.checks.certificate import UNDECIDED, Property
from gonio.checks.hemispherical_albedo import hemispherical
from gonio.checks.model.energy import energy_property, with_hemispherical
from gonio.checks.table.albedo_on_grid import Albedos, grid_albedos, no_albedo
from gonio.checks.table.count_statistics import critical, sidak
from gonio.checks.table.significance import LEVEL
from gonio.data.table import Table

MIRROR_REACH = 1e-3
"""Radians: a lobe in the mirror direction is at least this wide, so that a node so near cannot miss it."""


def reach(table: Table, feature_width: float) -> float:
    """How near to the mirror direction a reading has to be, radians: the apertures', or the stated features' radius."""
    solid = [s or 0.0 for s in (table.source_solid_angle, table.receiver_solid_angle)]
    apertures = sum(np.arccos(np.clip(1 - s / (2 * np.pi), -1, 1)) for s in solid)
    return max(MIRROR_REACH, float(apertures), feature_width / 2 + 1e-9)


def table_albedos(table: Table, feature_width: float = 0.0) -> Albedos:
    """Directional albedos of a table of any layout, or why there are none."""
    near = reach(table, feature_width)
    if table.interpolant is not None:
        from gonio.checks.table.albedo_scattered import warped_albedos

        return warped_albedos(table)
    if table.layout.outgoing_grid() is not None:
        return grid_albedos(table, near)
    if table.layout.in_half_vectors:
        from gonio.checks.table.albedo_half_difference import half_difference_albedos

        return half_difference_albedos(table, near)
    if table.layout.in_one_plane:
        return no_albedo("readings in one plane do not cover the hemisphere")
    if table.layout.gridded:
        return no_albedo(f"no rule integrates a grid of layout {table.layout.name}")
    from gonio.checks.table.albedo_scattered import scattered_albedos

    return scattered_albedos(table, near)


def table_energy(table: Table, tolerance: float, feature_width: float = 0.0, level: float = LEVEL) -> Property:
    """How far the albedo at the incidences of a table exceeds 1, as far as its resolution lets anyone say.

    `level`: chance that the readings' stored noise alone exceeds its share of the bounds at any incidence.
    """
    found = table_albedos(table, feature_width)
    if found.why_not:
        detail = f"The albedo of this table cannot be integrated: {found.why_not}."
        return Property("energy", UNDECIDED, None, None, tolerance, detail=detail, facts={"incidences": 0})
    # Two standard uncertainties are in the bounds already.
    more = (max(critical(sidak(level, found.noise.size)), 2.0) - 2.0) * found.noise
    found.above, found.below = found.above + more, found.below + more
    p = energy_property(
        found.theta_i, found.phi_i, found.value, found.above, tolerance, found.method, {}, lower=found.below
    )
    p.series = _series(found)
    if np.isfinite(found.value).all():
        with_hemispherical(p, hemispherical(found.theta_i, found.value, np.maximum(found.above, found.below)))
    with np.errstate(invalid="ignore"):
        passing = np.all(found.value + found.above <= 1 + tolerance, axis=1)
    refused = found.theta_i[~passing]
    p.facts["passes_below_theta_i_deg"] = float(np.degrees(refused.min())) if refused.size else 90.0
    p.facts["noise_of_albedo"] = float(np.max(found.noise))
    p.facts["incidences_without_mirror_direction"] = int(found.unseen.sum())
    if p.verdict == UNDECIDED and p.facts["passes_below_theta_i_deg"] > 1:
        p.detail += f" Below θi {p.facts['passes_below_theta_i_deg']:.4g}° it passes."
    if found.unseen.any():
        p.detail += (
            " The readings leave out the mirror direction, where a lobe narrower than the grid may hide: read there"
            " too, or state the width of the narrowest feature."
        )
    elif p.verdict == UNDECIDED:
        p.detail += _finer(table, found, passing)
        p.facts["step_needed_deg"] = _needed(found, passing)
    return p


def _needed(found, passing):
    needed = found.step_needed
    if needed is None or not np.isfinite(needed[~passing]).any():
        return None
    return float(np.degrees(np.nanmin(needed[~passing])))


def _finer(table, found, passing):
    needed = _needed(found, passing)
    if needed is None:
        return " The grid does not resolve the lobe well enough: a finer one, or half/difference angles, would."
    own = np.degrees(np.median(np.diff(table.layout.axes["theta_o"])))
    if needed >= own:
        return " Its noise, its rim or its missing cells leave that open, rather than its resolution."
    return (
        f" The grid does not resolve the lobe: by its height and slopes a step of about {needed:.2g}°"
        f" (here {own:.2g}°) is needed, or half/difference angles."
    )


def _series(found):
    theta = np.unique(found.theta_i)
    worst = [np.flatnonzero(found.theta_i == t) for t in theta]
    value = np.stack([found.value[k].max(axis=0) for k in worst])
    bound = np.stack([found.below[k].max(axis=0) for k in worst])
    return {"theta_i_deg": np.degrees(theta).tolist(), "albedo": value.T.tolist(), "bound": bound.T.tolist()}

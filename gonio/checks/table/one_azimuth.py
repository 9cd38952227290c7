"""What a table with one azimuth of the light shows of a surface that need not be isotropic."""

import numpy as np

from gonio.checks.certificate import FAIL, NOT_APPLICABLE, Property, without_residual
from gonio.checks.table.comparison import compare
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.pairs.displacement import displaced, displacement
from gonio.checks.table.pairs.pair_points import isotropic_light, one_sided
from gonio.checks.table.pairs.pairs import FEWEST, Pairs
from gonio.checks.table.pairs.places import SAME_POLAR
from gonio.checks.table.polarisations import same_states
from gonio.data.table import Table
from gonio.models.display import percent

ISOTROPIC = 0.05
"""Relative dependence of f on the azimuth at normal incidence up to which a surface is taken as isotropic."""
NO_TURN = 1e-6
"""Azimuth difference, radians, in units of the polar angles' sines, up to which a pair needs no turning."""
WHAT = "f at normal incidence, by one azimuth of the detector and by another,"
TAKEN = " The surface is taken as isotropic: at normal incidence f depends on the azimuth by no more than {most}."
CONTRADICTED = (
    " At normal incidence f depends on the detector's azimuth by {size}: the surface is not isotropic, and exchanged"
    " directions need light from other azimuths. What was read of these shows no violation."
)
UNKNOWN = (
    " A brushed, woven or leaning surface differs like that and is reciprocal: the light has one azimuth, and no"
    " readings at normal incidence say that the surface is isotropic. What needs no turning shows no violation."
)


def one_azimuth(table: Table) -> bool:
    """Whether exchanged directions of a table are found by turning them about the normal, as its light has one azimuth.

    A format that reads between its readings by a rule of its own states what it holds.
    """
    layout = table.layout
    if table.interpolant is not None or layout.in_half_vectors:
        return False
    return (not layout.has_azimuth_of_light or layout.one_light_azimuth) if layout.gridded else isotropic_light(table)


def taken_as_mirrored(table: Table) -> bool:
    """Whether the detector was on one side of the plane of incidence, so that the other side is its mirror image."""
    if table.interpolant is not None or table.layout.in_half_vectors:
        return False
    if table.layout.gridded:
        return bool(table.layout.mirrored_axes)
    angles = np.stack(table.layout.angles(), axis=-1)[table.layout.readable()]
    beside = np.sin(angles[:, 0]) * np.sin(angles[:, 2]) * np.sin(angles[:, 3] - angles[:, 1])
    return isotropic_light(table) and one_sided(angles) and bool(np.abs(beside).max(initial=0.0) > NO_TURN)


def isotropy_at_normal_incidence(evidence: TableEvidence, tolerance: float) -> Property:
    """Whether f depends on the detector's azimuth at normal incidence: that it does not is no proof of isotropy."""
    pairs = evidence.pairs("normal incidence")
    if isinstance(pairs, str):
        reason = f"Not testable: the light has one azimuth only, and {pairs}."
        return without_residual("isotropy", NOT_APPLICABLE, tolerance, reason)
    pairs = same_states(pairs, evidence.table.channels.names, of_light=False)
    angle = displacement(evidence.table)
    if angle:
        pairs = displaced(evidence.table, pairs, angle)
    compared = compare(evidence, pairs, np.zeros(len(pairs)))
    if compared.differences.by_channel.max(initial=0) < FEWEST:
        reason = "Not testable: the light has one azimuth only, and too few readings at normal incidence are valid."
        return without_residual("isotropy", NOT_APPLICABLE, tolerance, reason)
    judged = compared.judged("isotropy", evidence, tolerance, WHAT)
    judged.facts = compared.differences.facts() | {"method": pairs.how} | judged.facts
    return judged


def azimuth_dependence(table: Table) -> float | None:
    """By how much f at normal incidence depends on the detector's azimuth, where light has one azimuth alone.

    None where the light has several, or where nothing shows that the surface is not isotropic.
    """
    if not one_azimuth(table):
        return None
    isotropy = isotropy_at_normal_incidence(TableEvidence(table), ISOTROPIC)
    return (isotropy.residual or 0.0) if isotropy.verdict == FAIL else None


def unturned(pairs: Pairs, gridded: bool) -> np.ndarray:
    """Which of the exchanged pairs of a table with one azimuth of the light need no turning, (n,) truth values.

    Their detector is in the half plane of the light, so that the exchanged light comes from the same azimuth. Of a
    list, readings at normal incidence are merged whatever their azimuth.
    """
    theta_i, phi_i, theta_o, phi_o = pairs.angles.T
    tilted = theta_i > SAME_POLAR
    if not tilted.any():
        return np.zeros(len(pairs), bool)
    away = phi_o - phi_i[tilted][0]
    return (tilted | gridded) & (np.sin(theta_o) > SAME_POLAR) & (np.abs(np.sin(away)) <= NO_TURN) & (np.cos(away) > 0)


def turned_to(table: Table, angles: np.ndarray) -> np.ndarray:
    """Which pairs of directions, (n, 4) radians, are turned about the normal to be read in a table: (n,) truth values.

    Those of other azimuths of the light than a table's only one, and those at normal incidence, where that azimuth
    has no meaning.
    """
    layout = table.layout
    theta_i, phi_i, theta_o, phi_o = angles.T
    if table.interpolant is None and layout.in_half_vectors and not layout.has_azimuth_of_light:
        # Such a grid holds half vectors over the x axis.
        y, x = (np.sin(theta_i) * c(phi_i) + np.sin(theta_o) * c(phi_o) for c in (np.sin, np.cos))
        return (np.abs(y) > NO_TURN) | (x < NO_TURN)
    if not one_azimuth(table):
        return np.zeros(len(angles), bool)
    tilted = np.sin(theta_i) > SAME_POLAR
    away = phi_i - _azimuth_of_light(table)
    return ~tilted | (np.abs(np.sin(away)) > NO_TURN) | (np.cos(away) < 0)


def _azimuth_of_light(table: Table) -> float:
    theta_i, phi_i = table.layout.axes.get("theta_i"), table.layout.axes.get("phi_i")
    if theta_i is None or phi_i is None:
        return 0.0
    return float(phi_i[0] if table.layout.gridded else phi_i[np.argmax(np.sin(theta_i))])


def is_taken_as_isotropic(failed: Property, evidence: TableEvidence, tolerance: float) -> bool:
    """Whether a violation that turned pairs show stands; why is added to its detail.

    It does where f at normal incidence depends on the detector's azimuth neither by more than the tolerance nor, as
    far as noise can tell, by as much as the violation.
    """
    isotropy = isotropy_at_normal_incidence(evidence, tolerance)
    failed.facts["isotropy_at_normal_incidence"] = isotropy.verdict
    most = isotropy.facts.get("largest_violation", np.inf)
    if isotropy.verdict == FAIL:
        failed.detail += CONTRADICTED.format(size=percent(isotropy.residual or 0.0))
        return False
    taken = most <= max(tolerance, failed.facts["least_violation"])
    failed.detail += TAKEN.format(most=percent(most)) if taken else UNKNOWN
    return taken

"""What quantities say of their uncertainties, and of how to reach what the readings do not."""

from collections.abc import Sequence

import numpy as np

from gonio.checks.certificate import FAIL
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.one_azimuth import (
    ISOTROPIC,
    isotropy_at_normal_incidence,
    one_azimuth,
    taken_as_mirrored,
)
from gonio.data.plausibility.correlated_uncertainty import CorrelatedUncertainty
from gonio.data.polarisation import are_radiances, is_polarised
from gonio.data.table import Table
from gonio.metrology.fit_numbers import FitNumbers
from gonio.metrology.standards.evaluation import Undecided
from gonio.models.display import listed, percent

NO_UNCERTAINTY = "No uncertainties are stored: U is of the integral alone, and a single reading has none."
INDEPENDENT = (
    "The stored uncertainties are taken as independent from reading to reading; what all readings share, such as a "
    "calibration, is in U with --budget --uncertainty 'gain=0.5 %'."
)
COMMON = (
    "Bright readings scatter by at most {scatter} of their stored uncertainties: the rest, {share} of f, is taken as "
    "what all of them share, such as a calibration, and is in U."
)
SCATTERED = (
    "Readings scatter about their neighbours by {times} times what their stored uncertainties say: U is of this "
    "scatter."
)
COPIED = (
    "{copies} of {cells} readings repeat others (turned or mirrored directions with equal values): U counts their "
    "noise as one."
)
INDEPENDENT_IN_FIT = (
    "U is of the fit's covariance: what all readings share, such as a calibration, is not in it; of the fit's "
    "numbers and albedos it is with gonio quantities TABLE --budget --fit FIT.toml --uncertainty 'gain=0.5 %'."
)
FIT_REACHES = (
    "What readings do not reach a fit of them does, as far as its model holds: gonio fit TABLE -o FIT.toml, "
    "then gonio quantities FIT.toml."
)
NOT_ISOTROPIC = (
    "At normal incidence f depends on the detector's azimuth, by {size}: the surface is not isotropic. Albedos are "
    "those of light from the azimuth that was read; quantities of light from all sides are not known{side}."
)
ONE_SIDE = (
    "The detector was on one side of the plane of incidence: the other is taken as its mirror image, and no readings "
    "at normal incidence say that the surface is isotropic."
)
ELEMENTS = (
    "{others} are elements of Mueller matrices or Stokes parameters, which are no radiances: quantities are of"
    " unpolarised light."
)
STATES = "Channels are states of polarised light, each by itself: with unpolarised light they are not what is read."
INTEGRALS = ("albedo", "reflectance", "gloss")
SAMPLE = 1000
"""Readings that are looked at for uncertainties."""


def of_polarisation(names: Sequence[str]) -> list[str]:
    """What light quantities are of, where channels are of polarised light."""
    others = [name for name, is_radiance in zip(names, are_radiances(names), strict=True) if not is_radiance]
    if others:
        return [ELEMENTS.format(others=listed(others))]
    return [STATES] if is_polarised(names) else []


def of_uncertainties(table: Table) -> list[str]:
    """What the uncertainties of a table do not hold, where no simulated instrument made its readings."""
    if "instrument" in table.provenance:
        return []
    few = None if table.u_f is None else np.asarray(table.values_at(table.valid_cells()[:SAMPLE])["u_f"])
    return [NO_UNCERTAINTY if few is None or not np.isfinite(few).any() else INDEPENDENT]


def of_common(known: CorrelatedUncertainty) -> list[str]:
    """That readings share most of the uncertainties that they store, where they scatter far less."""
    if not known.relative:
        return []
    return [COMMON.format(scatter=percent(known.scatter), share=percent(known.relative))]


def of_scatter(excess: np.ndarray) -> list[str]:
    """That readings scatter more than the uncertainties that they store; `excess`: by how much, of each channel."""
    more = [f"{e:.2g}" for e in (excess[excess > 1].min(), excess.max())] if (excess > 1).any() else []
    return [SCATTERED.format(times=" to ".join(dict.fromkeys(more)))] if more else []


def of_copies(times: np.ndarray | None) -> list[str]:
    """That readings repeat others; `times`: how often (n,) each stands, or None."""
    if times is None:
        return []
    return [COPIED.format(copies=round(times.size - float(np.sum(1.0 / times))), cells=times.size)]


def of_symmetry(table: Table) -> list[str]:
    """What is taken of a surface lit from one azimuth, or read on one side, where its readings do not show it."""
    if not one_azimuth(table):
        return []
    isotropy, mirrored = isotropy_at_normal_incidence(TableEvidence(table), ISOTROPIC), taken_as_mirrored(table)
    if isotropy.verdict == FAIL:
        side = "; the side that was not read is taken as a mirror image" if mirrored else ""
        return [NOT_ISOTROPIC.format(size=percent(isotropy.residual or 0.0), side=side)]
    shown = isotropy.facts.get("largest_violation", np.inf) <= ISOTROPIC
    return [ONE_SIDE] if mirrored and not shown else []


def of_numbers(numbers: FitNumbers | None) -> list[str]:
    """What the covariance of a fit does not hold, where it has any spread."""
    spreads = numbers is not None and bool(np.any(np.nan_to_num(numbers.covariance) > 0))
    return [INDEPENDENT_IN_FIT] if spreads else []


def of_reach(undecided: Sequence[Undecided]) -> list[str]:
    """That a fit knows albedos, integrals over apertures and gloss where the readings do not."""
    return [FIT_REACHES] if any(u.group in INTEGRALS for u in undecided) else []

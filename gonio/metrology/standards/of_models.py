"""Quantities of standards of a model, with the errors of the integrals and the covariance of a fit."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gonio.data.material import Material
from gonio.metrology.quantity import Quantity
from gonio.metrology.standards.apertures import Rule, joined
from gonio.metrology.standards.evaluation import Integrals, Spread, Undecided, distinct, evaluated
from gonio.metrology.standards.standard import Aperture, Hemisphere, Integral, StandardQuantity
from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.planning.prior import prior_of

TOLERANCE = 1e-6
DIFFERENCE = 1e-4
"""Relative, of slopes by the numbers of a fit."""


class FitSlopes(NamedTuple):
    """Slopes (J, C, P) of the integrals by the free numbers of a fit, and their covariance (P, P)."""

    by_number: np.ndarray
    covariance: np.ndarray


def of_model(
    material: Material, entries: Sequence[StandardQuantity]
) -> tuple[list[Quantity], list[Undecided], list[str]]:
    """The quantities of a model, those that are undecided, and remarks."""
    integrals, count = distinct(entries), len(material.channels)
    known = model_integrals(material.brdf, integrals, count)
    of_fit, notes = None, []
    if "fit" in material.meta and entries:
        of_fit = _of_fit(material, integrals, count)
        if isinstance(of_fit, str):
            notes, of_fit = [of_fit], None
    rows, _, undecided = evaluated(entries, material.channels, known, _spread(integrals, of_fit))
    return rows, undecided, notes


def model_integrals(brdf: AbstractBRDF, integrals: Sequence[Integral], channels: int, fine: bool = True) -> Integrals:
    """Values and bounds of integrals of a model; `fine` False: the coarser rules alone, for differences."""
    values, bounds = (np.zeros((len(integrals), channels)) for _ in range(2))
    rules: list[tuple[int, Rule, float]] = []
    for j, integral in enumerate(integrals):
        if isinstance(integral, Hemisphere):
            values[j], bounds[j] = _hemisphere(brdf, integral, channels)
            continue
        for theta, weight in integral.images:
            values[j] += weight * _image(brdf, theta, channels)
        if fine or integral.coarse is None:
            rules.append((j, integral.fine, 1.0))
        if integral.coarse is not None:
            rules.append((j, integral.coarse, 0.0 if fine else 1.0))
    if rules:
        whole = joined([rule for _, rule, _ in rules])
        f = np.nan_to_num(evaluate_in_blocks(brdf, whole.wi, whole.wo))
        ends = np.cumsum([rule.weight.size for _, rule, _ in rules])[:-1]
        for (j, rule, share), part in zip(rules, np.split(f, ends), strict=True):
            total = rule.weight @ part
            values[j] += share * total
            bounds[j] += (1.0 if share else -1.0) * total if fine and _has_two(integrals[j]) else 0.0
    return Integrals(values, np.abs(bounds), {})


def _has_two(integral: Integral) -> bool:
    return isinstance(integral, Aperture) and integral.coarse is not None


def _hemisphere(brdf: AbstractBRDF, integral: Hemisphere, channels: int) -> tuple[np.ndarray, np.ndarray]:
    share = directional_transmittance if integral.behind else directional_albedo
    estimate = share(brdf, np.array([integral.theta_i]), 0.0, TOLERANCE)
    value, bound = (np.broadcast_to(a.reshape(-1), channels) for a in (estimate.value, estimate.bound))
    image = 0.0 if integral.behind else _image(brdf, integral.theta_i, channels)
    return value + image, bound


def _image(brdf: AbstractBRDF, theta: float, channels: int) -> np.ndarray:
    wi = Direction(*(jnp.asarray(c) for c in from_spherical(np.array([theta]), np.zeros(1), np)))
    return np.broadcast_to(np.asarray(jax.vmap(brdf.specular)(wi)).reshape(-1), channels)


def _of_fit(material: Material, integrals: Sequence[Integral], channels: int) -> FitSlopes | str:
    """The slopes by the numbers of a fit; or why there are none."""
    try:
        prior = prior_of(material, None)
    except GonioError as error:
        return f"The covariance of the fit is not in the uncertainties: {error}"
    covariance = np.nan_to_num(np.asarray(material.meta["fit"]["covariance"], float))
    d, made = prior.parameterisation.domains, []
    for k in range(prior.p.size):
        low, high = prior.p.copy(), prior.p.copy()
        step = DIFFERENCE * max(abs(prior.p[k]), 1e-3)
        low[k], high[k] = max(prior.p[k] - step, d.low[k]), min(prior.p[k] + step, d.high[k])
        ends = [model_integrals(prior.brdf(p), integrals, channels, fine=False).values for p in (high, low)]
        made.append((ends[0] - ends[1]) / (high[k] - low[k]))
    return FitSlopes(np.stack(made, axis=-1), covariance)


def _spread(integrals: Sequence[Integral], fit: FitSlopes | None) -> Spread:
    def spread(entry: StandardQuantity, by: np.ndarray) -> np.ndarray:
        if fit is None:
            return np.zeros(() if entry.whole else by.shape[1])
        index = [integrals.index(i) for i in entry.integrals]
        with np.errstate(invalid="ignore"):
            moves = np.einsum("jc,jcp->p" if entry.whole else "jc,jcp->cp", by, fit.by_number[index])
        return np.sqrt(np.maximum(np.einsum("...p,pq,...q->...", moves, fit.covariance, moves), 0.0))

    return spread

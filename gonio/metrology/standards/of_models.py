"""Quantities of standards of a model, with the errors of the integrals and the covariance of a fit."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from gonio.data.material import Material
from gonio.metrology.fit_numbers import FitNumbers
from gonio.metrology.quantity import Quantity
from gonio.metrology.standards.apertures import Rule, joined
from gonio.metrology.standards.evaluation import Integrals, Spread, Undecided, distinct, evaluated
from gonio.metrology.standards.standard import Aperture, Hemisphere, Integral, StandardQuantity
from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import Direction, from_spherical

TOLERANCE = 1e-6


def of_model(
    material: Material, entries: Sequence[StandardQuantity], numbers: FitNumbers | None = None
) -> tuple[list[Quantity], list[Undecided]]:
    """The quantities of a model, and those that are undecided; `numbers`: of the fit whose covariance spreads them."""
    integrals, count = distinct(entries), len(material.channels)
    known = model_integrals(material.brdf, integrals, count)

    def values(brdf: AbstractBRDF) -> np.ndarray:
        return model_integrals(brdf, integrals, count, fine=False).values

    by_number = numbers.slopes(values) if numbers is not None and entries else None
    rows, _, undecided = evaluated(entries, material.channels, known, _spread(integrals, numbers, by_number))
    return rows, undecided


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
    return np.broadcast_to(np.asarray(jax.vmap(brdf.mirror_reflectance)(wi)).reshape(-1), channels)


def _spread(integrals: Sequence[Integral], numbers: FitNumbers | None, by_number: np.ndarray | None) -> Spread:
    """Uncertainties by the covariance of a fit; `by_number` (J, C, P): slopes of the integrals by its numbers."""

    def spread(entry: StandardQuantity, by: np.ndarray) -> np.ndarray:
        if numbers is None or by_number is None:
            return np.zeros(() if entry.whole else by.shape[1])
        index = [integrals.index(i) for i in entry.integrals]
        with np.errstate(invalid="ignore"):
            moves = np.einsum("jc,jcp->p" if entry.whole else "jc,jcp->cp", by, by_number[index])
        return numbers.spread(moves)

    return spread

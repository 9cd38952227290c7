"""What is known before measuring: a model with free numbers, their values, and how uncertain these are."""

import dataclasses
import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from gonio.data.channels import Channels
from gonio.data.material import Material
from gonio.data.subject import SubjectLike, resolve_subject
from gonio.fitting.fit_table import fit
from gonio.fitting.problem.lobes import sensitivities
from gonio.fitting.problem.parameterisation import FixedValues, Parameterisation, mapped, parameters, unmapped
from gonio.fitting.result import FitResult
from gonio.instrument.measurement import measure
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError, nearest
from gonio.models.expression.builder import build
from gonio.models.expression.parser import Term, Value, changed, numbers, parse, with_defaults
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.low_discrepancy import low_discrepancy

BLOCK = 1024
DRAWS = 8
"""Of a fit's covariance; the likeliest numbers, among them, are one of so many."""
MOST_CORNERS = 8
"""Of the box of ranges; more numbers than three take some of its corners."""
MOST_NUMBERS = 48
KNOWN_ROLES = ("fresnel", "index", "extinction", "masking", "phase", "length", "wavelength")
"""Roles of numbers that an expression's value holds, unless -m frees them."""
USUAL_FACTOR = 3.0
"""Widths of a material that is only stated may be off by so much."""
UNLIKE = 2.5
"""Standard uncertainties that a draw goes from its number, at most."""


@dataclasses.dataclass(frozen=True)
class Prior:
    """A model with P free numbers at their likeliest values (P,), and at draws (S, P), the first of which these are.

    `shares` (S,): what each draw counts for in a plan; their sum is 1. `ranged`: whether the draws after the first are
    ends of ranges, for which a plan has to do, but is not made.
    """

    name: str
    terms: tuple[Term, ...]
    parameterisation: Parameterisation
    fixed: FixedValues
    p: np.ndarray
    draws: np.ndarray
    shares: np.ndarray
    channels: Channels
    ranged: bool = False

    @property
    def names(self) -> list[str]:
        """Label of each free number, such as 'lambert.rho[R]'."""
        known = self.parameterisation.labels
        return [name if c is None else f"{name}[{self.channels.names[c]}]" for name, c in known]

    @property
    def spread(self) -> dict[str, tuple[float, float]]:
        """Least and largest draw of each number that has several."""
        ends = zip(self.names, self.draws.min(axis=0).tolist(), self.draws.max(axis=0).tolist(), strict=True)
        return {name: (low, high) for name, low, high in ends if low < high}

    def brdf(self, p: np.ndarray) -> AbstractBRDF:
        """The model of some numbers."""
        return build(self.parameterisation.filled(self.terms, [p]))

    def values_and_slopes(self, p: np.ndarray, wi: Direction, wo: Direction) -> tuple[np.ndarray, np.ndarray]:
        """(f (n, C), ∂f/∂p (n, C, P)) at directions (n,); blocks of one size, so that one program serves them all."""
        s, n = self.parameterisation, np.size(wi.z)
        parts = [np.asarray(c, float) for c in (*wi, *wo)]
        values, slopes = np.zeros((n, s.channels)), np.zeros((n, s.channels, s.size))
        for start in range(0, n, BLOCK):
            block = [np.resize(c[start : start + BLOCK], BLOCK) for c in parts]
            f, by_group = sensitivities(s, p, self.fixed, Direction(*block[:3]), Direction(*block[3:]))
            stop = min(start + BLOCK, n)
            values[start:stop] = np.asarray(f)[: stop - start]
            for c in range(s.channels):
                slopes[start:stop, c, s.columns[c]] = np.asarray(by_group)[: stop - start, :, c]
        return np.nan_to_num(values), np.nan_to_num(slopes)

    def at_angles(self, p: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same at (theta_i, phi_i, theta_o, phi_o), radians, shape (4, n)."""
        theta_i, phi_i, theta_o, phi_o = angles
        return self.values_and_slopes(p, from_spherical(theta_i, phi_i, np), from_spherical(theta_o, phi_o, np))


def prior_of(subject: SubjectLike, model: str | None, ranges: Mapping[str, tuple[float, float]] | None = None) -> Prior:
    """The prior that a subject gives.

    Args:
        subject: a fit (its model, numbers and covariance), a table (which is fitted), a material or an expression:
            the numbers written in it are free but for refractive indices and the like, and so is every lobe's scale.
        model: what will be fitted, as `gonio.fit` takes it; by default the subject's own.
        ranges: low and high ends of numbers by name, such as {"ggx.alpha": (0.05, 0.3)}: a plan is made for the
            likeliest numbers, and has to do for the corners of these ranges. Widths that come from no fit are within a
            factor of `USUAL_FACTOR` otherwise.

    Raises:
        GonioError: a number that the model does not have, no free number, or more than can be planned for.
    """
    if isinstance(subject, FitResult) and model is None:
        return _of_fit(subject.material, subject.to_dict(), ranges)
    known = resolve_subject(subject)
    if known.table is not None:
        fitted = fit(known.table, model)
        return _of_fit(fitted.material, fitted.to_dict(), ranges)
    material = known.as_material()
    if model is not None:
        scan = "isotropic" if material.brdf.isotropic else "spherical"
        fitted = fit(measure(material, None, scan, log=lambda text: None), model, loss="cbrt")
        return _of_terms(material, with_defaults(parse(model)), _free_values(fitted.to_dict()), None, ranges)
    if material.meta.get("fit", {}).get("asked"):
        return _of_fit(material, material.meta["fit"], ranges)
    if material.expression is None:
        raise GonioError(f"{material.name} has no formula; give what will be fitted, as in -m 'lambert + ggx'")
    terms = tuple(_freed(t) for t in with_defaults(parse(material.expression)))
    return _of_terms(material, terms, None, None, ranges)


def _freed(term: Term) -> Term:
    """The term with its levels and shapes free from their numbers; a factor of a term with another level is fixed."""
    every = list(numbers(term))
    levels = [n for n in every if n.info.linear and "." not in n.path and n.path != "scale"]
    # The factor of the only base, where nobody wrote it, says what the factor of the whole says.
    alone = sum(len(inside) for inside in term.call.models.values()) == 1 and term.scale is not None and not levels
    inner = [n.path for n in every if alone and n.path.endswith(".scale") and n.value.number in (None, 1.0)]
    freed = {
        n.path: Value(1.0 if n.value.number is None else n.value.number, True, n.value.each)
        for n in every
        if n.info.role not in KNOWN_ROLES and not (n.path == "scale" and levels) and n.path not in inner
    }
    return changed(term, freed | dict.fromkeys(inner, Value(1.0)))


def _free_values(fitted: Mapping[str, Any]) -> np.ndarray:
    return np.array([float(p["value"]) for p in fitted["parameters"] if p["status"] != "fixed"])


def _of_fit(material: Material, fitted: Mapping[str, Any], ranges: Mapping[str, tuple[float, float]] | None) -> Prior:
    terms, values = with_defaults(parse(fitted["asked"])), _free_values(fitted)
    covariance = np.asarray(fitted["covariance"], float) if "covariance" in fitted else None
    if covariance is None or covariance.shape != (values.size, values.size):
        raise GonioError(f"{material.name} keeps no covariance of all its numbers; give what will be fitted with -m")
    return _of_terms(material, terms, values, np.nan_to_num(covariance), ranges)


def _of_terms(
    material: Material,
    terms: tuple[Term, ...],
    values: np.ndarray | None,
    covariance: np.ndarray | None,
    ranges: Mapping[str, tuple[float, float]] | None,
) -> Prior:
    s, fixed, start = parameters(terms, len(material.channels))
    p = start if values is None else values
    if not s.size:
        raise GonioError(f"{material.name} has no free number; free one with -m, as in -m 'lambert + ggx'")
    if p.size != s.size:
        raise GonioError(f"{material.name} was fitted channel by channel; give what will be fitted with -m")
    if s.size > MOST_NUMBERS:
        raise GonioError(
            f"{material.name} has {s.size} free numbers; plans take at most {MOST_NUMBERS}: share them between "
            "channels, as in -m 'lambert(rho=shared) + shared * ggx'"
        )
    prior = Prior(material.name, terms, s, fixed, p, p[None], np.ones(1), material.channels)
    stated = dict(ranges or {})
    if covariance is None:
        stated = _usual_ranges(prior, stated) | stated
    if covariance is None and not stated:
        return prior
    draws = _draws(prior, covariance, stated)
    shares = np.full(len(draws), 1 / len(draws))
    return dataclasses.replace(prior, p=draws[0], draws=draws, shares=shares, ranged=bool(stated))


def _usual_ranges(prior: Prior, stated: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """Ranges of the widths that nothing is stated of: a sample is not quite what its material is said to be."""
    d, known = prior.parameterisation.domains, {name.rsplit(".", 1)[-1] for name in stated} | set(stated)
    ranges = {}
    for g in prior.parameterisation.free:
        name = prior.parameterisation.labels[g.first][0]
        value, low, high = prior.p[g.first], d.low[g.first], d.high[g.first]
        if g.info.role == "width" and not {name, name.rsplit(".", 1)[-1]} & known and low < value < high:
            ranges[name] = max(low, value / USUAL_FACTOR), min(high, value * USUAL_FACTOR)
    return ranges


def _draws(prior: Prior, covariance: np.ndarray | None, ranges: Mapping[str, tuple[float, float]]) -> np.ndarray:
    """Draws of the prior within the domains: normal by the covariance, and corners of the ranges."""
    s, names = prior.parameterisation, [name for name, _ in prior.parameterisation.labels]
    short = {name.rsplit(".", 1)[-1]: name for name in names if sum(n.endswith(name.rsplit(".", 1)[-1]) for n in names)}
    corners = _corners(len(ranges))
    others = len(corners)
    if covariance is not None:
        others = DRAWS - 1 if not ranges else MOST_CORNERS
    draws = np.repeat(prior.p[None], 1 + others, axis=0)
    if covariance is not None:
        # Box and Muller's normal numbers, two sequences for each number.
        u = low_discrepancy(others, 2 * s.size)
        normal = np.sqrt(-2 * np.log(np.maximum(u[:, : s.size], 1e-12))) * np.cos(2 * np.pi * u[:, s.size :])
        values, vectors = np.linalg.eigh(covariance)
        draws[1:] += np.clip(normal, -UNLIKE, UNLIKE) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    d = s.domains
    for number, (given, (low, high)) in enumerate(ranges.items()):
        name = short.get(given, given)
        which = [k for k, n in enumerate(names) if n == name or prior.names[k] == name]
        if not which:
            raise GonioError(f"the model has no free number {given}; {nearest(given, dict.fromkeys(prior.names))}")
        if not (math.isfinite(low) and math.isfinite(high) and d.low[which[0]] <= low < high <= d.high[which[0]]):
            domain = f"{d.low[which[0]]:g} to {d.high[which[0]]:g}"
            raise GonioError(f"the range of {given} is {low:g} to {high:g}; give two ends in {domain}")
        kind = d.kind[which]
        ends = [mapped(kind, np.full(len(which), end)) for end in (low, high)]
        draws[1:, which] = np.where(np.resize(corners[:, number], others)[:, None] > 0, high, low)
        inside = (draws[0, which] >= low) & (draws[0, which] <= high)
        draws[0, which] = np.where(inside, draws[0, which], unmapped(kind, (ends[0] + ends[1]) / 2))
    return np.clip(draws, np.maximum(d.low, np.where(prior.p > 0, 0.05 * prior.p, d.low)), d.high)


def _corners(number: int) -> np.ndarray:
    """Corners ±1 of a box of so many edges: all of them, or the lowest, the highest and some between.

    A plan that is good there is good inside, for what is learnt changes steadily with the numbers; draws inside alone
    leave the corners out, where what is thought beforehand is most wrong.
    """
    if 2**number <= MOST_CORNERS:
        return np.array(list(itertools.product((-1.0, 1.0), repeat=number)))
    between = np.sign(low_discrepancy(MOST_CORNERS - 2, number) - 0.5)
    return np.concatenate([-np.ones((1, number)), np.ones((1, number)), between])

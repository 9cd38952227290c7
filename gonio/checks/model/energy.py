"""Energy conservation of a model: the directional albedo at all incidences, with bounds, at most 1."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gonio.checks.albedos import Albedos, energy_property, with_hemispherical
from gonio.checks.certificate import Property
from gonio.checks.direction_search import precision, rotated
from gonio.checks.model.cubature import cubature_albedo
from gonio.checks.model.evidence import ModelEvidence
from gonio.checks.model.reciprocity import difference_of_pairs, rounding_of
from gonio.checks.model.sides import worst_of
from gonio.models.albedo import Estimate, directional_albedo, directional_transmittance
from gonio.models.brdf import AbstractBRDF, Sum
from gonio.models.catalog import is_ours
from gonio.models.compiled.dispatch import Formula
from gonio.models.compiled.dispatch import values as program_values
from gonio.models.folded import seen_from
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.sides import Hemispheres

GRAZING = 89.9
"""The last incidence, degrees."""

ISOTROPIC = 1e-7
"""A model that changes by less than this share when both directions are turned together is isotropic."""

COARSE = 1e-5
"""Bound of an albedo above which adaptive cubature is tried as well, where the albedo may exceed 1."""

CLEAR, FAR = 1e-4, 10.0
"""Bound that is enough of a costly model's albedo that is so many times it below 1."""

MOST_ADAPTED = 16
BETWEEN = 8
"""Incidences that are added about the largest albedo, twice."""


def incidences() -> np.ndarray:
    """Polar angles of incidence, radians: 0 to 89.9°, ever closer towards grazing."""
    coarse = np.linspace(0, 80, 17)
    fine = 90 - 10 * 10 ** np.linspace(0, -2, 16)[1:]
    return np.radians(np.concatenate([coarse, fine]))


def model_energy(evidence: ModelEvidence, tolerance: float) -> Property:
    """How far the directional albedo exceeds 1 at the worst incidence; losses in the facts.

    Of a surface that transmits it is R + T, of light in front and of light from behind, and the facts say what of it is
    reflected, transmitted and absorbed.
    """
    transmits = Hemispheres.TRANSMISSION in evidence.brdf.hemispheres
    lights = {1: (1, 1), -1: (-1, -1)} if transmits else {1: (1, 1)}
    judged = {way: _lit_from(evidence, light, tolerance) for light, way in lights.items()}
    return worst_of(judged, lambda light, _: "light in front" if light > 0 else "light from behind")


def _lit_from(evidence: ModelEvidence, light: int, tolerance: float) -> Property:
    ours, isotropic = is_ours(evidence.brdf), _isotropic(evidence)
    # Our anisotropic models are mirror symmetric along x and y, but those that say otherwise: a quarter stands for all.
    azimuths = np.linspace(0, np.pi / 2, 4) if ours and evidence.brdf.symmetric else np.arange(8) * np.pi / 4
    azimuths = np.zeros(1) if isotropic else azimuths
    rule = "by each lobe's own map" if ours else "by adaptive cubature, as the model's own map is not known to be right"
    several = "" if isotropic else f", at {azimuths.size} azimuths"
    method = f"Incidence 0 to {GRAZING}°{several}, integrated {rule}.{_beside_f(evidence.brdf)}"
    integrator = _Integrator(evidence.brdf, light, max(tolerance / 4, 1e-9), evidence.channels, method)
    theta, phi = (a.ravel() for a in np.meshgrid(incidences(), azimuths, indexing="ij"))
    albedos = integrator.albedos(theta, phi)

    def by_channel(a: np.ndarray) -> list[list[float]]:
        # The worst azimuth of each incidence.
        return np.max(a.reshape(-1, azimuths.size, a.shape[-1]), axis=1).T.tolist()

    series = {
        "theta_i_deg": np.degrees(incidences()).tolist(),
        "phi_i_deg": np.degrees(azimuths).tolist(),
        "albedo": by_channel(albedos.value),
        "bound": by_channel(albedos.above),
    }
    refined = integrator.refined(integrator.refined(albedos, isotropic), isotropic)
    judged = with_hemispherical(energy_property(refined, tolerance), albedos)
    judged.series = series
    if Hemispheres.TRANSMISSION in evidence.brdf.hemispheres:
        _tell_shares(judged, integrator)
    return judged


def _specular(brdf: AbstractBRDF, *components: Any) -> Any:
    return brdf.mirror_reflectance(Direction(*components))


SPECULAR = Formula(_specular, ((0,),) * 3)


def specular_share(brdf: AbstractBRDF, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """What leaves as an image of the source, beside f, (incidences, channels)."""
    wi, dtype = from_spherical(theta, phi, np), jax.dtypes.canonicalize_dtype(float)
    share = program_values(SPECULAR, brdf, [np.asarray(c, dtype) for c in wi], (theta.size,), dtype)
    if share is None:
        share = jax.vmap(brdf.mirror_reflectance)(Direction(*(jnp.asarray(c) for c in wi)))
    return np.asarray(share, float).reshape(theta.size, -1)


def _beside_f(brdf: AbstractBRDF) -> str:
    share = specular_share(brdf, np.zeros(1), np.zeros(1)).max()
    return f" The specular share, no part of f, is counted: {share:.6g} at normal incidence." if share else ""


def _tell_shares(judged: Property, integrator: "_Integrator") -> None:
    """What is reflected, transmitted and absorbed along the normal, and the words for a surface that transmits."""
    r, t = (share(np.zeros(1), np.zeros(1))[0][0] for share in (integrator.reflected, integrator.transmitted))
    shares = {"reflected_at_0": r, "transmitted_at_0": t, "absorbed_at_0": 1 - r - t}
    judged.facts |= {name: value.tolist() for name, value in shares.items()}
    texts = (", ".join(f"{v:.4g}" for v in value) for value in shares.values())
    judged.detail = judged.detail.replace("reflects", "sends out").replace("albedo", "R + T")
    judged.detail += " Along the normal R is {}, T {}, A = 1 − R − T {}.".format(*texts)


def _isotropic(evidence: ModelEvidence) -> bool:
    if is_ours(evidence.brdf):
        return evidence.brdf.isotropic
    turn = rotated(0.7)
    worst = difference_of_pairs(evidence.brdf, turn, evidence.angles[::3], rounds=0)
    return worst.residual - rounding_of(evidence.brdf, turn, worst) <= ISOTROPIC


@dataclasses.dataclass(frozen=True)
class _Integrator:
    brdf: AbstractBRDF
    light: int
    """1: the light is in front, -1: behind."""
    accuracy: float
    channels: tuple[str, ...]
    method: str

    def albedos(self, theta: np.ndarray, phi: np.ndarray) -> Albedos:
        """What is reflected, and what is transmitted where something is."""
        value, bound = self.reflected(theta, phi)
        if Hemispheres.TRANSMISSION in self.brdf.hemispheres:
            v, b = self.transmitted(theta, phi)
            value, bound = value + v, bound + b
        bound = bound + 64 * precision() * np.abs(value)
        return Albedos(theta, phi, value, bound, bound, self.method, self.channels)

    def reflected(self, theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(R, bound), each (n, channels), with what is specular of light in front."""
        value, bound = self._integrals(self.light, directional_albedo, theta, phi)
        mirrors = self.light > 0 and Hemispheres.REFLECTION in self.brdf.hemispheres
        return value + (specular_share(self.brdf, theta, phi) if mirrors else 0.0), bound

    def transmitted(self, theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(T, bound), each (n, channels)."""
        value, bound = self._integrals(-self.light, directional_transmittance, theta, phi)
        through = Hemispheres.REFLECTION not in self.brdf.hemispheres
        return value + (specular_share(self.brdf, theta, phi) if through else 0.0), bound

    def _integrals(
        self, detector: int, by_maps: Callable[..., Estimate], theta: np.ndarray, phi: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Terms of ours together by their maps, others one by one by adaptive cubature; bounds are added."""
        ours = tuple(t for t in self.brdf.terms() if is_ours(t))
        foreign = [t for t in self.brdf.terms() if not is_ours(t)]
        value, bound = np.zeros((theta.size, 1)), np.zeros((theta.size, 1))
        if ours:
            whole = ours[0] if len(ours) == 1 else Sum(ours)
            v, b = self._by_maps(whole, by_maps, theta, np.asarray(phi))
            self._adapted(seen_from(whole, self.light, detector), theta, phi, v, b)
            value, bound = value + v, bound + b
        limit = 1.0 if len(foreign) == 1 and not ours else None
        for term in (seen_from(t, self.light, detector) for t in foreign):
            each = [cubature_albedo(term, t, p, self.accuracy, limit) for t, p in zip(theta, phi, strict=True)]
            v, b = (np.stack(a) for a in zip(*each, strict=True))
            value, bound = value + v, bound + b
        return value, bound

    def _by_maps(
        self, whole: AbstractBRDF, rule: Callable[..., Estimate], theta: np.ndarray, phi: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """By the lobes' own maps; of costly models only as exactly as the distance from 1 asks."""
        lit = theta if self.light > 0 else np.pi - theta

        def integrals(some: np.ndarray, accuracy: float) -> list[np.ndarray]:
            estimate = rule(whole, lit[some], phi[some], accuracy)
            return [a.reshape(some.size, -1).copy() for a in (estimate.value, estimate.bound)]

        every, costly = np.arange(theta.size), any(t.costly for t in whole.terms())
        value, bound = integrals(every, max(self.accuracy, CLEAR) if costly else self.accuracy)
        near = np.flatnonzero(np.any(value + FAR * bound > 1, axis=1)) if costly else every[:0]
        if near.size:
            value[near], bound[near] = integrals(near, self.accuracy)
        return value, bound

    def _adapted(
        self, brdf: AbstractBRDF, theta: np.ndarray, phi: np.ndarray, value: np.ndarray, bound: np.ndarray
    ) -> None:
        """Where the lobe's own map does not resolve it (very unequal widths), cells that adapt may: in place."""
        coarse = np.flatnonzero(np.any((bound > COARSE) & (value + bound > 1), axis=-1))
        for k in coarse[:MOST_ADAPTED]:
            v, b = cubature_albedo(brdf, float(theta[k]), float(phi[k]), self.accuracy)
            value[k], bound[k] = np.where(b < bound[k], (v, b), (value[k], bound[k]))

    def refined(self, known: Albedos, isotropic: bool) -> Albedos:
        """With incidences added on either side of the largest albedo: the maximum lies in there."""
        surely = np.nan_to_num(known.value - known.above, nan=-1.0)
        k = int(np.unravel_index(np.argmax(surely), surely.shape)[0])
        nodes = np.unique(known.theta_i)
        place = int(np.searchsorted(nodes, known.theta_i[k]))
        low, high = nodes[max(place - 1, 0)], nodes[min(place + 1, nodes.size - 1)]
        phi = np.full(BETWEEN, known.phi_i[k])
        if not isotropic:
            phi = phi + np.linspace(-0.3, 0.3, BETWEEN)[[3, 0, 6, 1, 5, 2, 7, 4]]
        new = self.albedos(np.linspace(low, high, BETWEEN + 2)[1:-1], phi)
        theta, phi, value, bound = (
            np.concatenate([getattr(a, name) for a in (known, new)]) for name in ("theta_i", "phi_i", "value", "above")
        )
        return Albedos(theta, phi, value, bound, bound, self.method, self.channels)

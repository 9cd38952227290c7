"""The error of a BRDF as flux: the share of the truly reflected light that it sends elsewhere."""

import dataclasses

import numpy as np

from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate, sampled_directions, sampling_density
from gonio.models.geometry.directions import NORMAL, Direction
from gonio.stability.directions import unit_vector

THETA_MAX = np.radians(80.0)


@dataclasses.dataclass(frozen=True)
class Light:
    """Random pairs (n,), dense where a surface reflects, with the weight cosθo/density and f there."""

    wi: Direction
    wo: Direction
    weight: np.ndarray
    f: np.ndarray

    def misplaced(self, brdf: AbstractBRDF) -> float:
        """∫∫ |f' − f| cosθo dωo / ∫∫ f cosθo dωo under uniform light, of another f'; NaN counts as all of it."""
        other = np.asarray(evaluate(brdf, self.wi, self.wo), float).reshape(self.f.size, -1).mean(axis=1)
        off = np.where(np.isfinite(other), np.abs(other - self.f), self.f)
        return float(np.sum(self.weight * off) / np.sum(self.weight * self.f))


def light_of(brdf: AbstractBRDF, count: int = 20_000, seed: int = 0) -> Light:
    """Pairs for a one-channel surface: the light cosine-weighted, wo by the surface's own sampler, both below 80°."""
    rng = np.random.default_rng(seed)
    theta = np.arcsin(np.sin(THETA_MAX) * np.sqrt(rng.random(count)))
    phi = rng.uniform(0, 2 * np.pi, count)
    wi = Direction(*unit_vector(theta, phi))
    wo = sampled_directions(brdf, wi, rng.random(count), rng.random(count))
    # Always as many pairs: one compiled program serves all surfaces of a kind.
    up = np.asarray(wo.z) > np.cos(THETA_MAX)
    wi, wo = (Direction(*(np.where(up, c, e) for c, e in zip(w, NORMAL, strict=True))) for w in (wi, wo))
    f = np.asarray(evaluate(brdf, wi, wo), float).reshape(count)
    return Light(wi, wo, np.where(up, wo.z / np.asarray(sampling_density(brdf, wi, wo)), 0.0), f)

"""What a measurement is for: numbers of the model, its albedo, its radiance in a scene."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gonio.data.scene import load_scene
from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.brdf import AbstractBRDF, changed_terms
from gonio.models.errors import GonioError, nearest
from gonio.models.geometry.sides import Hemispheres
from gonio.planning.prior import Prior

ALBEDO, SCENE = "albedo", "scene:"
INCIDENCES = (0.0, 30.0, 45.0, 60.0, 75.0)
"""Degrees, of the directional albedos."""
DIFFERENCE = 1e-3
TOLERANCE = 1e-7
PAIRS = 4000


class Quantities(NamedTuple):
    """Q quantities of a model: names, values (Q,) and slopes (Q, P) by its numbers."""

    names: list[str]
    values: np.ndarray
    slopes: np.ndarray


def quantities(prior: Prior, p: np.ndarray, wanted: Sequence[str]) -> Quantities:
    """The quantities that are wanted of a model: 'albedo', 'scene:NAME', or names of its free numbers.

    Raises GonioError for a name that is none of these.
    """
    parts = [_quantity(prior, p, name) for name in wanted]
    names = [name for part in parts for name in part.names]
    return Quantities(names, *(np.concatenate([part[k] for part in parts]) for k in (1, 2)))


def numbers(prior: Prior, p: np.ndarray) -> Quantities:
    """All free numbers."""
    return Quantities(prior.names, p, np.eye(p.size))


def _quantity(prior: Prior, p: np.ndarray, name: str) -> Quantities:
    if name == ALBEDO:
        return albedos(prior, p)
    if name.startswith(SCENE):
        return _radiance(prior, p, name.removeprefix(SCENE))
    names = prior.names
    which = [k for k, n in enumerate(names) if name in (n, n.split("[")[0], n.split("[")[0].rsplit(".", 1)[-1])]
    if not which:
        known = [*names, ALBEDO, f"{SCENE}NAME"]
        raise GonioError(f"the model has no number {name} to plan for; {nearest(name, known)}")
    return Quantities([names[k] for k in which], p[which], np.eye(p.size)[which])


def albedos(prior: Prior, p: np.ndarray) -> Quantities:
    """Directional albedos and transmittances at `INCIDENCES`, of each channel; slopes by central differences."""
    theta = np.radians(INCIDENCES)
    whole, size = prior.brdf(p), (theta.size, len(prior.channels))
    shares = {
        name: integral
        for name, way, integral in (
            ("albedo", Hemispheres.REFLECTION, directional_albedo),
            ("transmittance", Hemispheres.TRANSMISSION, directional_transmittance),
        )
        if way in whole.hemispheres
    }

    def values(brdf: AbstractBRDF) -> np.ndarray:
        tolerance = TOLERANCE * len(brdf.terms()) / len(whole.terms())
        every = (g(brdf, theta, 0.0, tolerance).value.reshape(theta.size, -1) for g in shares.values())
        return np.concatenate([np.broadcast_to(value, size).ravel() for value in every])

    d, slopes = prior.parameterisation.domains, np.zeros((len(shares), *size, p.size))
    step = DIFFERENCE * np.maximum(np.abs(p), 1e-3)
    for g in prior.parameterisation.free:
        # A channel depends on no other's numbers: those of all channels are moved at once.
        moved = np.arange(p.size)[prior.parameterisation.of(g)]
        low, high = p.copy(), p.copy()
        low[moved], high[moved] = np.maximum(p - step, d.low)[moved], np.minimum(p + step, d.high)[moved]
        above, below = changed_terms(prior.brdf(high), prior.brdf(low))
        difference = (values(above) - values(below)).reshape(len(shares), *size)
        for c, k in enumerate(moved) if g.per_channel else ((slice(None), moved[0]),):
            slopes[:, :, c, k] = difference[:, :, c] / (high[k] - low[k])
    channels = [f" {c}" if len(prior.channels) > 1 else "" for c in prior.channels.names]
    names = [f"{share} at {t:g}°{c}" for share in shares for t in INCIDENCES for c in channels]
    return Quantities(names, values(whole), slopes.reshape(-1, p.size))


def _radiance(prior: Prior, p: np.ndarray, name: str) -> Quantities:
    """The rms radiance of a scene's views; its slope is the rms of theirs, so that errors of all views count."""
    scene, brdf = load_scene(name), prior.brdf(p)
    pairs = scene.pairs(PAIRS, float(np.mean(np.asarray(brdf.index_behind))))
    f, slopes = prior.values_and_slopes(p, pairs.wi, pairs.wo)
    share = np.sqrt(pairs.share / f.shape[1])[:, None]
    by_view = [pairs.radiances(slopes[:, :, k]) * share for k in range(p.size)]
    flat = np.stack([v.ravel() for v in by_view], axis=1)
    # Σ share (Δradiance)² = |R Δp|² with few rows R, one for each number.
    rows = np.asarray(np.linalg.qr(flat, mode="r"))
    whole = pairs.rms(f)
    if not whole > 0:
        raise GonioError(f"{prior.name} is dark in the scene '{scene.name}': there is no radiance to plan for")
    return Quantities([f"radiance in {scene.name}"] * len(rows), np.full(len(rows), whole), rows)

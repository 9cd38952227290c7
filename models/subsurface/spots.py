"""Light and detector of finite spots on a translucent material: what a viewed disc receives of an illuminated one.

Both discs are evenly lit or viewed, a and b their radii, mm. What leaves at the distance r from where it entered counts
with the area that one disc shares with the other one moved by r.
"""

from typing import NamedTuple

import numpy as np

from gonio.models.subsurface.base import AbstractBSSRDF
from gonio.models.subsurface.evaluation import evaluated, totals

PANELS = 24
"""Of the integral over the chord; each is half as wide as the one before it, towards where both discs' edges meet."""
ORDER = 16
CUTS = (0.0, 1 / 1024, 1 / 64, 1 / 8, 1 / 2, 1.0)
"""Of the distances between two kinks, denser where R is larger."""
NODES = 20
ANGLES = 24
ROUNDING = 1e-14
LEAST = 1e-12
"""Of both radii: a distance at which every R is finite."""


class Kept(NamedTuple):
    """A share (channels,), and a bound on its error."""

    value: np.ndarray
    bound: np.ndarray


class SpotRule(NamedTuple):
    """A rule for the mean of R over two discs: distances, mm, and weights, (offsets, nodes) each."""

    r: np.ndarray
    weight: np.ndarray


def kept_share(bssrdf: AbstractBSSRDF, a: float, b: float) -> Kept:
    """The share of the light of a spot of radius a that a concentric viewed spot of radius b does not lose.

    It is relative to a sample without transport below its surface, as a white standard in the same instrument is: the
    mean exitance within b is `kept` · ∫R dA · min(1, a²/b²) per irradiance. It is symmetric in a and b, and
    (2/π) max(a, b)² ∫ C(r)/r² sin²θ dθ over [0, π] of the cumulative profile C, r² = a² + b² − 2ab cosθ: the transform
    (2a/b) ∫ R̂(k) J₁(ka) J₁(kb)/k dk without its oscillations.

    Args:
        bssrdf: the material.
        a, b: radii, mm; not both 0.

    Returns:
        The share in [0, 1] and a bound on its error, from a rule of half the order, and rounding.
    """
    cuts = np.pi * np.concatenate([[0.0], 0.5 ** np.arange(PANELS, -1.0, -1.0)])
    total = totals(bssrdf)
    dark = total <= 0  # nothing leaves, and nothing is lost
    values = []
    for order in (ORDER // 2, ORDER):
        x, w = np.polynomial.legendre.leggauss(order)
        half = np.diff(cuts)[:, None] / 2
        theta, weight = (cuts[:-1, None] + half * (1 + x)).ravel(), (half * w).ravel()
        r2 = (a - b) ** 2 + 4 * a * b * np.sin(theta / 2) ** 2
        share = np.where(dark, 1.0, evaluated(bssrdf, "cumulative", np.sqrt(r2))) / np.where(dark, 1.0, total)
        values.append(2 / np.pi * max(a, b) ** 2 * np.sum((weight * np.sin(theta) ** 2 / r2)[:, None] * share, axis=0))
    return Kept(np.where(dark, 1.0, values[1]), np.abs(values[1] - values[0]) + ROUNDING)


def spot_rule(offsets: np.ndarray, a: float, b: float, nodes: int = NODES) -> SpotRule:
    """The rule by which Σ weight · R(r) is the mean exitance of a viewed spot per flux of an illuminated one, 1/mm².

    Args:
        offsets: distances (n,) of the spots' centres, mm; their signs do not matter.
        a, b: radii, mm, 0 for points.
        nodes: of a panel; the difference from a rule of half as many tells the error.
    """
    offsets = np.abs(np.asarray(offsets, float))
    if not max(a, b):
        return SpotRule(offsets[:, None], np.ones((offsets.size, 1)))
    rho, wide, narrow = offsets[:, None], a + b, abs(a - b)
    kinks = np.concatenate(
        [np.maximum(rho - wide, 0.0), np.abs(rho - wide), np.abs(rho - narrow), rho + narrow, rho + wide], axis=1
    )
    kinks.sort(axis=1)
    low, width = kinks[:, :-1, None], np.diff(kinks, axis=1)[:, :, None]
    cuts = (low + width * np.array(CUTS)).reshape(offsets.size, -1, len(CUTS))
    t, w = np.polynomial.legendre.leggauss(nodes)
    t = np.pi / 2 * (1 + t)
    # Nodes crowd at both ends of a panel, as (1 − cos t)/2: a power 3/2 of the distance from a kink is smooth in t.
    u, du = (1 - np.cos(t)) / 2, np.pi / 4 * w * np.sin(t)
    step = np.diff(cuts, axis=2)[..., None]
    r = (cuts[..., :-1, None] + step * u).reshape(offsets.size, -1)
    weight = (step * du).reshape(offsets.size, -1)
    return SpotRule(np.maximum(r, LEAST * wide), weight * 2 * np.pi * r * _shared(rho, r, a, b))


def _shared(rho: np.ndarray, r: np.ndarray, a: float, b: float) -> np.ndarray:
    """The area that two discs share, over the product of theirs, as a mean over the circle of shifts by r about ρ."""
    small, large = sorted((a, b))
    inside, outside = (_angle(rho, r, edge) for edge in (large - small, large + small))
    mean = inside / np.pi
    if small > 0:
        t, w = np.polynomial.legendre.leggauss(ANGLES)
        t = np.pi / 2 * (1 + t)
        phi = inside[..., None] + (outside - inside)[..., None] * (1 - np.cos(t)) / 2
        d2 = rho[..., None] ** 2 + r[..., None] ** 2 - 2 * (rho * r)[..., None] * np.cos(phi)
        lens = _lens(np.sqrt(np.maximum(d2, 0.0)), small, large) / (np.pi * small**2)
        mean = mean + (outside - inside) / np.pi * np.sum(lens * (np.pi / 4 * w * np.sin(t)), axis=-1)
    return mean / (np.pi * large**2)


def _angle(rho: np.ndarray, r: np.ndarray, edge: float) -> np.ndarray:
    """The angle in [0, π] up to which points of the circle are within `edge` of the centre."""
    product, difference = 2 * rho * r, rho**2 + r**2 - edge**2
    inside = np.abs(difference) < product
    return np.arccos(np.where(inside, difference / np.where(inside, product, 1.0), np.sign(difference)))


def _lens(d: np.ndarray, small: float, large: float) -> np.ndarray:
    """The area that two discs share whose centres are d apart."""
    safe = np.maximum(d, 1e-300)
    first, second = (
        np.arccos(np.clip((d**2 + p**2 - q**2) / (2 * safe * p), -1.0, 1.0))
        for p, q in ((small, large), (large, small))
    )
    kite = (small + large - d) * (d + small - large) * (d - small + large) * (d + small + large)
    return small**2 * first + large**2 * second - np.sqrt(np.maximum(kite, 0.0)) / 2

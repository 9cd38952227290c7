"""What is lost where a renderer's expression is far from a surface, in words: where most of the difference lies."""

from collections.abc import Mapping

import numpy as np

from gonio.exports.forms import Appearance, Values, base_terms
from gonio.exports.pairs import Pairs
from gonio.models.surface_scatter.grating import GratingOrders

FAR = 0.05
"""Relative rms from which on it is told what is lost."""
MOST = 0.5
"""Share of the squared difference that is most of it."""
BACK, TURNED = float(np.cos(np.deg2rad(25))), float(np.cos(np.deg2rad(15)))
"""Cosines of the angle about the light, and of the least tilt of the light, of what is thrown back."""
SIDE = float(np.cos(np.deg2rad(60)))
"""Cosine of the azimuth from the light up to which a rough diffuser is brighter."""
LOW = float(np.cos(np.deg2rad(75)))
PEAK = 4.0
"""Of the mean of f: what is a highlight."""


def losses(sought: Appearance, values: Values, pairs: Pairs, f: np.ndarray, difference: np.ndarray) -> tuple[str, ...]:
    """Sentences on a difference (n, C) of an expression, with these numbers, from f (n, C) in front of a surface."""
    lost = []
    if any(isinstance(model, GratingOrders) for _, model in base_terms(sought.material.brdf)):
        lost.append("the orders of diffraction are lost: a renderer's lobe is about the mirror direction")
    if not sought.isotropic and not _grained(values):
        lost.append("the grain is lost: the expression is the same for all azimuths")
    return (*lost, *_where(pairs, f, difference))


def _grained(values: Mapping[str, np.ndarray]) -> bool:
    """Whether these numbers make an anisotropic lobe."""
    if any(float(v) > 0.02 for name, v in values.items() if name in ("anisotropic", "anisotropy")):
        return True
    for wide, narrow in (("alpha_x", "alpha_y"), ("alpha_u", "alpha_v")):
        for name in (n for n in values if n.startswith(wide)):
            ratio = float(values[name] / values[narrow + name.removeprefix(wide)])
            if abs(np.log(ratio)) > 0.05:
                return True
    return False


def _where(pairs: Pairs, f: np.ndarray, difference: np.ndarray) -> tuple[str, ...]:
    squares, bright = pairs.weight * np.sum(difference**2, axis=1), pairs.weight * f.mean(axis=1)
    if squares.sum() <= 0 or bright.sum() <= 0:
        return ()
    cosine = np.sum([a * b for a, b in zip(pairs.wi, pairs.wo, strict=True)], axis=0)
    back = (cosine > BACK) & (pairs.wi.z < TURNED)
    across = np.sqrt(np.maximum((1 - pairs.wi.z**2) * (1 - pairs.wo.z**2), 0.0))
    side = ~back & (pairs.wi.z < TURNED) & (cosine - pairs.wi.z * pairs.wo.z > SIDE * across)
    low = np.minimum(pairs.wi.z, pairs.wo.z) < LOW
    peak = f.mean(axis=1) > PEAK * bright.sum() / pairs.weight.sum()
    regions = (
        ("retro-reflection", back),
        ("highlights at grazing incidence", ~back & ~side & peak & low),
        ("highlights", ~back & ~side & peak & ~low),
        ("grazing directions beside highlights", ~back & ~side & ~peak & low),
        ("directions beside highlights", ~back & ~side & ~peak & ~low),
        ("retro-reflection and the brightness on the side of the light", back | side),
    )
    shares = [float(squares[region].sum() / squares.sum()) for _, region in regions]
    first = int(np.argmax(shares[:-1]))
    name, region = regions[first if shares[first] >= MOST else -1]
    share = float(squares[region].sum() / squares.sum())
    if share < MOST:
        return ()
    change = float(np.sum(pairs.weight[region] * difference[region].mean(axis=1)) / max(bright[region].sum(), 1e-30))
    way = "too dark" if change < 0 else "too bright"
    by = f", {way} by {100 * abs(change):.0f} %" if abs(change) >= 0.01 else ", in shape alone"
    return (f"most of the difference ({100 * share:.0f} %) is in {name}{by}",)

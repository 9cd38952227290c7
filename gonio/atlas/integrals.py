"""Hemisphere integrals: the claimed bound against the error, seen by rings about the lobe's middle.

The reference is ∫ f cosθ dω in polar coordinates about the mirror direction, the light or the normal, by rings that
grow by factors and end exactly at the horizon: nothing of the model's own map, and no trust in how wide it says it is.
It is done with two rules, whose difference is what the reference itself is known to.
"""

import jax.numpy as jnp
import numpy as np

from gonio.atlas.cell import RIGHT, SAYS_SO, SILENT, Cell
from gonio.models.base import AbstractBRDF
from gonio.models.building import build
from gonio.models.evaluate import evaluate
from gonio.models.geometry import Direction
from gonio.models.quadrature import directional_albedo

INCIDENCES = {"0°": 0.0, "30°": 30.0, "60°": 60.0, "80°": 80.0, "89°": 89.0, "89.9°": 89.9}
AZIMUTH = 0.3
TOLERANCE = 1e-6
ORDERS = (12, 20)
LEAST = 1e-7
"""Radius of the first ring, radians: less than the thousandth part of the narrowest lobe."""


def ring_albedo(brdf: AbstractBRDF, theta_i: float, order: int, about: str) -> float:
    """∫ f cosθo dωo by rings about the mirror direction, the light or the normal, with Gauss rules of this order."""
    c, s = np.cos(theta_i), np.sin(theta_i)
    middle = {"mirror": (-s, c), "light": (s, c), "normal": (0.0, 1.0)}[about]  # (along the light's azimuth, z)
    tilt, up = np.arctan2(abs(middle[0]), middle[1]), np.pi / 2
    x, w = np.polynomial.legendre.leggauss(order)
    horizon = up - tilt
    cuts = np.geomspace(LEAST, np.pi, 2 * int(np.log2(np.pi / LEAST)) + 1)
    cuts = np.concatenate([[0.0], cuts, [horizon, theta_i, 2 * theta_i] if horizon > 0 else [theta_i, 2 * theta_i]])
    # Where the rings first touch the horizon, and from the light and the mirror, cells shrink from both sides.
    ends = [horizon, 2 * theta_i, np.pi - horizon, up] if tilt > 0 else [up]
    near = np.array([a + d * k for a in ends for d in np.geomspace(1e-6, 0.3, 14) for k in (-1, 1)])
    cuts = np.unique(np.clip(np.concatenate([cuts, ends, near]), 0.0, up + tilt if tilt > 0 else up))
    width = np.diff(cuts)
    beta = (cuts[:-1, None] + width[:, None] * (x + 1) / 2).ravel()
    weight = (width[:, None] * w / 2).ravel() * np.sin(beta)
    # ψ is counted from the plane of incidence, the normal's side; above the horizon where cosψ > −cotβ cot tilt.
    if tilt > 0:
        ratio = -np.cos(beta) * np.cos(tilt) / np.maximum(np.sin(beta) * np.sin(tilt), 1e-300)
        psi_end = np.arccos(np.clip(ratio, -1, 1))
    else:
        psi_end = np.full(beta.size, np.pi)
    steps = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 10)])
    steps = np.unique(np.concatenate([steps / 2, 1 - steps / 2]))
    v = (steps[:-1, None] + np.diff(steps)[:, None] * (x + 1) / 2).ravel()
    vw = (np.diff(steps)[:, None] * w / 2).ravel()
    b, p = np.broadcast_arrays(beta[:, None], psi_end[:, None] * v)
    towards = np.sign(middle[0]) or 1.0
    # Local frame: e along the slope up to the normal, the middle itself, and across.
    along = np.cos(b) * np.sin(tilt) - np.sin(b) * np.cos(p) * np.cos(tilt)
    z = np.cos(b) * np.cos(tilt) + np.sin(b) * np.cos(p) * np.sin(tilt)
    y = np.sin(b) * np.sin(p)
    total = 0.0
    for side in (1.0, -1.0):
        f = _values(brdf, theta_i, towards * along, side * y, z)
        total += float(np.sum((f * np.maximum(z, 0.0)).dot(vw) * psi_end * weight))
    return total


def _values(brdf, theta_i, x, y, z) -> np.ndarray:
    ca, sa = np.cos(AZIMUTH), np.sin(AZIMUTH)
    wi = Direction(*(jnp.asarray(v) for v in (np.sin(theta_i) * ca, np.sin(theta_i) * sa, np.cos(theta_i))))
    flat = [a.ravel() for a in (x * ca - y * sa, x * sa + y * ca, z)]
    pad = -len(flat[0]) % (1 << 16)
    flat = [np.concatenate([a, np.full(pad, e)]) for a, e in zip(flat, (0.0, 0.0, 1.0), strict=True)]
    f = [
        np.asarray(evaluate(brdf, wi, Direction(*(a[k : k + (1 << 16)] for a in flat))))
        for k in range(0, len(flat[0]), 1 << 16)
    ]
    return np.concatenate(f)[: x.size].reshape(x.shape)


def reference_albedo(brdf: AbstractBRDF, theta_i: float) -> tuple[float, float]:
    """(albedo, how far it is known): rings about the middle that two rules agree best about."""
    found = []
    for about in ("mirror", "light", "normal") if theta_i > 0 else ("mirror",):
        low, high = (ring_albedo(brdf, theta_i, order, about) for order in ORDERS)
        # Agreement by accident is not knowledge: no better than a hundred roundings.
        found.append((high, abs(high - low) + 1e-13 * abs(high)))
        if found[-1][1] < 1e-9 * max(abs(high), 1e-3):
            break
    value, known = min(found, key=lambda a: a[1])
    # Two rules may agree by accident: no closer than another middle's, where there was need of one.
    others = [abs(v - value) for v, k in found if (v, k) != (value, known)]
    return value, max([known, *sorted(others)[:1]])


def integral_cells(name: str, spelling: str, precision: str = "float64") -> list[Cell]:
    """One cell for each incidence: right, or a bound above the tolerance that holds, or a bound that does not hold."""
    brdf = build(spelling)
    cells = []
    theta = np.radians(list(INCIDENCES.values()))
    ours = directional_albedo(brdf, theta, np.full(theta.size, AZIMUTH), TOLERANCE / 4)
    for column, t, value, bound in zip(INCIDENCES, theta, ours.value, ours.bound, strict=True):
        if not np.isfinite(value):
            cells.append(
                Cell("integral", name, spelling, column, precision, SAYS_SO, float("inf"), 0.0, "not a finite number")
            )
            continue
        reference, known = reference_albedo(brdf, float(t))
        error = abs(float(value) - reference)
        if error > bound + 3 * known:
            verdict = SILENT
        else:
            verdict = RIGHT if bound <= TOLERANCE * max(1.0, abs(value)) else SAYS_SO
        detail = f"albedo {value:.10g} ± {bound:.1e}, by rings {reference:.10g} ± {known:.1e}"
        cells.append(Cell("integral", name, spelling, column, precision, verdict, error, float(bound), detail))
    return cells

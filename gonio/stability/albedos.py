"""Hemisphere integrals: the claimed bound against the error, seen by rings about the lobe's middle.

The reference is ∫ f cosθ dω in polar coordinates about the mirror direction, the light or the normal, by rings that
grow by factors and end exactly at the horizon: nothing of the model's own map, and no trust in how wide it says it is.
Their cells are halved until two rules agree; what these still differ by is what the reference itself is known to.
"""

import jax.numpy as jnp
import numpy as np

from gonio.models.albedo import directional_albedo
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction
from gonio.stability.outcome import RIGHT, SAYS_SO, SILENT, Cell
from gonio.stability.rectangle_cubature import integrate

INCIDENCES = {"0°": 0.0, "30°": 30.0, "60°": 60.0, "80°": 80.0, "89°": 89.0, "89.9°": 89.9}
AZIMUTH = 0.3
TOLERANCE = 1e-6
ENOUGH = 5e-10
"""Error at which no cell of the reference is halved further; ten times that, and no other middle is tried."""
UNSEEN = 2e-9
"""What slivers between a kink and the side of a cell, narrower than the first node's distance, may hide."""
LEAST = 1e-7
"""Radius of the first ring, radians: less than the thousandth part of the narrowest lobe."""
TURN = (1e-3, 0.03, 0.5)
"""Cuts of half a ring: lobes in the plane of incidence must not lie between the first nodes."""
STRIP = (0.3, 3.0, 30.0)
"""Cuts towards the horizon, in widths of the strip below the light, at whose side many laws have a kink."""


def ring_albedo(brdf: AbstractBRDF, theta_i: float, about: str, enough: float = ENOUGH) -> tuple[float, float]:
    """(∫ f cosθo dωo, its error) by rings about the mirror direction, the light or the normal."""
    c, s = np.cos(theta_i), np.sin(theta_i)
    middle = {"mirror": (-s, c), "light": (s, c), "normal": (0.0, 1.0)}[about]  # (along the light's azimuth, z)
    tilt, up = np.arctan2(abs(middle[0]), middle[1]), np.pi / 2
    towards = np.sign(middle[0]) or 1.0

    def integrand(beta, v):
        # ψ is counted from the plane of incidence, the normal's side; above the horizon where cosψ > −cotβ cot tilt.
        end = np.full(beta[..., :1].shape, np.pi)
        if tilt > 0:
            b = beta[..., :1]
            ratio = -np.cos(b) * np.cos(tilt) / np.maximum(np.sin(b) * np.sin(tilt), 1e-300)
            end = np.arccos(np.clip(ratio, -1, 1))
        psi = end * v
        # Local frame: e along the slope up to the normal, the middle itself, and across.
        sin_b, cos_b, cos_p = np.sin(beta), np.cos(beta), np.cos(psi)
        along = cos_b * np.sin(tilt) - sin_b * cos_p * np.cos(tilt)
        z = cos_b * np.cos(tilt) + sin_b * cos_p * np.sin(tilt)
        f = _values(brdf, theta_i, towards * along, sin_b * np.sin(psi), z)
        return f * np.maximum(z, 0.0) * sin_b * end

    rings = _cuts(tilt, theta_i, up + tilt if tilt > 0 else up)
    ends = [v for v in 1 - np.array(STRIP) * (1 - theta_i / up) if v > max(TURN)]
    half = np.array([0.0, *TURN, *sorted(ends), 1.0])
    turn = np.concatenate([-half[:0:-1], half])
    a0, b0 = (g.ravel() for g in np.meshgrid(rings[:-1], turn[:-1], indexing="ij"))
    a1, b1 = (g.ravel() for g in np.meshgrid(rings[1:], turn[1:], indexing="ij"))
    (total,), error = integrate(integrand, np.stack([a0, b0, a1, b1], -1), np.zeros(a0.size, int), enough)
    return float(total), error


def _cuts(tilt: float, theta_i: float, last: float) -> np.ndarray:
    # Where the rings first touch the horizon, and from the light and the mirror, cells shrink from both sides.
    horizon = np.pi / 2 - tilt
    ends = [horizon, 2 * theta_i, np.pi - horizon, np.pi / 2] if tilt > 0 else [np.pi / 2]
    near = [a + d * k for a in ends for d in np.geomspace(1e-6, 0.3, 6) for k in (-1, 0, 1)]
    grown = np.geomspace(LEAST, np.pi, int(np.log2(np.pi / LEAST)) + 1)
    return np.unique(np.clip(np.concatenate([[0.0, theta_i], grown, near]), 0.0, last))


def _values(brdf, theta_i, x, y, z) -> np.ndarray:
    ca, sa = np.cos(AZIMUTH), np.sin(AZIMUTH)
    wi = Direction(*(jnp.asarray(v) for v in (np.sin(theta_i) * ca, np.sin(theta_i) * sa, np.cos(theta_i))))
    return np.asarray(evaluate(brdf, wi, Direction(x * ca - y * sa, x * sa + y * ca, z)))


def reference_albedo(brdf: AbstractBRDF, theta_i: float, every: bool = False) -> tuple[float, float]:
    """(albedo, how far it is known): rings about the middle that is known best; about `every` middle where asked."""
    found = []
    for about in ("mirror", "light", "normal") if theta_i > 0 else ("mirror",):
        value, known = ring_albedo(brdf, theta_i, about)
        found.append((value, known + UNSEEN * max(abs(value), 1.0)))
        if known < 10 * ENOUGH * max(abs(value), 1.0) and not every:
            break
    value, known = min(found, key=lambda a: a[1])
    # Two rules may agree by accident: no closer than another middle's, where there was need of one.
    others = [abs(v - value) for v, k in found if (v, k) != (value, known)]
    return value, max([known, *sorted(others)[:1]])


def integral_cells(name: str, expression: str, precision: str = "float64") -> list[Cell]:
    """One cell for each incidence: right, or a bound above the tolerance that holds, or a bound that does not hold."""
    brdf = build(expression)
    cells = []
    theta = np.radians(list(INCIDENCES.values()))
    ours = directional_albedo(brdf, theta, np.full(theta.size, AZIMUTH), TOLERANCE / 4)
    for column, t, value, bound in zip(INCIDENCES, theta, ours.value, ours.bound, strict=True):
        reference, known = reference_albedo(brdf, float(t)) if np.isfinite(value) else (np.nan, np.nan)
        if not np.isfinite([reference, known]).all():
            what = f"albedo {value:.10g}, by rings {reference:.10g}: not a finite number"
            cells.append(Cell("integral", name, expression, column, precision, SAYS_SO, float("inf"), 0.0, what))
            continue
        error = abs(float(value) - reference)
        if error > bound + 3 * known:
            # Nobody is accused by one witness: the other middles have to agree.
            reference, known = reference_albedo(brdf, float(t), every=True)
            error = abs(float(value) - reference)
        if error > bound + 3 * known:
            verdict = SILENT
        else:
            verdict = RIGHT if bound <= TOLERANCE * max(1.0, abs(value)) else SAYS_SO
        detail = f"albedo {value:.10g} ± {bound:.1e}, by rings {reference:.10g} ± {known:.1e}"
        cells.append(Cell("integral", name, expression, column, precision, verdict, error, float(bound), detail))
    return cells

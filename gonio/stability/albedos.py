"""Directional albedos: the claimed bound against the error, by rings about the middle of the lobe.

The reference is ∫ f cosθ dω in polar coordinates about the mirror direction, the light or the normal, by rings that
grow by factors and end exactly at the horizon: it does not use the model's own map, nor the width that the model
claims. Their cells are halved until two rules agree; their remaining difference is the uncertainty of the reference.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.folded import Folded
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.sides import Hemispheres
from gonio.stability.directions import AZIMUTH, unit_vector
from gonio.stability.outcome import RIGHT, SAYS_SO, SILENT, VERDICTS, Cell
from gonio.stability.rectangle_cubature import integrate

INCIDENCES = {"0°": 0.0, "30°": 30.0, "60°": 60.0, "80°": 80.0, "89°": 89.0, "89.9°": 89.9}
TOLERANCE = 1e-6
ENOUGH = 5e-10
"""Error at which no cell of the reference is halved further; ten times that, and no other middle is used."""
UNRESOLVED = 2e-9
"""Integral of slivers between a kink and the side of a cell that are narrower than the first node's distance."""
LEAST = 1e-7
"""Radius of the first ring, radians: less than the thousandth part of the narrowest lobe."""
TURN = (1e-3, 0.03, 0.5)
"""Cuts of half a ring: lobes in the plane of incidence must not lie between the first nodes."""
STRIP = (0.3, 3.0, 30.0)
"""Cuts towards the horizon, in widths of the strip below the light, at whose side many laws have a kink."""


class ReferenceAlbedo(NamedTuple):
    """A directional albedo and its uncertainty."""

    value: float
    uncertainty: float


class _Rings(NamedTuple):
    # Polar coordinates about a middle that is tilted from the normal, towards the light (1) or away from it (-1).
    tilt: float
    towards: float

    @classmethod
    def about(cls, middle: str, theta_i: float, bend: float = 1.0) -> "_Rings":
        c, s = np.cos(theta_i), np.sin(theta_i)
        bent = min(bend * s, 1.0)
        refracted = -bent, np.sqrt(1 - bent * bent)
        x, z = {"mirror": (-s, c), "light": (s, c), "normal": (0.0, 1.0), "refracted": refracted}[middle]
        return cls(np.arctan2(abs(x), z), np.sign(x) or 1.0)

    def cells(self, theta_i: float) -> np.ndarray:
        """Rows (β0, v0, β1, v1), v the share of half a ring."""
        rings = self._cuts(theta_i, np.pi / 2 + self.tilt)
        ends = [v for v in 1 - np.array(STRIP) * (1 - theta_i / (np.pi / 2)) if v > max(TURN)]
        half = np.array([0.0, *TURN, *sorted(ends), 1.0])
        turn = np.concatenate([-half[:0:-1], half])
        low, high = (np.meshgrid(rings[k], turn[k], indexing="ij") for k in (slice(-1), slice(1, None)))
        return np.stack([c.ravel() for c in (*low, *high)], -1)

    def _cuts(self, theta_i: float, last: float) -> np.ndarray:
        # Where the rings first touch the horizon, and from the light and the mirror, cells shrink from both sides.
        horizon = np.pi / 2 - self.tilt
        ends = [horizon, 2 * theta_i, np.pi - horizon, np.pi / 2] if self.tilt > 0 else [np.pi / 2]
        near = [a + d * k for a in ends for d in np.geomspace(1e-6, 0.3, 6) for k in (-1, 0, 1)]
        grown = np.geomspace(LEAST, np.pi, int(np.log2(np.pi / LEAST)) + 1)
        return np.unique(np.clip(np.concatenate([[0.0, theta_i], grown, near]), 0.0, last))

    def integrand(self, brdf: AbstractBRDF, theta_i: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        """f cosθo sinβ dψ/dv of β and v."""
        sin_t, cos_t = np.sin(self.tilt), np.cos(self.tilt)
        sin_a, cos_a = np.sin(AZIMUTH), np.cos(AZIMUTH)
        wi = Direction(*unit_vector(theta_i))

        def flux(beta: np.ndarray, v: np.ndarray) -> np.ndarray:
            # ψ is counted from the plane of incidence, the normal's side; above the horizon, cosψ > −cotβ cot tilt.
            end = np.full(beta[..., :1].shape, np.pi)
            if self.tilt > 0:
                b = beta[..., :1]
                end = np.arccos(np.clip(-np.cos(b) * cos_t / np.maximum(np.sin(b) * sin_t, 1e-300), -1, 1))
            psi = end * v
            # Local frame: along the slope up to the normal, the middle itself, and across.
            sin_b, cos_b, cos_p = np.sin(beta), np.cos(beta), np.cos(psi)
            x = self.towards * (cos_b * sin_t - sin_b * cos_p * cos_t)
            y = sin_b * np.sin(psi)
            z = cos_b * cos_t + sin_b * cos_p * sin_t
            f = np.asarray(evaluate(brdf, wi, Direction(x * cos_a - y * sin_a, x * sin_a + y * cos_a, z)))
            return f * np.maximum(z, 0.0) * sin_b * end

        return flux


def ring_albedo(
    brdf: AbstractBRDF, theta_i: float, about: str, tolerance: float = ENOUGH, bend: float = 1.0
) -> ReferenceAlbedo:
    """∫ f cosθo dωo, with the rule's error, by rings about the "mirror" direction, the "light" or the "normal".

    Of a folded interface, which sends light to sin θo = `bend` sin θi, about the "refracted" direction too.
    """
    rings = _Rings.about(about, theta_i, bend)
    cells = rings.cells(theta_i)
    done = integrate(rings.integrand(brdf, theta_i), cells, np.zeros(len(cells), int), tolerance)
    return ReferenceAlbedo(float(done.values[0]), done.error)


def reference_albedo(
    brdf: AbstractBRDF, theta_i: float, all_middles: bool = False, bend: float = 1.0
) -> ReferenceAlbedo:
    """The albedo by rings about the middle with the least uncertainty.

    The next middle is used where the one before leaves more than ten times `ENOUGH`, or with `all_middles`; `bend` as
    of `ring_albedo`.
    """
    estimates: list[ReferenceAlbedo] = []
    middles = ("mirror", "light", "normal") if bend == 1.0 else ("refracted", "normal", "mirror")
    for about in middles if theta_i > 0 else middles[:1]:
        value, error = ring_albedo(brdf, theta_i, about, bend=bend)
        size = max(abs(value), 1.0)
        estimates.append(ReferenceAlbedo(value, error + UNRESOLVED * size))
        if estimates[-1].uncertainty < 10 * ENOUGH * size and not all_middles:
            break
    best = min(estimates, key=lambda e: e.uncertainty)
    # Two rules may agree by accident: no closer than another middle's, where there was need of one.
    others = [abs(e.value - best.value) for e in estimates if e != best]
    return ReferenceAlbedo(best.value, max([best.uncertainty, *sorted(others)[:1]]))


def integral_cells(name: str, expression: str, precision: str = "float64") -> list[Cell]:
    """One cell for each incidence: right, or a bound above the tolerance that holds, or a bound that does not hold.

    Of what transmits it is the worse one of what is reflected and what goes through.
    """
    brdf = build(expression)
    theta = np.radians(list(INCIDENCES.values()))
    ways = [(brdf, directional_albedo(brdf, theta, AZIMUTH, TOLERANCE / 4), 1.0)]
    if Hemispheres.TRANSMISSION in brdf.hemispheres:
        through = directional_transmittance(brdf, theta, AZIMUTH, TOLERANCE / 4)
        bend = 1 / float(np.mean(np.asarray(brdf.index_behind)))
        ways = [*(ways if Hemispheres.REFLECTION in brdf.hemispheres else []), (Folded(brdf, 1, -1), through, bend)]
    cells = []
    for k, (column, t) in enumerate(zip(INCIDENCES, theta, strict=True)):
        judged = [_judged(part, float(t), float(e.value[k]), float(e.bound[k]), bend) for part, e, bend in ways]
        worst = max(judged, key=lambda one: (VERDICTS.index(one[0]), one[1]))
        cells.append(Cell("integral", name, expression, column, precision, *worst))
    return cells


def _judged(
    brdf: AbstractBRDF, theta_i: float, value: float, bound: float, bend: float
) -> tuple[str, float, float, str]:
    # (verdict, error, bound, detail) of a claimed albedo.
    reference = reference_albedo(brdf, theta_i, bend=bend) if np.isfinite(value) else ReferenceAlbedo(np.nan, np.nan)
    if not np.isfinite(reference).all():
        return SAYS_SO, np.inf, 0.0, f"albedo {value:.10g}, by rings {reference.value:.10g}: not a finite number"
    if abs(value - reference.value) > bound + 3 * reference.uncertainty:
        # A failure needs more than one reference: the other middles have to agree.
        reference = reference_albedo(brdf, theta_i, all_middles=True, bend=bend)
    error = abs(value - reference.value)
    if error > bound + 3 * reference.uncertainty:
        verdict = SILENT
    else:
        verdict = RIGHT if bound <= TOLERANCE * max(1.0, abs(value)) else SAYS_SO
    by_rings = f"by rings {reference.value:.10g} ± {reference.uncertainty:.1e}"
    return verdict, error, bound, f"albedo {value:.10g} ± {bound:.1e}, {by_rings}"

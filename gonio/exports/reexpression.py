"""How far a renderer's expression of a surface is from it: the figures that every export prints and carries."""

import dataclasses

import numpy as np

from gonio.exports.forms import Appearance
from gonio.exports.nearest import Nearest
from gonio.figures.spheres import sphere_pairs
from gonio.fitting.residuals.colour_difference import LINEAR_SRGB, ciede2000, to_lab

LIGHTS, TILTS, AZIMUTHS = 16, 64, 16
SIDE = 64
"""Pixels across the lit sphere."""
ROUNDING = 1e-5
"""Relative difference, largest over all pairs, up to which an expression is exact: renderers compute in single."""


@dataclasses.dataclass(frozen=True)
class ReExpression:
    """What is lost where a renderer says a surface in its own terms.

    Attributes:
        target: the renderer; `form`: what it says the surface with.
        relative_rms: √(∫∫ (m − f)² cosθi cosθo dωi dωo / ∫∫ f² cosθi cosθo dωi dωo).
        albedo_difference: largest over incidences up to 86°.
        delta_e_mean, delta_e_max: CIEDE2000 over a sphere under a distant light, 35° and 100° from the eye (D65, a
            white diffuser facing the light is white).
        exact: whether f differs nowhere by more than rounding in single precision.
        remarks: what the renderer cannot say, and what became of the channels.
        written: the files.
    """

    target: str
    form: str
    relative_rms: float
    albedo_difference: float
    delta_e_mean: float
    delta_e_max: float
    exact: bool
    remarks: tuple[str, ...] = ()
    written: tuple[str, ...] = ()

    def within(self, tolerance: float) -> bool:
        """Whether neither the relative rms nor the difference of albedo is larger."""
        return max(self.relative_rms, self.albedo_difference) <= tolerance

    @property
    def figures(self) -> str:
        """The errors in words."""
        if self.exact:
            return "exact, up to rounding"
        return (
            f"rms {100 * self.relative_rms:.2g} % of f (cosine-weighted), albedo off by up to "
            f"{100 * self.albedo_difference:.2g} %, a lit sphere by ΔE2000 {self.delta_e_mean:.2g} in the mean and "
            f"{self.delta_e_max:.2g} at most"
        )

    def __str__(self) -> str:
        return "\n".join([f"{self.form}: {self.figures}", *(f"note: {remark}" for remark in self.remarks)])


def reexpression(target: str, sought: Appearance, expression: Nearest, remarks: tuple[str, ...] = ()) -> ReExpression:
    """The errors of an expression, at other and more directions than it was fitted at."""
    pairs = sought.pairs(LIGHTS, TILTS, AZIMUTHS)
    f = sought.f(pairs.wi, pairs.wo)
    difference = np.broadcast_to(expression.form.f(expression.values, pairs), f.shape) - f
    weight = pairs.weight[:, None]
    squares = float(np.sum(weight * f * f))
    largest = np.abs(difference) / np.maximum(np.abs(f), 1e-6 * max(float(np.abs(f).max(initial=0.0)), 1e-30))
    colours = sphere_colours(sought, expression)
    return ReExpression(
        target=target,
        form=expression.form.name,
        relative_rms=float(np.sqrt(np.sum(weight * difference**2) / squares)) if squares > 0 else 0.0,
        albedo_difference=float(np.abs(pairs.albedo(difference)).max(initial=0.0)),
        delta_e_mean=float(colours.mean()),
        delta_e_max=float(colours.max(initial=0.0)),
        exact=bool(largest.max(initial=0.0) <= ROUNDING),
        remarks=(*sought.remarks, *remarks),
    )


def sphere_colours(sought: Appearance, expression: Nearest) -> np.ndarray:
    """CIEDE2000 of each pixel of the lit spheres."""
    from gonio.exports.pairs import Pairs

    _, eye, lights = sphere_pairs(SIDE)
    differences = []
    for light in lights:
        lit = (light.z > 1e-6) & (eye.z > 1e-6)
        wi, wo = (type(w)(*(c[lit] for c in w)) for w in (light, eye))
        empty = np.zeros(wi.z.size)
        pairs = Pairs(wi, wo, empty, empty.astype(int), np.zeros(1))
        f = sought.f(wi, wo)
        both = (f, np.broadcast_to(expression.form.f(expression.values, pairs), f.shape))
        shown = [np.clip(np.pi * wi.z[:, None] * v, 0, 1) for v in both]
        lab = [to_lab(np.broadcast_to(v, (len(v), 3)) @ LINEAR_SRGB.T, LINEAR_SRGB.sum(axis=1)) for v in shown]
        differences.append(ciede2000(*lab))
    return np.concatenate(differences)

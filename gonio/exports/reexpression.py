"""How far a renderer's expression of a surface is from it: the figures that every export prints and carries."""

import dataclasses

import numpy as np

from gonio.exports.forms import Appearance
from gonio.exports.losses import FAR, losses
from gonio.exports.nearest import GAIN, Nearest
from gonio.exports.pairs import LOWEST, Pairs
from gonio.figures.spheres import sphere_pairs
from gonio.fitting.residuals.colour_difference import LINEAR_SRGB, ciede2000, to_lab

LIGHTS, TILTS, AZIMUTHS = 16, 64, 16
SIDE = 64
"""Pixels across the lit sphere."""
ROUGHLY = "the surface has lobes narrower than the steps between the directions compared: the figures are rough"
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
        others: the renderer's other forms with their relative rms, the nearest first.
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
    others: tuple[tuple[str, float], ...] = ()

    def within(self, tolerance: float) -> bool:
        """Whether neither the relative rms nor the difference of albedo is larger."""
        return max(self.relative_rms, self.albedo_difference) <= tolerance

    @property
    def figures(self) -> str:
        """The errors in words."""
        if self.exact:
            return "exact, up to rounding"
        rms, albedo, mean, most = map(
            _short, (100 * self.relative_rms, 100 * self.albedo_difference, self.delta_e_mean, self.delta_e_max)
        )
        return (
            f"rms {rms} % of f (cosine-weighted), albedo off by up to {albedo} %, a lit sphere by ΔE2000 {mean} in the "
            f"mean and {most} at most"
        )

    def __str__(self) -> str:
        return "\n".join([f"{self.form}: {self.figures}", *(f"note: {remark}" for remark in self.remarks)])


def _short(value: float) -> str:
    """Two digits, without a power of ten."""
    if value < 1e-3:
        return "less than 0.001"
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def reexpression(target: str, sought: Appearance, expression: Nearest, remarks: tuple[str, ...] = ()) -> ReExpression:
    """The errors of an expression, at other and more directions than it was fitted at; light that goes through too."""
    pairs = sought.pairs(LIGHTS, TILTS, AZIMUTHS)
    sides = [pairs, pairs.through()] if sought.transmits else [pairs]
    squares, off, albedo, exact, lost = 0.0, 0.0, 0.0, True, ()
    for side in sides:
        f = sought.f(side.wi, side.wo)
        silent = side is not pairs and not expression.form.transmits
        difference = -f if silent else np.broadcast_to(expression.form.f(expression.values, side), f.shape) - f
        largest = float(np.abs(f).max(initial=0.0))
        squares += float(np.sum(side.weight[:, None] * f * f))
        off += float(np.sum(side.weight[:, None] * difference**2))
        albedo = max(albedo, float(np.abs(side.albedo(difference)[side.cosines >= LOWEST]).max(initial=0.0)))
        if side is pairs and off > FAR**2 * squares:
            lost = losses(sought, expression.values, side, f, difference)
        exact &= bool(np.all(np.abs(difference) <= ROUNDING * np.maximum(np.abs(f), 1e-6 * largest)))
    colours = sphere_colours(sought, expression)
    if sought.transmits and not expression.form.transmits:
        lost = ("light through the surface is lost: the expression reflects alone", *lost)
    lost = (*lost, *_cautions(sought, expression, pairs))
    return ReExpression(
        target=target,
        form=expression.form.name,
        relative_rms=float(np.sqrt(off / squares)) if squares > 0 else 0.0,
        albedo_difference=albedo,
        delta_e_mean=float(colours.mean()),
        delta_e_max=float(colours.max(initial=0.0)),
        exact=exact,
        remarks=(*sought.remarks, *remarks, *lost),
        others=tuple((other.form.name, other.relative_rms) for other in expression.others),
    )


def _cautions(sought: Appearance, expression: Nearest, pairs: Pairs) -> list[str]:
    """What else is to be known: light made, a back that is another, directions that are too coarse."""
    cautions = []
    if expression.light_made > GAIN:
        cautions.append(f"at grazing light up to {100 * expression.light_made:.0f} % more leaves than arrives")
    if sought.two_faced and expression.form.numbers:
        cautions.append("the back reflects otherwise than the front, and the expression does not")
    return cautions + [ROUGHLY] * (not expression.resolved)


def sphere_colours(sought: Appearance, expression: Nearest) -> np.ndarray:
    """CIEDE2000 of each pixel of the lit spheres."""
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

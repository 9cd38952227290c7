"""Honest models with one mistake each, as programs and files come to hold them, and what gives each mistake away."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from gonio.models.arrays import Channels
from gonio.models.brdf import AbstractBRDF
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction, add, normalize
from gonio.models.geometry.horizon import Hemispheres, same_side

TRUTH = "agreement"
"""The mistake breaks no law: only a stated truth gives it away."""


class Mutant(NamedTuple):
    """A mistake, the model that has it, the model that was meant, and the property that fails."""

    mistake: str
    model: AbstractBRDF
    meant: AbstractBRDF
    gives_away: str


class Mistaken(AbstractBRDF):
    """`base` with a mistake that is made in what comes of it, or in what it is asked."""

    base: AbstractBRDF
    mistake: str = eqx.field(static=True)

    @property
    def hemispheres(self) -> Hemispheres:
        return self.base.hemispheres

    @property
    def index_behind(self) -> Channels | float:
        return self.base.index_behind

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return MISTAKES[self.mistake](self.base, wi, wo)


class Textbook(AbstractBRDF):
    """GGX with separable Smith masking, as a textbook prints it, with at most one mistake."""

    alpha: float
    f0: float
    mistake: str = eqx.field(static=True, default="")

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        h = add(wi, wo)
        if self.mistake == "copied index":
            h = Direction(h.x, wi.y + wi.y, h.z)
        h = normalize(h)
        cos_d = wi.x * h.x + wi.y * h.y + wi.z * h.z
        cos_f = wi.z if self.mistake == "Fresnel of the incidence" else cos_d
        fresnel = self.f0 + (1 - self.f0) * (1 - jnp.clip(cos_f, 0, 1)) ** 5
        a2 = self.alpha if self.mistake == "width" else self.alpha**2
        density = a2 / (jnp.pi * (h.z**2 * a2 + h.x**2 + h.y**2) ** 2)
        masked_i, masked_o = (w.z + jnp.sqrt(a2 + (1 - a2) * w.z**2) for w in (wi, wo))
        masking = (
            1 / (2 * masked_i * jnp.maximum(wo.z, 1e-150))
            if self.mistake == "one-sided masking"
            else 1 / (masked_i * masked_o)
        )
        return fresnel * density * masking


def _mirrored(w: Direction) -> Direction:
    return Direction(-w.x, -w.y, w.z)


def _cos2(w: Direction) -> jnp.ndarray:
    # Of twice the azimuth, which at the normal is nowhere.
    return (w.x**2 - w.y**2) / jnp.maximum(w.x**2 + w.y**2, 1e-300)


def _in_transmission(base: AbstractBRDF, wi: Direction, wo: Direction, factor: Channels) -> Channels:
    return base.formula(wi, wo) * jnp.where(same_side(wi, wo), 1.0, factor)


MISTAKES = {
    "index lost": lambda base, wi, wo: _in_transmission(
        base, wi, wo, jnp.where(wi.z > 0, base.index_behind**-2.0, 1.0)
    ),
    "one way through": lambda base, wi, wo: _in_transmission(base, wi, wo, jnp.where(wi.z > 0, 1.0, 0.0)),
    "cosine kept through": lambda base, wi, wo: _in_transmission(base, wi, wo, jnp.abs(wo.z)),
    "cosine kept": lambda base, wi, wo: base.formula(wi, wo) * wo.z,
    "cosine divided twice": lambda base, wi, wo: base.formula(wi, wo) / jnp.maximum(wi.z, 1e-150),
    "coat of one way": lambda base, wi, wo: base.formula(wi, wo) * (1 - (0.04 + 0.96 * (1 - wi.z) ** 5)),
    "lopsided": lambda base, wi, wo: base.formula(wi, wo) * (1 + 0.5 * (wi.x * wo.y + wo.x * wi.y)),
    "dark level": lambda base, wi, wo: base.formula(wi, wo) - 0.01,
    "lobe thrown back": lambda base, wi, wo: base.formula(wi, _mirrored(wo)),
    "lobe clipped": lambda base, wi, wo: jnp.minimum(base.formula(wi, wo), 0.5),
    "grain": lambda base, wi, wo: base.formula(wi, wo) * (1 + 0.3 * wi.x**2 * wo.x**2),
    "azimuth at the normal": lambda base, wi, wo: base.formula(wi, wo) * (1 + 0.3 * _cos2(wi) * _cos2(wo)),
    "light's plane only": lambda base, wi, wo: base.formula(wi, wo) * (1 + 0.3 * wi.x * wi.x),
}


def mutants() -> list[Mutant]:
    """Each mistake once."""
    lobe, paint = Textbook(0.3, 1.0), build("ggx(alpha=0.3, f0=0.04) + lambert(rho=0.5)")
    brushed = build("ggx(alpha_x=0.1, alpha_y=0.4)")
    colours, glass = build("lambert(rho=[0.5, 0.9, 0.7])"), build("rough_dielectric(alpha=0.4, eta=1.5)")

    def wrong(name: str, base: AbstractBRDF = paint) -> Mistaken:
        return Mistaken(base, name)

    return [
        Mutant("f cosθo kept for f", wrong("cosine kept"), paint, "reciprocity"),
        Mutant("divided by cosθi once more", wrong("cosine divided twice"), paint, "reciprocity"),
        Mutant("Fresnel term of θi for that of the facet", Textbook(0.3, 0.04, "Fresnel of the incidence"),
               Textbook(0.3, 0.04), "reciprocity"),
        Mutant("masking of the light's side alone", Textbook(0.3, 1.0, "one-sided masking"), lobe, "reciprocity"),
        Mutant("h.y made of wi.y twice (a copied index)", Textbook(0.3, 1.0, "copied index"), lobe, "reciprocity"),
        Mutant("diffuse light dimmed on its way in alone", wrong("coat of one way", build("lambert(rho=0.9)")),
               build("lambert(rho=0.9)"), "reciprocity"),
        Mutant("brightness follows the light's azimuth alone", wrong("light's plane only"), paint, "reciprocity"),
        Mutant("η² at the exit lost", wrong("index lost", glass), glass, "reciprocity"),
        Mutant("h of refraction not turned to the front", wrong("one way through", glass), glass, "reciprocity"),
        Mutant("f_t cosθo kept for f_t", wrong("cosine kept through", glass), glass, "reciprocity"),
        Mutant("the 4 of 4 cosθi cosθo lost", 4.0 * lobe, lobe, "energy"),
        Mutant("the 1/π of a diffuser lost", build("3.14159 * lambert(rho=0.5)"), build("lambert(rho=0.5)"), "energy"),
        Mutant("one channel scaled by 1.25", jnp.array([1.0, 1.25, 1.0]) * colours, colours, "energy"),
        Mutant("lopsided in azimuth", wrong("lopsided"), paint, "symmetry"),
        Mutant("a dark level subtracted that was not there", wrong("dark level", build("ggx(alpha=0.1)")),
               build("ggx(alpha=0.1)"), "positivity"),
        Mutant("a grain in a surface said to be isotropic", wrong("grain"), paint, "isotropy"),
        Mutant("the azimuth of the normal asked", wrong("azimuth at the normal"), paint, "pole"),
        Mutant("α taken for α²", Textbook(0.3, 1.0, "width"), lobe, TRUTH),
        Mutant("a factor 1/4 too many", 0.25 * lobe, lobe, TRUTH),
        Mutant("the lobe thrown back to the light", wrong("lobe thrown back"), paint, TRUTH),
        Mutant("the lobe clipped", wrong("lobe clipped"), paint, TRUTH),
        Mutant("widths along x and y exchanged", build("ggx(alpha_x=0.4, alpha_y=0.1)"), brushed, TRUTH),
        Mutant("channels exchanged", build("lambert(rho=[0.9, 0.5, 0.7])"), colours, TRUTH),
    ]  # fmt: skip

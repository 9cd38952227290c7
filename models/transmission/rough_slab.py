"""A sheet of a clear medium whose two sides are rough."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from gonio.models.brdf import (
    AbstractBRDF,
    AbstractComposite,
    Channels,
    Direction,
    ParameterInfo,
    Sample,
    Scalar,
    parameter,
)
from gonio.models.geometry.guards import positive
from gonio.models.geometry.horizon import EVERYWHERE, Hemispheres
from gonio.models.microfacet.albedo_tables import Cosines
from gonio.models.microfacet.beckmann import Beckmann
from gonio.models.surface_scatter.shift_invariant import AbstractDiscLobe
from gonio.models.transmission.either_side import AbstractEitherSide
from gonio.models.transmission.rough_faces import Faces
from gonio.models.transmission.sheet_balance import (
    Balance,
    Direct,
    basis_of,
    flat_sheet,
    grazing_scale,
    mirrored,
    passed,
    sheet_light,
)
from gonio.models.warps.direction_cosines import projected_distance2
from gonio.models.warps.grazing_azimuth import polar_parts
from gonio.models.warps.hemisphere import beside

ALPHA = ParameterInfo(1e-3, 0.5, "1", "slope width of the front", start=0.1, role="width", log=True)
ALPHA_BEHIND = ParameterInfo(
    1e-3, 0.5, "1", "slope width of the back (alpha where it is left out)", start=0.1, role="width", log=True
)
ETA = ParameterInfo(1.01, 4.0, "1", "refractive index of the sheet", start=1.5, role="index", log=True)
CLEAR = ParameterInfo(
    0.0, 1.0, "1", "transmittance of the inside along the normal", start=1.0, role="albedo", per_channel=True
)
NOT_CLEAR = 0.98
GAIN = (
    "a clear sheet gains up to 0.2 % (of random ones, α 0.01 to 0.5, half gain less than 0.04 %): series of few terms "
    "say what its lobes leave of the light"
)
BREADTH = 0.4
"""Of the broad terms: the azimuth law's h over (η² − 1)(α² + α_behind²). Views of random sheets of rays chose it among
0.15, 0.4, 1 and 2; R and T do not depend on it."""
DRAWN = Cosines(False, 3.0, 2)
"""The variable by which broad terms are drawn."""
TAIL = 8.0
"""Half exponent of the tail that directions are drawn with: nearly Gaussian, a little heavier."""


class InnerLobe(AbstractDiscLobe):
    """w g(μi) g(μo) exp(−|β−β₀|²/s²)/(π s²), |β−β₀| as of a reflection.

    w is the share that a flat sheet reflects from its far side, all internal bounces summed, in the mean
    (½(wᵢ⁻² + wₒ⁻²))^(−½) of both directions, or what the likeliest path through the two faces transmits (`passed`);
    s the width, in direction cosines β, that the slopes at both passages, and at the far side, make; g, of either
    direction, leave no more light than rays leave.
    """

    near: Channels
    far: Channels
    eta: Channels
    clear: Channels
    entering: Direct
    leaving: Direct
    scale: Channels
    through: bool = eqx.field(static=True)

    lobe = True

    def share_and_width2(self, wi: Direction, wo: Direction) -> tuple[Channels, Channels]:
        """(w, s²) of two directions above the sheet."""
        i, o = (flat_sheet(positive(w.z), self.eta, self.clear) for w in (wi, wo))
        if self.through:
            return passed(i, o, self.near**2, self.far**2, (self.eta, self.clear))
        return mirrored(i, o, self.near**2, self.far**2)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        share, s2 = self.share_and_width2(wi, wo)
        factors = (
            self.entering.shares(basis_of(wi.z, self.scale))[0] * self.leaving.shares(basis_of(wo.z, self.scale))[0]
        )
        return factors * share * jnp.exp(-projected_distance2(wi, wo) / s2) / (jnp.pi * s2)

    def core(self, wi: Direction) -> tuple[Channels, Scalar]:
        return jnp.sqrt(TAIL * self.share_and_width2(wi, wi)[1]), jnp.asarray(TAIL, wi.z.dtype)


class SlabFace(AbstractEitherSide):
    """What the side towards the light reflects at once: microfacets with Gaussian slopes."""

    alpha: Channels
    alpha_behind: Channels
    eta: Channels

    lobe = True

    @property
    def through(self) -> bool:
        return False

    def facing(self, wi: Direction) -> AbstractBRDF:
        return Beckmann(alpha=jnp.where(wi.z > 0, self.alpha, self.alpha_behind), eta=self.eta)


class BroadLobe(AbstractBRDF):
    """r(μi) r(μo) √(h(h + 2p))/(π(p + h − p cosΔ)), r what the lobes leave of a direction, p = βi βo, β = sinθ.

    Over the azimuth Δ from the mirror direction its mean is r(μi) r(μo)/π: a wrapped Cauchy law, h wide.
    """

    entering: Direct
    leaving: Direct
    scale: Channels
    breadth: Channels

    lobe = True

    def azimuth(self, wi: Direction, wo: Direction, h: Scalar) -> Scalar:
        """The law of the azimuth, of mean 1."""
        p = jnp.sqrt(jnp.maximum((wi.x**2 + wi.y**2) * (wo.x**2 + wo.y**2), 1e-30))
        along, across = wi.x * wo.x + wi.y * wo.y, wi.x * wo.y - wi.y * wo.x
        # p + along, near the mirror direction without the difference of equal numbers
        off = jnp.where(along < 0, across**2 / (p + jnp.abs(along)), p + along)
        return jnp.sqrt(h * (h + 2.0 * p)) / (off + h)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        rest = self.entering.shares(basis_of(wi.z, self.scale))[1] * self.leaving.shares(basis_of(wo.z, self.scale))[1]
        return rest * self.azimuth(wi, wo, self.breadth) / jnp.pi

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        mu, _ = DRAWN.forward(u2, jnp.ones_like(u2))
        mu = jnp.clip(mu, 0.0, 1.0)
        sine = jnp.sqrt((1.0 - mu) * (1.0 + mu))
        h = jnp.mean(self.breadth)
        p = sine * polar_parts(wi)[0]
        narrow = jnp.sqrt(h / (h + 2.0 * p))  # (1 − ρ)/(1 + ρ)
        turn = jnp.arctan2(narrow * jnp.sin(jnp.pi * (u1 - 0.5)), jnp.cos(jnp.pi * (u1 - 0.5))) / jnp.pi
        return beside(wi, turn + 0.5, sine, mu), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        mu = positive(wo.z)
        s = DRAWN.inverse(mu, jnp.ones_like(mu))
        rate = DRAWN.forward(s, jnp.ones_like(s))[1]
        density = self.azimuth(wi, wo, jnp.mean(self.breadth)) / (2.0 * jnp.pi * rate)
        return jnp.where(wo.z > 0, density, 0.0)


class SlabInside(AbstractEitherSide):
    """What was inside, transmitted or reflected from the far side: a lobe, or the broad rest that lobes leave."""

    faces: Faces
    scale: Channels
    breadth: Channels
    light: Balance
    passes: bool = eqx.field(static=True)
    broad: bool = eqx.field(static=True)

    lobe = True

    @property
    def totally_reflects(self) -> bool:
        """As where light is reflected totally, two orders may agree by accident: its factors, limited by the light
        there is, have kinks across the panels."""
        return True

    @property
    def through(self) -> bool:
        return self.passes

    def facing(self, wi: Direction) -> AbstractBRDF:
        front = wi.z > 0
        entering, leaving = self.light.on(front, self.passes)
        if self.broad:
            return BroadLobe(entering, leaving, self.scale, self.breadth)
        alpha, behind, eta, clear = self.faces
        near, far = (jnp.where(front, *pair) for pair in ((alpha, behind), (behind, alpha)))
        return InnerLobe(near, far, eta, clear, entering, leaving, self.scale, self.passes)


class RoughSlab(AbstractComposite):
    """A sheet of index η with rough sides: microfacets in front, a lobe from the far side, and one straight through.

    Slopes are Gaussian, `alpha` wide in front and `alpha_behind` at the back. Each facet bends what passes by η cosθ′ −
    cosθ times its slope, and the far side by 2η cosθ′: the widths add in squares [as in Dai et al. 2009]. What leaves
    on either side in all is that of rays between two such faces (`rough_faces`): what a lobe loses beyond the horizon,
    or what is reflected totally inside, comes out elsewhere, by two broad reciprocal terms in the manner of [Kulla &
    Conty 2017]. `clear` is the transmittance of the inside along the normal.
    Left out: what masked light does next (rays of α = 0.3, η = 1.6 lose a fifth at 57°), what a thick sheet displaces
    sideways, and polarisation between the faces (a flat sheet of η = 1.5 passes 0.848 at 60°, this one 0.836).

    Beside rays followed through random sheets (both α from 0.02 to 0.4, η 1.2 to 2, `clear` 0.5 to 1, θ to 80°) R and T
    have errors of 0.003 rms, most beyond 45°, and R of nearly clear ones (`clear` above 0.95) of 0.014 rms beyond 60°,
    0.045 at most. Where f is above a tenth of its peak, half of what is transmitted within
    65° of the normal is within 2.5 %, beyond within 5 %; nine views in ten within 8 % to 30°, 20 % to 65°, 28 % beyond;
    single ones are off by a factor of 2. Of what is reflected, half is within 1 %, 2 % and 3 %, nine in ten within 4 %,
    13 % and 19 % (to 30°, to 65°, beyond).
    """

    loses_energy: ClassVar[str] = (
        "What facets mask, or send to the wrong side, is lost: a fifth at 57° for α = 0.35, η = 1.6, as of rays that "
        "meet such faces once at each passage."
    )

    prepared = True

    alpha: Channels = parameter(ALPHA)
    alpha_behind: Channels | None = parameter(ALPHA_BEHIND, default=None)
    eta: Channels = parameter(ETA, default=1.5)
    clear: Channels = parameter(CLEAR, default=1.0)

    @property
    def hemispheres(self) -> Hemispheres:
        return EVERYWHERE

    @property
    def violates(self) -> Mapping[str, str]:
        known = not isinstance(self.clear, Tracer) and float(np.max(np.asarray(self.clear))) <= NOT_CLEAR
        return {} if known else {"energy": GAIN}

    def terms(self) -> tuple[AbstractBRDF, ...]:
        behind = self.alpha if self.alpha_behind is None else self.alpha_behind
        faces = Faces(self.alpha, behind, self.eta, self.clear)
        light = sheet_light(faces)
        scale = jax.lax.stop_gradient(grazing_scale(self.alpha, behind, self.eta))  # in the series' slopes
        breadth = BREADTH * (self.eta - 1.0) * (self.eta + 1.0) * (self.alpha**2 + behind**2)
        inside = (
            SlabInside(faces, scale, breadth, light, passes, broad)
            for broad in (False, True)
            for passes in (False, True)
        )
        return SlabFace(self.alpha, behind, self.eta), *inside

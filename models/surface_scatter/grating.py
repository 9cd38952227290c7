"""A surface with parallel grooves: orders of diffraction by wavelength, as on a compact disc."""

import math
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Sample, Scalar, parameter
from gonio.models.errors import GonioError
from gonio.models.fresnel import fresnel_of
from gonio.models.geometry.half_vector import half_angles
from gonio.models.geometry.horizon import HORIZON
from gonio.models.microfacet.base import ETA, K
from gonio.models.surface_scatter.bessel import bessel_j
from gonio.models.surface_scatter.perturbation import polarisation_factor
from gonio.models.warps.direction_cosines import disc_direction, disc_jacobian, disc_ray

SINUSOIDAL, LAMELLAR = "sinusoidal", "lamellar"
FRESNEL, PERTURBATION = "fresnel", "perturbation"
WAVELENGTH = ParameterInfo(0.2, 20.0, "µm", "wavelength of the light", start=0.55, role="wavelength", log=True)
PERIOD = ParameterInfo(0.2, 20.0, "µm", "distance of the grooves", start=1.6, role="length", log=True)
DEPTH = ParameterInfo(1e-4, 2.0, "µm", "depth of the grooves, from top to bottom", start=0.1, role="length")
DUTY = ParameterInfo(
    0.0, 1.0, "1", "width of a groove over the period", start=0.5, role="weight", only=("profile", LAMELLAR)
)
AZIMUTH = ParameterInfo(
    -180.0, 180.0, "deg", "azimuth across the grooves, which run at right angles to it", start=0.0, role="angle"
)
WIDTH = ParameterInfo(
    1e-4, 0.1, "1", "standard deviation of an order's lobe, in direction cosines", start=0.01, role="shoulder", log=True
)

CLOSEST = 0.25
"""A lobe's width is at most this share of the orders' distance: further neighbours than two are below rounding."""
NEIGHBOURS = np.arange(-2.0, 3.0)
MARGIN = 3.0
"""Widths beyond the rim up to which an order is drawn: its lobe reaches into the hemisphere."""
REACH = 7.0
"""Widths beyond which a lobe is below rounding."""
MOST_ORDERS = 24
"""Orders of the integral where the wavelengths are not known, as JAX traces them."""
NEAR_RIM = 1e-14
"""Least squared cosine of the middle of a lobe that is integrated."""
FEWEST_WAVELENGTHS, MOST_SLOPE = 5.0, 0.3
"""Period, in wavelengths, and rms slope, beyond which the scalar efficiencies differ from those of vector theory."""


class Grating(AbstractBRDF):
    """f = Σ_m η_m N(β_i + β_o − m λ/d): orders of diffraction at sinθ_m = sinθ_i + mλ/d, also out of the plane.

    β are direction cosines, in which also conical orders stand in a row, along the `azimuth` across the grooves; N is
    Gaussian, of the standard deviation `width` (at most ¼ of the orders' distance): a lobe as an instrument sees it.
    Efficiencies are scalar: of the "sinusoidal" `profile`, J_m²(½k·depth (cosθi + cosθo)); of the "lamellar" one, whose
    grooves take the share D = `duty` of the period, 1 − 4D(1−D) sin²(½φ) and (2 sin(½φ) sin(πmD)/(πm))², with
    φ = k·depth (cosθi + cosθo). With `eta` (and `k`) times the `weight`: "fresnel", the reflectance at half the angle
    between the directions, or "perturbation", 4 cosθi cosθo |q|²/(cosθi + cosθo)², with which the first order of
    shallow grooves is Rayleigh-Rice's at any angle; the zeroth order of both has Fresnel's reflectance. Without `eta`
    the mean surface reflects all.
    Lengths and `wavelength` in µm. Made for grooves wide against λ, and shallow.
    """

    wavelength: Channels = parameter(WAVELENGTH)
    period: Channels = parameter(PERIOD)
    depth: Channels = parameter(DEPTH)
    duty: Channels | None = parameter(DUTY, default=None)
    azimuth: Channels = parameter(AZIMUTH, default=0.0)
    width: Channels = parameter(WIDTH, default=0.01)
    eta: Channels | None = parameter(ETA, default=None)
    k: Channels | None = parameter(K, default=None)
    profile: str = eqx.field(static=True, default=SINUSOIDAL, metadata={"choices": (SINUSOIDAL, LAMELLAR)})
    weight: str = eqx.field(static=True, default=FRESNEL, metadata={"choices": (FRESNEL, PERTURBATION)})

    def __check_init__(self) -> None:
        if self.weight == PERTURBATION and self.eta is None:
            raise GonioError('grating has the weight "perturbation" and no eta, the index of the material; give it')

    @property
    def violates(self) -> Mapping[str, str]:
        return {"energy": "Scalar efficiencies of orders of unequal angle do not add up to 1, towards grazing to more."}

    @property
    def isotropic(self) -> bool:
        return False

    @property
    def symmetric(self) -> bool:
        return not isinstance(self.azimuth, Tracer) and bool(np.all(np.asarray(self.azimuth) % 90 == 0))

    @property
    def validity_notes(self) -> tuple[str, ...]:
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self)):
            return ()
        fewest, steepest = float(jnp.min(self.period / self.wavelength)), float(jnp.max(self._rms_slope))
        notes = []
        if fewest < FEWEST_WAVELENGTHS:
            notes.append(f"grating has scalar efficiencies, for periods of many wavelengths; here it is {fewest:.3g}")
        if steepest > MOST_SLOPE:
            notes.append(f"grating has scalar efficiencies, for small slopes; here their rms is {steepest:.3g}")
        return tuple(notes)

    @property
    def _rms_slope(self) -> Scalar:
        # Of a sinusoid; steps have no slope, and count as a sinusoid of their depth.
        return jnp.pi * self.depth / self.period / math.sqrt(2.0)

    @property
    def spacing(self) -> Scalar:
        """λ/d: the distance of the orders in direction cosines."""
        return self.wavelength / self.period

    @property
    def lobe_width(self) -> Scalar:
        """The standard deviation of a lobe, `width` or less where the orders stand close."""
        return jnp.minimum(self.width, CLOSEST * self.spacing)

    def _across(self, x: Scalar, y: Scalar) -> tuple[Scalar, Scalar]:
        """Components (across the grooves, along them) of a vector of the plane."""
        angle = jnp.deg2rad(self.azimuth)
        return x * jnp.cos(angle) + y * jnp.sin(angle), y * jnp.cos(angle) - x * jnp.sin(angle)

    def efficiency(self, order: Scalar, wi: Direction, wo: Direction) -> Channels:
        """η of one order, for directions of the light and of the order; shapes broadcast."""
        cosines = wi.z + wo.z
        phase = 2 * jnp.pi * self.depth / self.wavelength * cosines
        if self.profile == SINUSOIDAL:
            share = bessel_j(jnp.abs(order), 0.5 * phase) ** 2
        else:
            half, duty = jnp.sin(0.5 * phase) ** 2, jnp.asarray(self.duty)
            whole = jnp.pi * jnp.where(order == 0, 1.0, order)
            zeroth = 1.0 - 4.0 * duty * (1.0 - duty) * half
            share = jnp.where(order == 0, zeroth, 4.0 * half * (jnp.sin(whole * duty) / whole) ** 2)
        if self.weight == FRESNEL:
            return share * fresnel_of(self, half_angles(wi, wo)[1])
        obliquity = 4.0 * wi.z * wo.z / (cosines * cosines)
        return share * obliquity * polarisation_factor(wi, wo, jnp.asarray(self.eta), self.k)

    def _lobe(self, distance2: Scalar) -> Scalar:
        variance = self.lobe_width**2
        return jnp.exp(-0.5 * distance2 / variance) / (2 * jnp.pi * variance)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        across, along = self._across(wi.x + wo.x, wi.y + wo.y)
        nearest = jnp.round(across / self.spacing)

        def one(neighbour: Scalar) -> Channels:
            order = jax.lax.stop_gradient(nearest) + neighbour
            away = across - order * self.spacing
            return self.efficiency(order, wi, wo) * self._lobe(away * away + along * along)

        return jnp.sum(jax.vmap(one)(jnp.asarray(NEIGHBOURS, wi.z.dtype)), axis=0)

    def _shown_orders(self, wi: Direction, margin: float) -> tuple[Scalar, Scalar]:
        """The lowest order within so many widths of the rim, and how many there are, of one channel."""
        across, along = self._across(wi.x, wi.y)
        half = jnp.sqrt(jnp.maximum(1.0 - along * along, 0.0)) + margin * self.lobe_width
        low = jnp.ceil((across - half) / self.spacing)
        return low, jnp.floor((across + half) / self.spacing) - low + 1.0

    def _each_channel(self) -> tuple["Grating", int]:
        # Every parameter with an axis of channels, and their number.
        count = max((leaf.shape[0] for leaf in jax.tree.leaves(self) if jnp.ndim(leaf)), default=1)
        return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (count,)), self), count

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        """A channel and an order that the rim shows, of equal chances, then a point of its Gaussian.

        Points beyond the rim are mirrored at it, r to 1/r, and become directions below the horizon.
        """
        every, count = self._each_channel()
        which = jnp.minimum(jnp.floor(u1 * count), count - 1)
        u1 = u1 * count - which
        one = jax.tree.map(lambda leaf: leaf[which.astype(int)], every)
        low, shown = one._shown_orders(wi, MARGIN)
        step = jnp.minimum(jnp.floor(u1 * shown), shown - 1.0)
        psi = 2 * jnp.pi * (u1 * shown - step)
        radius2 = -2.0 * jnp.log1p(-u2)
        some = radius2 > 0
        radius = one.lobe_width * jnp.where(some, jnp.sqrt(jnp.where(some, radius2, 1.0)), 0.0)
        angle = jnp.deg2rad(one.azimuth)
        x = (low + step) * one.spacing * jnp.cos(angle) - wi.x + radius * jnp.cos(psi)
        y = (low + step) * one.spacing * jnp.sin(angle) - wi.y + radius * jnp.sin(psi)
        r2 = x * x + y * y
        beyond = r2 > 1.0
        shrunk = jnp.where(beyond, 1.0 / jnp.where(beyond, r2, 1.0), 1.0)
        z2 = jnp.where(beyond, 1.0 - shrunk, 1.0 - r2)
        up = z2 > 0
        z = jnp.where(up, jnp.sqrt(jnp.where(up, z2, 1.0)), 0.0)
        return Direction(x * shrunk, y * shrunk, jnp.where(beyond, -z, z)), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        every, _ = self._each_channel()
        r2 = wo.x * wo.x + wo.y * wo.y
        below = wo.z < 0
        grown = jnp.where(below, 1.0 / jnp.maximum(r2, 1e-12), 1.0)

        def one(channel: Grating) -> Scalar:
            low, shown = channel._shown_orders(wi, MARGIN)
            across, along = channel._across(wi.x + grown * wo.x, wi.y + grown * wo.y)
            orders = jnp.round(across / channel.spacing) + jnp.asarray(NEIGHBOURS, r2.dtype)
            lobes = channel._lobe((across - orders * channel.spacing) ** 2 + along * along)
            return jnp.sum(jnp.where((orders >= low) & (orders < low + shown), lobes, 0.0)) / shown

        # On the disc a direction has the area cosθ dω, and what was mirrored at the rim 1/r⁴ times that.
        return jnp.mean(jax.vmap(one)(every)) * jnp.abs(wo.z) * grown**2

    def terms(self) -> tuple[AbstractBRDF, ...]:
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self)):
            return (GratingOrders(self, MOST_ORDERS),)
        shown = float(jnp.max(2.0 * (1.0 + REACH * self.lobe_width) / self.spacing)) + 1.0
        return (GratingOrders(self, math.ceil(shown)),)


class GratingOrders(AbstractBRDF):
    """A grating that integrates its orders, and its channels, each about its own direction."""

    grating: Grating
    most: int = eqx.field(static=True)
    """Orders that one incidence shows, at most."""

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return self.grating.formula(wi, wo)

    @property
    def costly(self) -> bool:
        return True

    @property
    def isotropic(self) -> bool:
        return False

    @property
    def symmetric(self) -> bool:
        return self.grating.symmetric

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        return self.grating.sample(wi, u1, u2)

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return self.grating.pdf(wi, wo)

    def flux(self, wi: Direction, u1: Scalar, u2: Scalar, side: Scalar) -> Channels:
        """Σ over orders, by channels: each at the point (u1, u2) of polar coordinates about its own middle."""
        every, _ = self.grating._each_channel()
        channels = jax.vmap(lambda channel: self._channel_flux(channel, wi, u1, u2))(every)
        single = all(jnp.ndim(leaf) == 0 for leaf in jax.tree.leaves(self.grating))
        return (channels[0] if single else channels) * jnp.where(side > 0, 1.0, 0.0)

    def _channel_flux(self, channel: Grating, wi: Direction, u1: Scalar, u2: Scalar) -> Scalar:
        low, shown = channel._shown_orders(wi, REACH)
        angle = jnp.deg2rad(channel.azimuth)

        def one(step: Scalar) -> Scalar:
            order = low + step
            x = order * channel.spacing * jnp.cos(angle) - wi.x
            y = order * channel.spacing * jnp.sin(angle) - wi.y
            wo, jacobian, distance2 = _about(x, y, channel.lobe_width, u1, u2)
            safe = Direction(wo.x, wo.y, jnp.maximum(wo.z, HORIZON))
            value = channel.efficiency(order, wi, safe) * channel._lobe(distance2) * wo.z * jacobian
            return jnp.where(step < shown, value, 0.0)

        return jnp.sum(jax.vmap(one)(jnp.asarray(np.arange(float(self.most)), wi.z.dtype)))


def _about(x: Scalar, y: Scalar, width: Scalar, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar, Scalar]:
    """(direction, dω/(du1 du2), squared distance from (x, y)) about a point of the disc, or of the rim beside it."""
    r = jnp.sqrt(jnp.maximum(x * x + y * y, 1e-30))
    inwards = jnp.minimum(1.0, 1.0 / r)
    # On the rim itself rays would have no length
    light = Direction(-x * inwards, -y * inwards, jnp.sqrt(jnp.maximum(1.0 - (r * inwards) ** 2, NEAR_RIM)))
    ray = disc_ray(light, u1)
    end = REACH * width + r * (1.0 - inwards)
    # Equal steps through a whole lobe; at the rim cosθo has the root of the distance, whose steps are squares.
    cut = ray.rim < end
    radius = jnp.where(cut, ray.rim * u2 * (2.0 - u2), end * u2)
    rate = jnp.where(cut, ray.rim * 2.0 * (1.0 - u2), end)
    wo = disc_direction(light, ray, radius)
    away_x, away_y = wo.x - x, wo.y - y
    jacobian = disc_jacobian(wo, radius, rate, ray)
    return wo, jacobian, away_x * away_x + away_y * away_y

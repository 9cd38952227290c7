"""Light below the surface, checked: reciprocity, ∫∫R dA ≤ 1 and positivity, of a model and of a profile."""

from collections.abc import Mapping

import equinox as eqx
import jax
import numpy as np

from gonio.checks.certificate import FAIL, NOT_TESTABLE, Certificate, Property, verdict_of, without_residual
from gonio.checks.profile_light import by_distance, light_of_profile
from gonio.checks.properties import PROPERTIES
from gonio.data.channels import Channels
from gonio.data.profile import Profile
from gonio.models.display import percent
from gonio.models.geometry.directions import from_spherical
from gonio.models.special.scipy_functions import ndtri
from gonio.models.subsurface.base import AbstractBSSRDF, Position
from gonio.models.subsurface.evaluation import evaluated, totals

PAIRS = 64
SPAN = 1e-4, 1e3
"""Of the integral, in mean free paths; the closed form takes over beyond."""
ROUNDING = 1e-12


def check_bssrdf(bssrdf: AbstractBSSRDF, channels: Channels, name: str, given: Mapping[str, float]) -> Certificate:
    """The certificate of a model of light below the surface; `given` are tolerances by the property's name."""
    tolerance = {n: given.get(n, PROPERTIES[n].model_tolerance) for n in ("reciprocity", "energy", "positivity")}
    properties = [
        _model_reciprocity(bssrdf, tolerance["reciprocity"]),
        *_model_light(bssrdf, channels, tolerance["energy"], tolerance["positivity"]),
    ]
    return Certificate(name, "model of light below a surface", properties)


def _model_reciprocity(bssrdf: AbstractBSSRDF, tolerance: float) -> Property:
    rng = np.random.default_rng(0)
    size = 1 / float(np.max(np.asarray(bssrdf.extinction)))
    places = [Position(*(size * rng.standard_normal((2, PAIRS)))) for _ in range(2)]
    ways = [from_spherical(np.arccos(rng.random(PAIRS)), 2 * np.pi * rng.random(PAIRS), np) for _ in range(2)]
    s = eqx.filter_jit(lambda a, b, c, d: jax.vmap(bssrdf.s)(a, b, c, d))
    there, back = (np.asarray(s(*pair)) for pair in ((places[0], ways[0], places[1], ways[1]),
                                                     (places[1], ways[1], places[0], ways[0])))  # fmt: skip
    residual = float(np.max(np.abs(there - back) / np.maximum(np.abs(there) + np.abs(back), 1e-300) * 2))
    detail = (
        f"S(xi, wi; xo, wo) and S(xo, wo; xi, wi) differ by at most {percent(residual)} over {PAIRS} random pairs of "
        "places and directions."
    )
    return Property(
        "reciprocity", verdict_of(residual, ROUNDING, tolerance), residual, ROUNDING, tolerance, detail=detail
    )


def _model_light(bssrdf: AbstractBSSRDF, channels: Channels, energy: float, positivity: float) -> list[Property]:
    """Energy and positivity, by an integral of R beside the closed form of its total."""
    size = 1 / np.asarray(bssrdf.extinction, float)
    cuts = np.concatenate([[0.0], np.geomspace(SPAN[0] * size.min(), SPAN[1] * size.max(), 96)])
    x, w = np.polynomial.legendre.leggauss(16)
    half = np.diff(cuts)[:, None] / 2
    r = (cuts[:-1, None] + half * (1 + x)).ravel()
    profile = evaluated(bssrdf, "profile", r)
    integral = np.sum(profile * ((half * w).ravel() * 2 * np.pi * r)[:, None], axis=0)
    bound = np.abs(integral - evaluated(bssrdf, "cumulative", cuts[-1:])[0]) + ROUNDING
    total = totals(bssrdf)
    worst = int(np.argmax(total + bound))
    where = {"channel": channels.names[worst]} if len(channels) > 1 else {}
    residual, off = float(total[worst] - 1), float(bound[worst])
    detail = (
        f"∫∫R dA is {total[worst]:.6f} (±{off:.1g}): of the light that passed the surface no more leaves. An integral "
        "of R and the closed form agree to the bound."
    )
    negative = float(np.max(-profile / np.maximum(np.max(profile, axis=0), 1e-300)))
    least = f"R is {'nowhere negative' if negative <= 0 else f'negative by {percent(negative)} of its largest value'}."
    return [
        Property("energy", verdict_of(residual, off, energy), residual, off, energy, where, detail),
        Property(
            "positivity", verdict_of(max(negative, 0.0), 0.0, positivity), max(negative, 0.0), 0.0, positivity,
            detail=f"{least} Looked at from {r[0]:.2g} to {r[-1]:.2g} mm.",
        ),
    ]  # fmt: skip


def check_profile(profile: Profile, name: str, given: Mapping[str, float], level: float) -> Certificate:
    """The certificate of a profile; `given` are tolerances, `level` the chance of calling noise a violation."""
    tolerance = {n: given.get(n, PROPERTIES[n].table_tolerance) for n in ("reciprocity", "energy", "positivity")}
    properties = [
        _exchanged_spots(profile, tolerance["reciprocity"], level),
        _profile_energy(profile, tolerance["energy"], level),
        _profile_positivity(profile, tolerance["positivity"], level),
    ]
    return Certificate(name, "profile", properties, notes=list(profile.provenance.get("warnings", [])))


def _exchanged_spots(profile: Profile, tolerance: float, level: float) -> Property:
    """Readings at r and −r: the lit and the viewed place exchanged."""
    pairs = [(i, j) for i in np.flatnonzero(profile.offsets > 0)
             for j in np.flatnonzero(np.isclose(profile.offsets, -profile.offsets[i], rtol=1e-9))]  # fmt: skip
    if not pairs:
        why = "Not testable: the viewed spot was read on one side of the lit one only; read at offsets of both signs."
        return without_residual("reciprocity", NOT_TESTABLE, tolerance, why)
    i, j = np.array(pairs).T
    use = profile.valid[i] & profile.valid[j]
    signed = np.where(use, profile.value[i] - profile.value[j], 0.0)
    difference = np.abs(signed)
    mean = np.where(use, np.abs(profile.value[i] + profile.value[j]) / 2, 0.0)
    u = np.where(use, np.hypot(np.nan_to_num(profile.u[i]), np.nan_to_num(profile.u[j])), 0.0)
    ring = profile.offsets[i][:, None] ** 2  # the light at a distance, of offsets that grow by a factor
    limit = float(-ndtri(level / max(int(use.sum()), 1) / 2))
    ring = np.where(mean > limit * u, ring, 0.0)  # what noise drowns tells nothing of the light
    light = np.maximum(np.sum(ring * mean, axis=0), 1e-300)
    shares = np.abs(np.sum(ring * signed, axis=0)) / light
    noise = limit * np.sqrt(np.sum((ring * u) ** 2, axis=0)) / light
    known = u > 0
    z = np.where(known, difference / np.where(known, u, 1.0), 0.0)
    worst = int(np.argmax(shares))
    residual, bound = float(shares[worst]), float(noise[worst])
    verdict = verdict_of(residual, bound, tolerance)
    sure = difference - limit * u > tolerance * mean
    if sure.any():
        verdict = FAIL
    place = np.unravel_index(int(np.argmax(z)), z.shape)
    detail = (
        f"R(r) and R(−r), lit and viewed place exchanged, over {len(pairs)} pairs: by {percent(residual)} of the light "
        f"(±{percent(bound)})"
    )
    if known.any():
        detail += f"; most surely at {profile.offsets[i][place[0]]:g} mm, by {z[place]:.2g} of its uncertainty"
        detail += f" ({'more' if z[place] > limit else 'no more'} than noise at a level of {percent(level)})"
    where = {"channel": profile.channels.names[worst]} if len(profile.channels) > 1 else {}
    return Property("reciprocity", verdict, residual, bound, tolerance, where, f"{detail}.")


def _profile_energy(profile: Profile, tolerance: float, level: float) -> Property:
    side = by_distance(profile)
    factor = float(-ndtri(level / 2 / len(profile.channels)))
    channels = [light_of_profile(side, c, factor) for c in range(len(profile.channels))]
    if any(light is None for light in channels):
        why = "Not testable: of a channel there are fewer than three distances with positive readings."
        return without_residual("energy", NOT_TESTABLE, tolerance, why)
    known = [light for light in channels if light is not None]
    worst = int(np.argmax([light.total + light.bound for light in known]))
    light = known[worst]
    where = {"channel": profile.channels.names[worst]} if len(known) > 1 else {}
    size = f"{light.total:.4g} (±{light.bound:.2g})" if np.isfinite(light.bound) else f"{light.total:.4g} or more"
    detail = f"∫∫R dA is {size} of the light, as if it left with the same radiance in all directions. {light.unread}"
    return Property(
        "energy", verdict_of(light.total - 1, light.bound, tolerance), light.total - 1, light.bound, tolerance, where,
        detail,
    )  # fmt: skip


def _profile_positivity(profile: Profile, tolerance: float, level: float) -> Property:
    valid = profile.valid
    value, u = np.where(valid, profile.value, 0.0), np.where(valid, np.nan_to_num(profile.u), 0.0)
    limit = float(-ndtri(level / max(int(valid.sum()), 1)))
    largest = np.maximum(np.max(value, axis=0), 1e-300)
    residual = float(np.max(np.maximum(-value - limit * u, 0.0) / largest))
    count = int(np.count_nonzero(value < 0))
    noise = ", no more than by noise" if count and not residual else ""
    detail = f"{count} of {int(valid.sum())} readings are negative{noise}."
    return Property("positivity", verdict_of(residual, 0.0, tolerance), residual, 0.0, tolerance, detail=detail)

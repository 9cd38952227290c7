"""The scan of offsets: a viewed spot beside an illuminated one on a translucent material, read at the normal.

The reading is that of `gonio.instrument.noise`, f = dL/dE with E the flux over the lit area πa²: so R = f/a² there.
"""

from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np

from gonio.data.flags import Flag
from gonio.data.material import Material
from gonio.data.profile import MOST_OFFSETS, Profile, check_lengths
from gonio.data.profile_files import write_profile
from gonio.data.subject import SubjectLike, load_material
from gonio.instrument import noise
from gonio.instrument.instrument import Instrument, Systematic
from gonio.instrument.sinks import MeasureOptions, MeasureSettings, facts_of
from gonio.models.deprecation import settings_of
from gonio.models.errors import GonioError
from gonio.models.subsurface.base import AbstractBSSRDF
from gonio.models.subsurface.evaluation import evaluated
from gonio.models.subsurface.spots import NODES, spot_rule
from gonio.models.subsurface.wide_spots import WideSpots

SIDE = 12
"""Offsets on each side of the usual scan, beside 0."""
NEAREST, FARTHEST, DECADES = 0.3, 8.0, 300.0
"""Of the usual scan: in mean free paths, in diffusion lengths, and the largest over the smallest offset."""


def spot_means(bssrdf: AbstractBSSRDF, offsets: np.ndarray, a: float, b: float) -> tuple[np.ndarray, np.ndarray]:
    """Means of π L/Φ over the viewed spot, at the normal (n, channels), 1/mm²; and bounds on their quadrature's error.

    Args:
        bssrdf: the material.
        offsets: distances (n,) of the spots' centres, mm.
        a, b: radii of the illuminated and the viewed spot, mm.
    """
    values = []
    for nodes in (NODES // 2, NODES):
        rule = spot_rule(offsets, a, b, nodes)
        values.append(np.einsum("nk,nkc->nc", rule.weight, evaluated(bssrdf, "profile", rule.r)))
    passed = np.asarray(bssrdf.transmittance(np.ones(()))) ** 2
    return values[1] * passed, np.abs(values[1] - values[0]) * passed


def usual_offsets(bssrdf: AbstractBSSRDF) -> np.ndarray:
    """Offsets (2·SIDE + 1,), mm, on both sides from within a mean free path to where little light is left."""
    extinction, absorption = (np.atleast_1d(np.asarray(v, float)) for v in (bssrdf.extinction, bssrdf.absorption))
    near = NEAREST / extinction.max()
    length = 1 / np.sqrt(3 * np.maximum(absorption * extinction, 1e-300))
    far = min(FARTHEST * float(length.max()), DECADES * near)
    side = [float(f"{r:.2g}") for r in np.geomspace(near, max(far, 3 * near), SIDE)]
    return np.array([*(-r for r in side[::-1]), 0.0, *side])


def measure_profile(
    material: SubjectLike,
    instrument: Instrument | None = None,
    offsets: Sequence[float] | np.ndarray | None = None,
    **options: Unpack[MeasureOptions],
) -> Profile:
    """Readings of a viewed spot at some offsets from an illuminated one, both seen along the normal.

    Noise, gain and saturation are those of the instrument, whose `photons` are the counts of a white diffuser that
    fills the lit spot.

    Args:
        material: a subject whose light below the surface is known, such as "marble" or "dipole(sigma_a=0.01, ...)".
        instrument: with the radii of both spots; by default an ideal one of points.
        offsets: mm, of either sign; by default on both sides, by the scales of the material.
        options: `output`, `seed`, `force`, `log` and `command` of `gonio.measure`.

    Raises:
        GonioError: a material of which only a BRDF is known, offsets or radii out of range, an offset of 0 between
            points, photons without a lit area, an output that exists.
    """
    settings = settings_of(MeasureSettings, "measure_profile", options)
    subject, device = load_material(material), instrument or Instrument()
    bssrdf = bssrdf_of(subject)
    places = usual_offsets(bssrdf) if offsets is None else np.asarray(offsets, float).ravel()
    a, b = (radius or 0.0 for radius in (device.illuminated_radius, device.viewed_radius))
    if offsets is None and not max(a, b):
        places = places[places != 0]  # where a profile may have its pole
    _require_readable(places, a, b, device)
    mean, bound = spot_means(bssrdf, places, a, b)
    errors, seed = device.systematic_errors(int(settings.seed)), int(settings.seed)
    value, u, flag = _read(device, errors, seed, errors.gain * mean, a)
    provenance: dict[str, Any] = facts_of(subject, settings.command) | {
        "instrument": device.to_dict() or "ideal",
        "scan": {"layout": "offsets", "shape": [int(places.size)]},
        "seed": seed,
        "quadrature_error": float(np.max(bound / np.maximum(np.abs(mean), 1e-300))),
    }
    if errors != Systematic():
        provenance["systematic"] = errors.to_dict()
    profile = Profile(places, value, u, flag, subject.channels, a, b, provenance, subject.name)
    if settings.output is not None:
        write_profile(settings.output, profile, settings.force)
    return profile


def bssrdf_of(material: Material) -> AbstractBSSRDF:
    """The model of a material's light below the surface. Raises GonioError, with the remedy, where there is none."""
    if isinstance(material.brdf, WideSpots):
        if not np.max(np.asarray(material.brdf.bssrdf.scattering)) > 0:
            raise GonioError(f"{material.name} does not scatter, and sends no light back; give it a sigma_s above 0")
        return material.brdf.bssrdf
    raise GonioError(
        f"{material.name} is a BRDF: nothing says how far light travels below its surface; give a translucent "
        "material, such as marble or 'dipole(sigma_a=0.01, sigma_s=1, eta=1.3)'"
    )


def _require_readable(offsets: np.ndarray, a: float, b: float, device: Instrument) -> None:
    check_lengths(offsets, a, b)
    if not max(a, b) and (offsets == 0).any():
        raise GonioError("an offset of 0 mm between points has no reading; leave it out, or give the spots radii")
    if not a and device.photons is not None:
        raise GonioError("photons are those of a lit spot: give its radius too (--illuminated-radius, mm)")


def _read(
    device: Instrument, errors: Systematic, seed: int, expected: np.ndarray, a: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(values, standard uncertainties, flags), (n, channels) each, by the instrument's signal chain."""
    area = a * a or 1.0
    f = expected * area + errors.offset / np.pi
    flag = np.full(f.shape, np.uint8(Flag.VALID))
    if not device.has_noise:
        return f / area, np.zeros_like(f), flag
    lit = np.ones(f.shape[0])
    readings, full = noise.read(device, seed, 0, f, lit, errors.gain)
    u = noise.standard_uncertainty(device, f, lit, errors.gain)
    flag[full] = Flag.SATURATED
    value, u = (np.where(full, np.nan, v / area) for v in (readings, u))
    return value, u, flag


def parsed_offsets(text: str) -> list[float]:
    """Offsets, mm, from words: "0,1,2.5", or "FROM:TO:COUNT", evenly. Raises GonioError for anything else."""
    try:
        if ":" in text:
            low, high, count = text.split(":")
            return np.linspace(float(low), float(high), min(int(count), MOST_OFFSETS + 1)).tolist()
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise GonioError(f"--offsets is {text!r}; give mm, such as 0,0.5,1,2 or -5:5:21 (from:to:number)") from None

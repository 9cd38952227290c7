"""Helmholtz reciprocity f(wi, wo) = f(wo, wi) of a model, at the worst place of the closed hemisphere."""

import jax.numpy as jnp
import numpy as np

from gonio.checks.certificate import UNDECIDED, Property, verdict_of
from gonio.checks.direction_search import climb, pair, pair_angles, precision, swapped, values
from gonio.models.brdf import AbstractBRDF

STARTS = 8
ROUNDING_STEPS = 8


def relative_difference(a: np.ndarray, b: np.ndarray, floor: float = 0.0) -> np.ndarray:
    """2|a − b| / (|a| + |b| + floor); 0 where both are 0."""
    scale = np.abs(a) + np.abs(b) + floor
    return np.where(scale > 0, 2 * np.abs(a - b) / np.where(scale > 0, scale, 1.0), 0.0)


def rounding_floor(peak: float) -> float:
    """Values below this many 1/sr do not count: the square of the rounding, times the largest value seen."""
    return precision() ** 2 * peak + float(np.finfo(np.dtype(jnp.result_type(float))).tiny)


def rounding_of(brdf: AbstractBRDF, angles: np.ndarray, partner, floor: float) -> np.ndarray:
    """Estimate of the rounding in the relative difference between f at `angles` and at its `partner`, shape (n,).

    Every component is moved by one unit in its last place, up or down at random, several times over. A difference
    that the model means stays the same; one that rounding makes changes. Four times its spread, and eight roundings.
    """
    rng = np.random.default_rng(1)
    eps = precision()
    wi, wo = pair(angles)
    signed = []
    for _ in range(ROUNDING_STEPS):
        up = [type(w)(*(c * (1 + eps * rng.integers(-1, 2, c.shape)) for c in w)) for w in (wi, wo)]
        a, b = values(brdf, *up), values(brdf, *partner(*up))
        signed.append(relative_difference(a, b, floor) * np.sign(a - b))
    return 4 * np.max(np.ptp(np.stack(signed), axis=0), axis=-1) + 8 * eps


def worst_difference(brdf: AbstractBRDF, partner, angles: np.ndarray, refine: bool = True) -> dict:
    """Where f and f at its `partner` pair differ most: searched from many pairs and, if asked, refined from the worst.

    Keys: residual, bound (its rounding), rounding (the largest at any start), angles (4,), channel, pairs (looked at),
    undefined (pairs without a finite value), undefined_at, floor.
    """
    first = values(brdf, *pair(angles))
    finite = np.isfinite(first).all(axis=-1)
    floor = rounding_floor(float(np.max(np.abs(first[finite]), initial=0.0)))
    looked = [len(angles)]

    def differences(at):
        looked.append(len(at))
        wi, wo = pair(at)
        with np.errstate(all="ignore"):
            return relative_difference(values(brdf, wi, wo), values(brdf, *partner(wi, wo)), floor)

    found = differences(angles)
    undefined = ~np.isfinite(found).all(axis=-1)
    over_channels = np.where(undefined, -1.0, np.max(np.nan_to_num(found), axis=-1))
    starts = angles[np.argsort(over_channels)[::-1][:STARTS]]
    best, refined = climb(lambda at: np.max(differences(at), axis=-1), starts, rounds=24 if refine else 0)
    place = int(np.nanargmax(refined)) if np.isfinite(refined).any() else 0
    at = best[place : place + 1]
    return {
        "residual": float(refined[place]),
        "bound": float(rounding_of(brdf, at, partner, floor)[0]),
        "angles": at[0],
        "channel": int(np.argmax(np.nan_to_num(differences(at)[0]))),
        "undefined": int(undefined.sum()),
        "undefined_at": angles[undefined][0] if undefined.any() else None,
        "pairs": sum(looked),
        "floor": floor,
        "rounding": float(np.max(rounding_of(brdf, starts, partner, floor))),
    }


def where_of(angles: np.ndarray, channel: int | None = None) -> dict:
    """Angles of a pair in degrees, by name, and the channel where there are several."""
    names = ("theta_i", "phi_i", "theta_o", "phi_o")
    degrees = np.degrees(angles) % np.array([361.0, 360.0, 361.0, 360.0])
    place = dict(zip(names, (float(d) for d in degrees), strict=True))
    return place if channel is None else {**place, "channel": channel}


def difference_property(name: str, brdf: AbstractBRDF, partner, tolerance: float, detail: str) -> Property:
    """A property of a model that says f is the same at two pairs; `detail` says of what, with {residual}, {bound}."""
    found = worst_difference(brdf, partner, pair_angles(brdf))
    residual, bound = found["residual"], max(found["bound"], found["rounding"])
    verdict = verdict_of(residual, bound, tolerance)
    several = values(brdf, *pair(found["angles"][None])).shape[-1] > 1
    sentence = detail.format(residual=residual, pairs=found["pairs"], floor=found["floor"])
    if found["undefined"]:
        place = where_of(found["undefined_at"])
        sentence += f" f is not finite at {found['undefined']} pairs, such as {spoken(place)}."
        verdict = UNDECIDED if verdict != "fail" else verdict
    return Property(
        name,
        verdict,
        residual,
        bound,
        tolerance,
        where_of(found["angles"], found["channel"] if several else None),
        sentence,
        {"pairs": found["pairs"], "floor_per_sr": found["floor"], "pairs_without_a_value": found["undefined"]},
    )


def spoken(place: dict) -> str:
    """A place in words: θi 40°, φi 0°, ..."""
    signs = {"theta_i": "θi", "phi_i": "φi", "theta_o": "θo", "phi_o": "φo"}
    said = [f"{signs[k]} {v:.4g}°" for k, v in place.items() if k in signs]
    return ", ".join(said) + (f", channel {place['channel']}" if "channel" in place else "")


def model_reciprocity(brdf: AbstractBRDF, tolerance: float) -> Property:
    """The largest relative difference between f(wi, wo) and f(wo, wi) that a search of the closed hemisphere finds."""
    return difference_property(
        "reciprocity",
        brdf,
        swapped,
        tolerance,
        "The largest 2|a−b|/(|a|+|b|) of f(wi, wo) and f(wo, wi) is {residual:.2g}, searched over {pairs:,} pairs of"
        " the closed hemisphere and refined from the worst; values below {floor:.1g} /sr do not count.",
    )

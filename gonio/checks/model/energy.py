"""Energy conservation of a model: the directional albedo at all incidences, with bounds, at most 1."""

import numpy as np

from gonio.checks.certificate import UNDECIDED, Property, verdict_of
from gonio.checks.direction_search import Rotated, pair_angles, precision
from gonio.checks.hemispherical_albedo import hemispherical
from gonio.checks.model.cubature import cubature_albedo
from gonio.checks.model.reciprocity import worst_difference
from gonio.models.albedo import directional_albedo
from gonio.models.brdf import AbstractBRDF, Sum
from gonio.models.catalog import is_ours

GRAZING = 89.9
"""The last incidence, degrees."""

ISOTROPIC = 1e-7
"""A model that changes by less than this share when both directions are turned together is isotropic."""

COARSE = 1e-5
"""Bound of an albedo above which adaptive cubature is tried as well, where the albedo may exceed 1."""

MOST_ADAPTED = 16


def incidences() -> np.ndarray:
    """Polar angles of incidence, radians: 0 to 89.9°, ever closer towards grazing."""
    coarse = np.linspace(0, 80, 17)
    fine = 90 - 10 * 10 ** np.linspace(0, -2, 16)[1:]
    return np.radians(np.concatenate([coarse, fine]))


def model_energy(brdf: AbstractBRDF, tolerance: float) -> Property:
    """How far the directional albedo exceeds 1 at the worst incidence; losses in the facts."""
    turning, own = _turning_residual(brdf), is_ours(brdf)
    isotropic = turning is None or turning <= ISOTROPIC
    theta = incidences()
    # Our anisotropic models are mirror symmetric along x and y: a quarter of the azimuths stands for all.
    azimuths = np.linspace(0, np.pi / 2, 4) if own else np.arange(8) * np.pi / 4
    azimuths = np.zeros(1) if isotropic else azimuths
    accuracy = max(tolerance / 4, 1e-9)
    t, p = (a.ravel() for a in np.meshgrid(theta, azimuths, indexing="ij"))
    value, bound = _albedo(brdf, t, p, accuracy)
    shape = (theta.size, azimuths.size, value.shape[-1])
    series = {
        "theta_i_deg": np.degrees(theta).tolist(),
        "phi_i_deg": np.degrees(azimuths).tolist(),
        "albedo": _by_channel(value.reshape(shape)),
        "bound": _by_channel(bound.reshape(shape)),
    }
    under_uniform = hemispherical(t, value, bound) if np.isfinite(value).all() else None
    t, p, value, bound = _refined(brdf, t, p, value, bound, accuracy, isotropic)
    found = energy_property(t, p, value, bound, tolerance, _method(brdf, own, isotropic), series)
    return with_hemispherical(found, under_uniform)


def with_hemispherical(found: Property, under_uniform: tuple[np.ndarray, np.ndarray] | None) -> Property:
    """The same property, saying the albedo under uniform light too, where its error has a bound."""
    if under_uniform is None:
        return found
    value, bound = under_uniform
    found.facts |= {"hemispherical_albedo": value.tolist(), "hemispherical_bound": bound.tolist()}
    if np.isfinite(bound).all():
        said = ", ".join(f"{v:.4g} (±{b:.1g})" for v, b in zip(value, bound, strict=True))
        found.detail += f" Under uniform light it reflects {said}."
    return found


def energy_property(theta, phi, value, bound, tolerance, about: str, series: dict, lower=None) -> Property:
    """The property of directional albedos (n, channels) at n incidences, with the bounds on their errors.

    `lower` is the bound on how much smaller an albedo may be, where that differs from `bound`, on how much larger.
    """
    lower = bound if lower is None else lower
    with np.errstate(invalid="ignore"):
        surely, perhaps = value - lower, value + bound
    failing = np.nan_to_num(surely, nan=-np.inf)
    wild = ~np.isfinite(value)
    if wild.any():
        at, side = np.unravel_index(np.argmax(wild), value.shape), np.inf
    elif failing.max() > 1 + tolerance:
        at = np.unravel_index(np.argmax(failing), value.shape)
        side = lower[at]
    else:
        most = perhaps == perhaps.max()
        at = np.unravel_index(np.argmax(np.where(most, value, -np.inf)), value.shape)
        side = bound[at]
    residual, side = float(value[at] - 1), float(side)
    verdict = UNDECIDED if wild.any() else verdict_of(residual, side, tolerance)
    where = {"theta_i": float(np.degrees(theta[at[0]])), "phi_i": float(np.degrees(phi[at[0]]) % 360)}
    if value.shape[1] > 1:
        where["channel"] = int(at[1])
    least = np.unravel_index(np.nanargmin(np.where(wild, np.inf, value)), value.shape)
    facts = {
        "incidences": len(theta),
        "largest_albedo": float(np.max(np.where(wild, -np.inf, value))),
        "least_albedo": float(value[least]),
        "largest_loss": float(1 - value[least]),
        "loss_at_theta_i_deg": float(np.degrees(theta[least[0]])),
    }
    said = {
        "pass": "The surface reflects no more than it receives",
        "fail": "The surface reflects more than it receives",
        "undecided": "The error of the albedo is too large for a verdict",
    }[verdict]
    size = f"±{side:.2g}" if np.isfinite(side) else "with an error that has no bound"
    detail = (
        f"{said}: albedo {value[at]:.6g} ({size}) at θi {where['theta_i']:.4g}°; it loses up to"
        f" {max(facts['largest_loss'], 0.0):.3g} (at θi {facts['loss_at_theta_i_deg']:.4g}°). {about}"
    )
    return Property("energy", verdict, residual, side, tolerance, where, detail, facts, series)


def _method(brdf, own, isotropic) -> str:
    rule = "by each lobe's own map" if own else "by adaptive cubature, as the model's own map is not known to be right"
    azimuths = "" if isotropic else f", at {4 if own else 8} azimuths"
    return f"Incidence 0 to {GRAZING}°{azimuths}, integrated {rule}."


def _by_channel(a: np.ndarray) -> list:
    # The worst azimuth of each incidence, as one list for each channel.
    return np.max(a, axis=1).T.tolist()


def _turning_residual(brdf) -> float | None:
    # None where the model is one of ours and says that it is isotropic.
    if is_ours(brdf):
        return None if brdf.isotropic else np.inf
    found = worst_difference(brdf, Rotated(0.7), pair_angles(brdf)[::3], refine=False)
    return max(found["residual"] - max(found["bound"], found["rounding"]), 0.0)


def _albedo(brdf, theta, phi, accuracy) -> tuple[np.ndarray, np.ndarray]:
    ours = [t for t in brdf.terms() if is_ours(t)]
    foreign = [t for t in brdf.terms() if not is_ours(t)]
    total, bound = np.zeros((theta.size, 1)), np.zeros((theta.size, 1))
    if ours:
        together = ours[0] if len(ours) == 1 else Sum(tuple(ours))
        part = directional_albedo(together, theta, phi, accuracy)
        value, error = (a.reshape(theta.size, -1).copy() for a in part[:2])
        # Where the lobe's own map does not resolve it (very unequal widths), cells that adapt may.
        open_ = np.flatnonzero(np.any((error > COARSE) & (value + error > 1), axis=-1))
        for k in open_[:MOST_ADAPTED]:
            v, e = cubature_albedo(together, theta[k], phi[k], accuracy)
            better = e < error[k]
            value[k], error[k] = np.where(better, v, value[k]), np.where(better, e, error[k])
        total, bound = total + value, bound + error
    limit = 1.0 if len(foreign) == 1 and not ours else None
    for term in foreign:
        parts = [cubature_albedo(term, a, b, accuracy, limit) for a, b in zip(theta, phi, strict=True)]
        total = total + np.stack([v for v, _ in parts])
        bound = bound + np.stack([b for _, b in parts])
    return total, bound + 64 * precision() * np.abs(total)


def _refined(brdf, theta, phi, value, bound, accuracy, isotropic):
    # Between the incidences looked at, on either side of the largest albedo, twice: the maximum lies in there.
    for _ in range(2):
        k = int(np.unravel_index(np.argmax(np.nan_to_num(value - bound, nan=-1.0)), value.shape)[0])
        others = np.unique(theta)
        place = int(np.searchsorted(others, theta[k]))
        low, high = others[max(place - 1, 0)], others[min(place + 1, others.size - 1)]
        new_t = np.linspace(low, high, 10)[1:-1]
        new_p = np.full(8, phi[k])
        if not isotropic:
            new_p = new_p + np.linspace(-0.3, 0.3, 8)[[3, 0, 6, 1, 5, 2, 7, 4]]
        v, b = _albedo(brdf, new_t, new_p, accuracy)
        theta, phi = np.concatenate([theta, new_t]), np.concatenate([phi, new_p])
        value, bound = np.concatenate([value, v]), np.concatenate([bound, b])
    return theta, phi, value, bound

"""From a profile to the coefficients of light below the surface, with what the readings leave open."""

import dataclasses
import os
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.special import chdtrc, stdtrit

from gonio.data.material import Material
from gonio.data.profile import Profile
from gonio.data.profile_files import open_profile
from gonio.fitting.common_errors import left_out
from gonio.fitting.problem.parameterisation import LOG, LOG1P, Domains
from gonio.fitting.residuals.noise_tests import noise_tests
from gonio.fitting.subsurface.free_index import fit_with_free_index
from gonio.fitting.subsurface.problem import NEAR_ZERO, NODES, STARTS, ProfileData, ProfileOptimum, solve
from gonio.fitting.subsurface.result import ProfileFit
from gonio.fitting.uncertainty.covariance import NORMAL_95, CovarianceEstimate
from gonio.fitting.uncertainty.identifiability import describe_combination
from gonio.fitting.uncertainty.optimum import ParameterEstimate
from gonio.models.errors import GonioError
from gonio.models.expression.builder import bssrdf_expression
from gonio.models.expression.parser import Call, Value, parse_bssrdf
from gonio.models.parameters import ParameterInfo, parameters_of
from gonio.models.subsurface.base import ABSORPTION, MOST, SCATTERING
from gonio.models.subsurface.catalog import BSSRDFS
from gonio.models.subsurface.evaluation import totals
from gonio.models.subsurface.spots import spot_rule
from gonio.models.subsurface.wide_spots import WideSpots

LEVEL = 0.01
"""Chance of calling residuals more than noise that are noise."""
LEAST = 1e-12
"""1/mm: an absorption that is 0."""
NO_INDEX = (
    "no index was given, and eta is taken as 1, matched to the outside: a profile does not tell it and the numbers "
    "depend on it, so give it, such as eta=1.3"
)
ONLY_REDUCED = "only the combination sigma_s·(1 − g) is determined by a profile: sigma_s and g are not; give g"


class Solved(NamedTuple):
    """Of each channel: its optimum, whether its noise is known, and the relative rms of its residuals."""

    optima: list[ProfileOptimum]
    known: list[bool]
    misfits: list[float]


class Request(NamedTuple):
    """What an expression requests of a fit: the model, its index and g, and the numbers of each channel."""

    call: Call
    eta: np.ndarray
    g: np.ndarray
    start: np.ndarray
    """x (channels, 2) = (√σa, ln σs'); NaN where nothing is known."""
    free: np.ndarray
    """Which of both are free (2,)."""


def fit_profile(profile: Profile | str | os.PathLike[str], model: str | None = None) -> ProfileFit:
    """σa and σs' of a model of light below the surface, by which spots of finite size read what a profile holds.

    Each channel is a fit of its own: least squares weighted by the stored uncertainties, by the readings where there
    are none. The index is that of the expression (1 if it says nothing), and is fitted where it is `eta=?`: intervals
    then hold what it leaves open.

    Args:
        profile: the profile, or its file.
        model: "dipole", "better_dipole(eta=1.3)", "dipole(sigma_a=0.01, eta=1.3)" (a value is fixed, `name~v` begins
            there); without one all models are fitted, with the index of the profile's provenance if it was simulated,
            and the one with the least residuals is taken.

    Returns:
        The fit; a material of every verb, as its `material` is.

    Raises:
        GonioError: a file that is no profile, another model, too few readings.
    """
    if not isinstance(profile, Profile):
        profile = open_profile(profile)
    if model is not None:
        call = parse_bssrdf(model)
        free = call is not None and "eta" in call.values and _is_free(call.values["eta"])
        return fit_with_free_index(lambda eta: _fitted(profile, model, eta)) if free else _fitted(profile, model)
    eta = _stated_index(profile)
    fits = [_fitted(profile, f"{name}{eta}") for name in BSSRDFS]
    best = min(fits, key=lambda fit: (not fit.converged, fit.cost))
    candidates = [
        {
            "model": fit.requested, "free": len([p for p in fit.parameters if p.status != "fixed"]),
            "bic_above_best": fit.cost - best.cost, "relative_rms": fit.metrics["relative_rms"],
            "converged": fit.converged, "verdict": "taken" if fit is best else "",
        }
        for fit in fits
    ]  # fmt: skip
    return dataclasses.replace(best, alternatives=candidates)


def _stated_index(profile: Profile) -> str:
    """The index of a simulated profile's material, which an experimenter would know, as an expression says it."""
    material = profile.provenance.get("material")
    try:
        call = parse_bssrdf(str(material.get("spelling"))) if isinstance(material, dict) else None
    except GonioError:
        call = None
    number = call.values["eta"].number if call and "eta" in call.values else None
    if isinstance(number, tuple):
        return f"(eta=[{', '.join(f'{n:g}' for n in number)}])" if len(number) == len(profile.channels) else ""
    return "" if number is None else f"(eta={number:g})"


def _fitted(profile: Profile, model: str, index: float | None = None) -> ProfileFit:
    """The fit; `index`: of all channels, in place of the expression's."""
    request = _requested(profile, model, index)
    distances, which = np.unique(np.abs(profile.offsets), return_inverse=True)
    rule = spot_rule(distances, profile.illuminated_radius, profile.viewed_radius, NODES)
    kind, optima, known, misfits = BSSRDFS[request.call.name], [], [], []
    for c in range(len(profile.channels)):
        if not (profile.value[:, c][profile.valid[:, c]] > 0).any():
            raise GonioError(f"channel {profile.channels.names[c]} has no light: none of its readings is above 0")
        weight, has_noise = _weights(profile, c)
        if np.count_nonzero(weight) < np.count_nonzero(request.free):
            name = profile.channels.names[c]
            raise GonioError(f"channel {name} has {np.count_nonzero(weight)} readings, too few for two numbers")
        y = np.where(profile.valid[:, c], profile.value[:, c], 0.0)
        data = ProfileData(rule.r, rule.weight, which, y, weight)
        optima.append(solve(kind, data, float(request.eta[c]), request.start[c], request.free))
        known.append(has_noise)
        used = weight > 0
        difference = optima[-1].residual[used] / weight[used]
        misfits.append(float(np.linalg.norm(difference) / max(np.linalg.norm(y[used]), 1e-300)))
    return _result(profile, model, request, Solved(optima, known, misfits))


def _requested(profile: Profile, model: str, index: float | None) -> Request:
    call, count = parse_bssrdf(model), len(profile.channels)
    if call is None:
        raise GonioError(
            f"{model!r} is no model of light below the surface, as a profile shows it; give {', '.join(BSSRDFS)}"
        )
    wrong = [name for name in ("albedo", "mfp") if name in call.values]
    if wrong:
        raise GonioError(f"a profile is fitted by sigma_a and sigma_s; leave {wrong[0]} out")

    def by_channel(name: str) -> np.ndarray:
        number = call.values.get(name, Value()).number
        values = np.atleast_1d(np.array(np.nan if number is None else number, float))
        if values.size not in (1, count):
            raise GonioError(f"{name} has {values.size} values, and the profile has {count} channels; give one each")
        return np.array(np.broadcast_to(values, (count,)))

    g = np.nan_to_num(by_channel("g"))
    reduced = np.clip(by_channel("sigma_s") * (1 - g), LEAST, MOST)
    start = np.stack([np.sqrt(by_channel("sigma_a")) - NEAR_ZERO, np.log(reduced)], axis=1)
    free = [name not in call.values or _is_free(call.values[name]) for name in ("sigma_a", "sigma_s")]
    given = by_channel("eta") if "eta" in call.values else np.ones(count)
    return Request(call, given if index is None else np.full(count, index), g, start, np.array(free))


def _is_free(value: Value) -> bool:
    return value.free or value.number is None


def _weights(profile: Profile, c: int) -> tuple[np.ndarray, bool]:
    """Weights (n,) of the readings of one channel, 0 where there is none; whether they are those of the noise."""
    valid, u, value = profile.valid[:, c], profile.u[:, c], np.abs(profile.value[:, c])
    known = valid & (np.nan_to_num(u) > 0)
    if known.any():
        return np.where(valid, 1 / np.where(known, u, np.median(u[known])), 0.0), True
    floor = 1e-9 * max(float(np.max(value[valid], initial=0.0)), 1e-300)
    return np.where(valid, 1 / np.maximum(np.nan_to_num(value), floor), 0.0), False


@dataclasses.dataclass(frozen=True)
class _Spread:
    """Standard uncertainties of x (2,), of σa itself where it is 0, and the factor of the 95 % interval."""

    u: np.ndarray
    factor: float
    undetermined: np.ndarray
    sentences: list[str]
    covariance: np.ndarray
    """(2, 2) of σa and σs', NaN of what is not known or on its bound."""


def _result(profile: Profile, model: str, request: Request, solved: Solved) -> ProfileFit:
    optima, known, misfits = solved
    undetermined, parameters, covariances = [], [], []
    spreads: list[_Spread] = []
    notes = [] if "eta" in request.call.values else [NO_INDEX]
    freedom = [max(int(np.count_nonzero(o.residual)) - int(request.free.sum()), 0) for o in optima]
    for c, (o, dof) in enumerate(zip(optima, freedom, strict=True)):
        name = profile.channels.names[c] if len(optima) > 1 else None
        spread = _spread(o, request.free, dof, known[c], "" if name is None else f"[{name}]")
        parameters += _estimates(o, request, spread, c, name)
        spreads.append(spread)
        covariances.append(_of_free_numbers(spread.covariance, request, c))
        undetermined += spread.sentences
        if known[c] and dof and chdtrc(dof, o.cost) < LEVEL:
            notes.append(
                f"the residuals{'' if name is None else f' of {name}'} are more than the stored noise: the model does "
                f"not follow the profile, and its intervals are {np.sqrt(o.cost / dof):.2g} times as wide"
            )
    if "g" in request.call.values and _is_free(request.call.values["g"]):
        undetermined.append(ONLY_REDUCED)
        parameters = [
            dataclasses.replace(p, status="undetermined") if p.name.endswith("sigma_s") else p for p in parameters
        ]
        covariances = [np.full_like(part, np.nan) for part in covariances]
    values = {
        "sigma_a": [o.root**2 for o in optima],
        "sigma_s": [o.reduced / (1 - float(g)) for o, g in zip(optima, request.g, strict=True)],
        "g": request.g.tolist(), "eta": request.eta.tolist(),
    }  # fmt: skip
    bssrdf = BSSRDFS[request.call.name](**{n: jnp.asarray(v if len(set(v)) > 1 else v[0]) for n, v in values.items()})
    expression, total = bssrdf_expression(bssrdf), totals(bssrdf)
    metrics = {"relative_rms": max(misfits), "total": float(total.max())}
    if all(known) and min(freedom) > 0:
        metrics["reduced_chi2"] = sum(o.cost for o in optima) / sum(freedom)
    slope = max(o.gradient for o in optima)
    exact, converged = all(o.exact for o in optima), all(o.converged for o in optima)
    reason = "the residual is rounding" if exact else f"largest projected gradient {slope:.1e}"
    material = Material(profile.name or expression, WideSpots(bssrdf), expression, profile.channels, "a fitted profile")
    return ProfileFit(
        material, model, parameters, converged, reason, metrics, int(profile.valid.sum()),
        sum(o.cost for o in optima), STARTS, min(o.agreed for o in optima), undetermined, notes,
        _residuals(profile, solved, sum(freedom)), profile.name, covariance_by_channel=_numbered(covariances),
        common_errors=_common_errors(profile, request, optima, spreads) if converged and not exact else [],
    )  # fmt: skip


def _common_errors(
    profile: Profile, request: Request, optima: list[ProfileOptimum], spreads: list[_Spread]
) -> list[dict[str, Any]]:
    """What all readings share and the uncertainties leave out."""

    def moves_by(acts: str) -> tuple[float, str]:
        label, largest = "", 0.0
        for c, (o, spread) in enumerate(zip(optima, spreads, strict=True)):
            weight, _ = _weights(profile, c)
            area = profile.illuminated_radius**2 or 1.0
            y = np.where(profile.valid[:, c], profile.value[:, c], 0.0)
            shift = y if acts == "factor" else np.full(y.shape, 1 / (np.pi * area))
            movable = request.free & ~spread.undetermined & np.array([not o.at_bound, True])
            if not movable.any():
                continue
            step = np.linalg.lstsq(o.jacobian[:, movable], shift * weight, rcond=1e-12)[0]
            for k, moved in zip(np.flatnonzero(movable), np.abs(step) / spread.u[movable], strict=True):
                if moved > largest:
                    channel = f"[{profile.channels.names[c]}]" if len(optima) > 1 else ""
                    label, largest = f"{request.call.name}.{('sigma_a', 'sigma_s')[k]}{channel}", float(moved)
        return largest, label

    return left_out(profile.provenance, lambda acts: {one: moves_by(one) for one in acts})


def _of_free_numbers(covariance: np.ndarray, request: Request, c: int) -> np.ndarray:
    """The covariance of the free ones of σa and σs = σs'/(1 − g)."""
    factors = np.array([1.0, 1 / (1 - float(request.g[c]))])
    return (covariance * np.outer(factors, factors))[np.ix_(request.free, request.free)]


def _numbered(covariances: list[np.ndarray]) -> list[dict[str, Any]]:
    """Each channel's covariance with the places of its numbers among all free ones, as files keep it."""
    size = len(covariances[0])
    return [
        {"numbers": list(range(c * size, (c + 1) * size)), "covariance": part.tolist()}
        for c, part in enumerate(covariances)
        if size
    ]


def _residuals(profile: Profile, solved: Solved, freedom: int) -> dict[str, Any]:
    """Whether the residuals along the offsets are noise, structure or rounding."""
    optima, known, _ = solved
    order = np.argsort(profile.offsets, kind="stable")
    scaled = np.stack([o.residual for o in optima], axis=-1)[order]
    cost = sum(o.cost for o in optima) if all(known) else None
    tests = noise_tests(scaled, profile.valid[order], cost, freedom, all(o.exact for o in optima))
    return {"noisiness": dataclasses.asdict(tests)}


def _spread(o: ProfileOptimum, free: np.ndarray, dof: int, known: bool, suffix: str) -> _Spread:
    """How sure x is; by the stored noise, or by the residuals where nothing is stored or they are more than noise."""
    scale, factor = 1.0, NORMAL_95
    if not known or (dof and chdtrc(dof, o.cost) < LEVEL):
        scale = max(o.cost, o.rounding**2) / dof if dof else np.nan
        factor = float(stdtrit(dof, 0.975)) if dof else np.nan
    matrix = o.jacobian.T @ o.jacobian
    # In σa over σs' and in σs' itself: what the rest of gonio calls open of such numbers is open here
    p = np.array([o.root**2 / o.reduced, o.reduced])
    slopes = np.array([(1.0 if o.at_bound else 2 * o.root) / o.reduced, o.reduced])
    domains = Domains(np.array([LOG1P, LOG]), np.array([0.0, 1 / MOST]), np.array([MOST, MOST]))
    movable = free & np.array([not o.at_bound, True])
    natural = CovarianceEstimate(matrix / np.outer(slopes, slopes) / max(scale, 1e-300), None, dof + 2, domains, p)
    covariance = natural.covariance(movable)
    u = np.where(covariance.undetermined & np.isnan(covariance.standard), np.inf, covariance.standard / slopes)
    if o.at_bound:
        u[0] = np.sqrt(scale * np.linalg.pinv(matrix, hermitian=True)[0, 0])
    names = [f"sigma_a{suffix}", f"sigma_s{suffix}"]
    sentences = [
        describe_combination(variance, change, p, names, np.zeros(2, bool))
        for variance, change in covariance.combinations
    ]
    # The root's own spread is in the uncertainty of σa, and has to be in its covariance
    widened = 1.0 if o.at_bound else np.hypot(1.0, u[0] / max(np.sqrt(2.0) * o.root, 1e-300))
    sizes = np.array([o.reduced * widened, 1.0])
    by_number = covariance.matrix * np.outer(sizes, sizes)
    return _Spread(u, factor, covariance.undetermined & movable, sentences, by_number)


def _estimates(
    o: ProfileOptimum, request: Request, spread: _Spread, c: int, channel: str | None
) -> list[ParameterEstimate]:
    """Both numbers of one channel with their uncertainties; x is even, the numbers are its square and exponential."""
    root, reach, factor = o.root, spread.factor * spread.u, 1 / (1 - float(request.g[c]))
    at_bound = (0.0, reach[0])
    absorption = at_bound if o.at_bound else (max(root - reach[0], 0.0) ** 2, (root + reach[0]) ** 2)
    reduced = o.reduced
    scattering = (factor * reduced * np.exp(-reach[1]), factor * reduced * np.exp(np.minimum(reach[1], 700.0)))
    u = (
        spread.u[0] if o.at_bound else np.hypot(2 * root * spread.u[0], np.sqrt(2) * spread.u[0] ** 2),
        factor * reduced * spread.u[1],
    )
    rows: list[tuple[str, float, float, tuple[float, float], ParameterInfo]] = [
        ("sigma_a", root**2, float(u[0]), absorption, ABSORPTION),
        ("sigma_s", factor * reduced, float(u[1]), scattering, SCATTERING),
    ]
    estimates = []
    for k, (name, value, standard, interval, info) in enumerate(rows):
        status = "undetermined" if spread.undetermined[k] else "determined"
        if not request.free[k]:
            status, standard, interval = "fixed", 0.0, (value, value)
        elif k == 0 and not spread.undetermined[0] and (o.at_bound or root < reach[0]):
            status, interval = "at lower bound", (0.0, interval[1])
        ends = (float(interval[0]), float(interval[1]))
        label, low, high = f"{request.call.name}.{name}", info.low, info.high
        estimates.append(ParameterEstimate(label, channel, value, standard, ends, status, info.unit, low, high))
    known = parameters_of(BSSRDFS[request.call.name])["eta"]
    eta = float(request.eta[c])
    label = f"{request.call.name}.eta"
    return [*estimates, ParameterEstimate(label, channel, eta, 0.0, (eta, eta), "fixed", "1", known.low, known.high)]

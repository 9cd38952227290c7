"""From a profile to the coefficients of light below the surface, with what the readings leave open."""

import dataclasses
import os
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from gonio.data.material import Material
from gonio.data.profile import Profile
from gonio.data.profile_files import open_profile
from gonio.fitting.common_errors import left_out
from gonio.fitting.residuals.noise_tests import noise_tests
from gonio.fitting.subsurface.free_index import fit_with_free_index
from gonio.fitting.subsurface.problem import NEAR_ZERO, NODES, STARTS, LeastSquares, ProfileData, ProfileOptimum, solve
from gonio.fitting.subsurface.result import ProfileFit
from gonio.fitting.subsurface.spread import LEVEL, Spread, followed, spread_of
from gonio.fitting.subsurface.unstated_noise import (
    MIN_FREEDOM,
    even_weights,
    likeliest_weights,
    relative_weights,
)
from gonio.fitting.uncertainty.optimum import ParameterEstimate
from gonio.models.errors import GonioError
from gonio.models.expression.builder import bssrdf_expression
from gonio.models.expression.parser import Call, Value, parse_bssrdf
from gonio.models.parameters import ParameterInfo, parameters_of
from gonio.models.special.scipy_functions import chdtrc
from gonio.models.subsurface.base import ABSORPTION, MOST, SCATTERING
from gonio.models.subsurface.catalog import BSSRDFS
from gonio.models.subsurface.evaluation import totals
from gonio.models.subsurface.spots import spot_rule
from gonio.models.subsurface.wide_spots import WideSpots

TYPICAL_INDEX = 1.4
"""Of the fit that tells the noise of readings without uncertainties, where the index is free."""
LEAST = 1e-12
"""1/mm: an absorption that is 0."""
NO_INDEX = (
    "no index was given, and eta is taken as 1, matched to the outside: a profile does not tell it and the numbers "
    "depend on it, so give it, such as eta=1.3"
)
ONLY_REDUCED = "only the combination sigma_s·(1 − g) is determined by a profile: sigma_s and g are not; give g"


REWEIGHTED = 8
"""Fits of readings without uncertainties: each takes the weights that make the last one's residuals likeliest."""


class Solved(NamedTuple):
    """Of each channel: its least squares and optimum, whether its noise is known, and its residuals' relative rms."""

    problems: list[LeastSquares]
    optima: list[ProfileOptimum]
    known: list[bool]
    misfits: list[float]


class Weighed(NamedTuple):
    """A fit, and the weights of its readings (n, channels)."""

    fit: ProfileFit
    weights: np.ndarray


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

    Each channel is a fit of its own: least squares weighted by the stored uncertainties, or where there are none by a
    share of the reading and a constant, as the residuals ask for. The index is that of the expression (1 if it says
    nothing), and is fitted where it is `eta=?`: intervals then hold what it leaves open.

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
        if not free:
            return _fitted(profile, model).fit
        weights = _fitted(profile, model, TYPICAL_INDEX).weights
        return fit_with_free_index(
            lambda eta: _fitted(profile, model, eta, weights, follow=False).fit,
            lambda eta: _fitted(profile, model, eta, weights).fit,
        )
    eta = _stated_index(profile)
    each = [_fitted(profile, f"{name}{eta}") for name in BSSRDFS]
    # One noise for all, that of the model which follows the readings best: other weights, other costs
    weights = min(each, key=lambda one: one.fit.metrics["relative_rms"]).weights
    stated = all(one.fit.noise_stated for one in each)
    fits = (
        [one.fit for one in each]
        if stated
        else [_fitted(profile, one.fit.requested, None, weights).fit for one in each]
    )
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


def _fitted(
    profile: Profile, model: str, index: float | None = None, weights: np.ndarray | None = None, follow: bool = True
) -> Weighed:
    """The fit; `index`: of all channels, in place of the expression's; `weights` of readings that state no noise."""
    request = _requested(profile, model, index)
    distances, which = np.unique(np.abs(profile.offsets), return_inverse=True)
    rule = spot_rule(distances, profile.illuminated_radius, profile.viewed_radius, NODES)
    kind = BSSRDFS[request.call.name]
    problems: list[LeastSquares] = []
    optima: list[ProfileOptimum] = []
    known, misfits = [], []
    for c in range(len(profile.channels)):
        if not (profile.value[:, c][profile.valid[:, c]] > 0).any():
            raise GonioError(f"channel {profile.channels.names[c]} has no light: none of its readings is above 0")
        weight = _stated_weights(profile, c)
        known.append(weight is not None)
        if weight is None:
            some = relative_weights(profile.value[:, c], profile.valid[:, c])
            weight = some if weights is None else weights[:, c]
        if np.count_nonzero(weight) < np.count_nonzero(request.free):
            name = profile.channels.names[c]
            raise GonioError(f"channel {name} has {np.count_nonzero(weight)} readings, too few for two numbers")
        y = np.where(profile.valid[:, c], profile.value[:, c], 0.0)
        data = ProfileData(rule.r, rule.weight, which, y, weight)
        problem = LeastSquares.of(kind, data, float(request.eta[c]), request.start[c], request.free)
        problem, optimum = (
            (problem, solve(problem, request.start[c])) if known[-1] else _reweighted(problem, request, c)
        )
        problems.append(problem)
        optima.append(optimum)
        weight = problem.data.weight
        used = weight > 0
        difference = optimum.residual[used] / weight[used]
        misfits.append(float(np.linalg.norm(difference) / max(np.linalg.norm(y[used]), 1e-300)))
    fit = _result(profile, model, request, Solved(problems, optima, known, misfits), follow)
    return Weighed(fit, np.stack([problem.data.weight for problem in problems], axis=1))


def _reweighted(problem: LeastSquares, request: Request, c: int) -> tuple[LeastSquares, ProfileOptimum]:
    """The fit of readings that state no uncertainty, with the weights that their residuals ask for."""
    valid, y = problem.data.weight > 0, problem.data.y
    enough = np.count_nonzero(valid) - np.count_nonzero(request.free) >= MIN_FREEDOM
    weight = even_weights(y, valid) if enough else problem.data.weight
    for _ in range(REWEIGHTED):
        problem = dataclasses.replace(problem, data=problem.data._replace(weight=weight))
        optimum = solve(problem, request.start[c])
        if not enough or optimum.exact:
            break
        safe = np.where(valid, weight, 1.0)
        model = y + np.where(valid, optimum.residual / safe, 0.0)
        axes, _ = np.linalg.qr(optimum.jacobian[:, request.free])
        new = likeliest_weights(model, y - model, np.sum(axes**2, axis=1), valid)
        if np.allclose(new / new.max(), weight / weight.max(), rtol=0.02):
            break
        weight = new
    return problem, optimum


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


def _stated_weights(profile: Profile, c: int) -> np.ndarray | None:
    """Weights (n,) of the readings of one channel by their noise, 0 where there is none; None where none is stated."""
    valid, u = profile.valid[:, c], profile.u[:, c]
    known = valid & (np.nan_to_num(u) > 0)
    return np.where(valid, 1 / np.where(known, u, np.median(u[known])), 0.0) if known.any() else None


def _result(profile: Profile, model: str, request: Request, solved: Solved, follow: bool) -> ProfileFit:
    problems, optima, known, misfits = solved
    undetermined, parameters, covariances = [], [], []
    spreads: list[Spread] = []
    notes = [] if "eta" in request.call.values else [NO_INDEX]
    counts = [int(np.count_nonzero(problem.data.weight)) for problem in problems]
    freedom = [max(count - int(request.free.sum()), 0) for count in counts]
    for c, (o, dof) in enumerate(zip(optima, freedom, strict=True)):
        name = profile.channels.names[c] if len(optima) > 1 else None
        suffix = "" if name is None else f"[{name}]"
        spread = spread_of(o, request.free, dof, known[c], suffix)
        if follow and o.converged and spread.scale > 0 and (known[c] or not o.exact):
            spread = followed(problems[c], o, spread, suffix)
        parameters += _estimates(o, request, spread, c, name)
        spreads.append(spread)
        covariances.append(_of_free_numbers(spread.covariance, request, c))
        undetermined += spread.sentences
        notes += _noise_notes("" if name is None else f" of {name}", o, counts[c], dof, known[c])
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
    if all(known) and sum(freedom) > 0:
        metrics["reduced_chi2"] = sum(o.cost for o in optima) / sum(freedom)
    slope = max(o.gradient for o in optima)
    # Of as many readings as numbers the residual is rounding whatever they are
    exact, converged = all(o.exact for o in optima) and min(freedom) > 0, all(o.converged for o in optima)
    reason = "the residual is rounding" if exact else f"largest projected gradient {slope:.1e}"
    material = Material(profile.name or expression, WideSpots(bssrdf), expression, profile.channels, "a fitted profile")
    return ProfileFit(
        material, model, parameters, converged, reason, metrics, int(profile.valid.sum()),
        sum(o.cost for o in optima), STARTS, min(o.agreed for o in optima), undetermined, notes,
        _residuals(profile, solved, sum(freedom)), profile.name, covariance_by_channel=_numbered(covariances),
        noise_stated=all(known),
        common_errors=_common_errors(profile, request, problems, optima, spreads) if converged and not exact else [],
    )  # fmt: skip


def _noise_notes(of: str, o: ProfileOptimum, count: int, dof: int, known: bool) -> list[str]:
    """What is off with the noise of one channel, as it is stated or not."""
    if not known and dof < MIN_FREEDOM:
        return [
            f"no uncertainty is stated{of}, and {count} readings are too few to tell the noise, which is taken as a "
            "share of each reading; state u_R"
        ]
    if known and dof and chdtrc(dof, o.cost) < LEVEL:
        return [
            f"the residuals{of} are more than the stored noise: the model does not follow the profile, and its "
            f"intervals are {np.sqrt(o.cost / dof):.2g} times as wide"
        ]
    return []


def _common_errors(
    profile: Profile,
    request: Request,
    problems: list[LeastSquares],
    optima: list[ProfileOptimum],
    spreads: list[Spread],
) -> list[dict[str, Any]]:
    """What all readings share and the uncertainties leave out."""

    def moves_by(acts: str) -> tuple[float, str]:
        label, largest = "", 0.0
        for c, (o, spread) in enumerate(zip(optima, spreads, strict=True)):
            weight = problems[c].data.weight
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
    _, optima, known, _ = solved
    order = np.argsort(profile.offsets, kind="stable")
    scaled = np.stack([o.residual for o in optima], axis=-1)[order]
    cost = sum(o.cost for o in optima) if all(known) else None
    tests = noise_tests(scaled, profile.valid[order], cost, freedom, all(o.exact for o in optima))
    return {"noisiness": dataclasses.asdict(tests)}


def _estimates(
    o: ProfileOptimum, request: Request, spread: Spread, c: int, channel: str | None
) -> list[ParameterEstimate]:
    """Both numbers of one channel with their uncertainties; x is even, the numbers are its square and exponential."""
    root, reach, factor = o.root, spread.factor * spread.u, 1 / (1 - float(request.g[c]))
    at_bound = (0.0, reach[0])
    absorption = at_bound if o.at_bound else (max(root - reach[0], 0.0) ** 2, (root + reach[0]) ** 2)
    reduced = o.reduced
    scattering = (factor * reduced * np.exp(-reach[1]), factor * reduced * np.exp(np.minimum(reach[1], 700.0)))
    if spread.ends is not None:
        absorption = (spread.ends[0].low ** 2, spread.ends[0].high ** 2)
        scattering = (factor * np.exp(spread.ends[1].low), factor * np.exp(min(spread.ends[1].high, 700.0)))
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
        elif k == 0 and not spread.undetermined[0] and (o.at_bound or absorption[0] <= 0):
            status, interval = "at lower bound", (0.0, interval[1])
        ends = (max(float(interval[0]), info.low), min(float(interval[1]), max(info.high, value)))
        label, low, high = f"{request.call.name}.{name}", info.low, info.high
        estimates.append(ParameterEstimate(label, channel, value, standard, ends, status, info.unit, low, high))
    known = parameters_of(BSSRDFS[request.call.name])["eta"]
    eta = float(request.eta[c])
    label = f"{request.call.name}.eta"
    return [*estimates, ParameterEstimate(label, channel, eta, 0.0, (eta, eta), "fixed", "1", known.low, known.high)]

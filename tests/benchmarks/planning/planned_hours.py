"""Planned measurements against regular and random ones: errors at equal hours, and hours at equal error.

    python tests/benchmarks/planning/planned_hours.py [MEASUREMENTS [MINUTES [MATERIAL]]]

For each material and purpose (all numbers; the albedo): the median error of estimates from simulated measurements,
planned, on the best regular scan and on the best of some random ones, all of equal hours; the hours that regular and
random scans need for the plan's promised uncertainty (each scan's counting time is scaled: the best of all steps and
numbers counts), for plans as they are by default and for those without a space-filling share; `no plan`: how many times
fewer hours than a regular or random scan the best of all designs would need that knew the numbers beforehand and spent
no time on the way, over `DENSER` times as many directions as a plan's: where photons are the limit that is little; the
scatter of the estimates over what was promised, with its interval of 95 %; the hours lost by plans made at a third and
at thrice the true α, and with that range stated; the Kiefer-Wolfowitz residual. Without measurements (0) none is
simulated.
"""

import sys

import jax
import numpy as np
from scipy.optimize import least_squares

from gonio.data import layouts
from gonio.instrument import Instrument, measure
from gonio.instrument.pace import scan_order
from gonio.instrument.scans import in_plane, isotropic, spherical
from gonio.planning import candidates
from gonio.planning.candidates import readable
from gonio.planning.limit import least_variance
from gonio.planning.planned import plan
from gonio.planning.planner import FILLING, PLANE_STEPS, REGULAR_STEPS, Planner
from gonio.planning.prior import prior_of
from gonio.planning.shots import Shots
from gonio.planning.space_filling import anywhere
from gonio.planning.wanted import albedos, quantities

MATERIALS = {
    "α = 0.03": "lambert(rho=0.3) + 0.5 * ggx(alpha=0.03)",
    "α = 0.1": "lambert(rho=0.3) + 0.5 * ggx(alpha=0.1)",
    "α = 0.3": "lambert(rho=0.3) + 0.5 * ggx(alpha=0.3)",
    "two lobes": "lambert(rho=0.2) + 0.3 * ggx(alpha=0.06) + 0.3 * ggx(alpha=0.3)",
    "brushed": "0.8 * ggx(alpha_x=0.06, alpha_y=0.3)",
    "eon + ggx": "eon(rho=0.5, r=0.6) + 0.2 * ggx(alpha=0.15)",
}
PURPOSES = {"numbers": [], "albedo": ["albedo"]}
RANDOM = (30, 100, 300, 1000)
DENSER = 10
INSTRUMENT = Instrument(photons=1e5, shadow=np.radians(3))


def scans(planner: Planner, random: bool) -> dict[str, np.ndarray]:
    """Directions in their order of regular or random scans, by name."""
    if random:
        each = {f"{n} random": space(planner, n) for n in RANDOM}
    else:
        grid, name = (isotropic, "isotropic") if planner.isotropic else (spherical, "spherical")
        each = {f"{name} {s:g}°": grid(np.radians(s)) for s in REGULAR_STEPS if planner.isotropic or s > 10}
        if planner.isotropic:
            each |= {f"in plane {s:g}°": in_plane(np.radians(s)) for s in PLANE_STEPS}
        each = {k: np.stack([np.asarray(a)[scan_order(v)] for a in v.angles()]) for k, v in each.items()}
    return {k: readable(a, INSTRUMENT) for k, a in each.items()}


def space(planner: Planner, count: int) -> np.ndarray:
    """Random directions, in the order of the light's angle."""
    even = anywhere(INSTRUMENT, False, 8 * count)[:, : 4 * count]
    chosen = even[:, np.random.default_rng(count).permutation(even.shape[1])[:count]]
    return chosen[:, np.argsort(chosen[0])]


def least(planner: Planner, budget: float) -> float:
    """The least variance of any shots of so many seconds, in `DENSER` times as many directions as a plan's."""
    numbers = {name: getattr(candidates, name) for name in ("ANYWHERE", "NEAR_MIRROR", "IN_PLANE")}
    try:
        for name, number in numbers.items():
            setattr(candidates, name, number * (DENSER if name != "IN_PLANE" else 3))
        return least_variance(Planner(planner.prior, INSTRUMENT, wanted=planner.wanted), budget)
    finally:
        for name, number in numbers.items():
            setattr(candidates, name, number)


def interval(z: np.ndarray) -> tuple[float, float]:
    """The interval of 95 % of the rms of z (measurements, P), by resampling whole measurements."""
    rng = np.random.default_rng(1)
    rms = [np.sqrt(np.mean(z[rng.integers(0, len(z), len(z))] ** 2)) for _ in range(2000)]
    low, high = np.quantile(rms, [0.025, 0.975])
    return float(low), float(high)


def equal(planner: Planner, angles: np.ndarray, budget: float, promised: float) -> tuple[float, float, Shots]:
    """(variance at equal hours, hours at the promised variance, shots of equal hours) of a scan."""
    way = INSTRUMENT.pace.path_seconds(angles, 0.0)
    # A second in each direction: variances of counts go with one over the time.
    second = Shots(angles, np.ones(angles.shape[1]))
    try:
        variance = planner.mean_variance(planner.covariance(second))
    except np.linalg.LinAlgError:
        return np.inf, np.inf, second
    counting = max((budget - way) / angles.shape[1], 1e-9)
    return variance / counting if way < budget else np.inf, way + angles.shape[1] * variance / promised, Shots(
        angles, np.full(angles.shape[1], counting)
    )  # fmt: skip


def simulated(truth: str, shots: Shots, planner: Planner, number: int) -> tuple[float, float, np.ndarray]:
    """(median error of the numbers, geometric mean; median largest error of the albedo, relative; z (number, P)).

    By the least-squares estimates, from the truth: whether a solver gets there from elsewhere is another benchmark's.
    """
    prior, count = planner.prior, shots.seconds.size
    layout, u = layouts.scattered(*np.tile(shots.angles, number)), np.sqrt(np.diagonal(planner.covariance(shots)))
    table = measure(truth, INSTRUMENT, layout, seconds=np.tile(shots.seconds, number), log=lambda text: None)
    f, u_f = (a.reshape(number, count, -1) for a in (table.f, table.u_f))
    d, q = prior.parameterisation.domains, albedos(prior, prior.p)
    errors = []
    for y, sigma in zip(f, u_f, strict=True):
        # The numbers in units of themselves.
        def residuals(x: np.ndarray, y: np.ndarray = y, sigma: np.ndarray = sigma) -> np.ndarray:
            return ((prior.at_angles(x * prior.p, shots.angles)[0] - y) / sigma).ravel()

        def jacobian(x: np.ndarray, sigma: np.ndarray = sigma) -> np.ndarray:
            slopes = prior.at_angles(x * prior.p, shots.angles)[1] / sigma[..., None]
            return slopes.reshape(-1, prior.p.size) * prior.p

        bounds = (d.low / prior.p - 1e-12, d.high / prior.p + 1e-12)
        x = least_squares(residuals, np.ones(prior.p.size), jacobian, bounds, xtol=1e-12, ftol=1e-12, gtol=1e-12).x
        errors.append((x - 1) * prior.p)
    of_numbers = np.exp(np.mean(np.log(np.median(np.abs(errors) / prior.p, axis=0))))
    of_albedo = np.max(np.abs(np.array(errors) @ q.slopes.T / q.values), axis=1)
    return float(of_numbers), float(np.median(of_albedo)), np.array(errors) / u


def lost(truth: str, budget: float) -> list[float]:
    """Hours lost by plans made at α/3 and 3α, and over the range between."""
    prior, widths = prior_of(truth, None), []
    for k, name in enumerate(prior.names):
        if "alpha" in name:
            widths.append(k)
    judge = Planner(prior, INSTRUMENT)
    best = judge.mean_variance(judge.covariance(plan(truth, INSTRUMENT, budget=budget).shots))
    losses = []
    for factor in (1 / 3, 3.0):
        p = prior.p.copy()
        p[widths] = np.minimum(p[widths] * factor, 0.9)
        wrong = plan(prior.brdf(p), INSTRUMENT, budget=budget)
        losses.append(judge.mean_variance(judge.covariance(wrong.shots)) / best)
    ranges = {prior.names[k]: (prior.p[k] / 3, min(3 * prior.p[k], 0.9)) for k in widths}
    robust = plan(truth, INSTRUMENT, budget=budget, ranges=ranges)
    return [*losses, judge.mean_variance(judge.covariance(robust.shots)) / best]


def main(number: int, budget: float, only: str | None) -> None:
    print(f"{number} simulated measurements, {budget / 60:g} min each")
    for name, truth in MATERIALS.items():
        if only not in (None, name):
            continue
        for purpose, wanted in PURPOSES.items():
            row(number, budget, f"{name}, for {purpose}", truth, wanted)
        print(
            "    hours lost by α/3, 3α, and with the range stated: "
            + ", ".join(f"× {x:.2f}" for x in lost(truth, budget))
        )


def row(number: int, budget: float, title: str, truth: str, wanted: list[str]) -> None:
    """Prints what is shown of one material and purpose."""
    prior = prior_of(truth, None)
    q = quantities(prior, prior.p, wanted) if wanted else None
    planned, bare = (
        plan(truth, INSTRUMENT, budget=budget, wanted=wanted, space_filling=share) for share in (FILLING, 0.0)
    )
    planner = Planner(prior, INSTRUMENT, wanted=q and (q.slopes / q.values[:, None])[None])
    variances = [planner.mean_variance(planner.covariance(p.shots)) for p in (planned, bare)]
    variances.append(least(planner, budget))
    shots, hours = {"planned": planned.shots}, {}
    for kind in ("regular", "random"):
        every = scans(planner, kind == "random")
        of_each = [{k: equal(planner, a, budget, v) for k, a in every.items()} for v in variances]
        best = min(every, key=lambda k: of_each[0][k][0])
        hours[kind] = [min(h for _, h, _ in each.values()) / budget for each in of_each]
        shots[f"{kind} ({best})"] = of_each[0][best][2]
    errors = {k: simulated(truth, v, planner, number) for k, v in shots.items()} if number else {}
    counts = (f"{k} × {a:.1f} ({b:.1f} without filling; no plan × {c:.1f})" for k, (a, b, c) in hours.items())
    print(
        f"{title}: {planned.shots.seconds.size} shots; hours at equal uncertainty: {', '.join(counts)}; "
        f"least variance / plan's {variances[2] / variances[0]:.2f}; "
        f"Kiefer-Wolfowitz {planned.residual / planned.scale:.1e} p",
        flush=True,
    )
    for k, (numbers, albedo, z) in errors.items():
        low, high = interval(z)
        print(
            f"    {k}: numbers {numbers:.2e}, albedo {albedo:.2e}, scatter/promised "
            f"{np.sqrt(np.mean(z**2)):.2f} ({low:.2f} to {high:.2f})",
            flush=True,
        )


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    count, minutes, material = [*sys.argv[1:], *("50", "20", "")[len(sys.argv) - 1 :]][:3]
    main(int(count), 60 * float(minutes), material or None)

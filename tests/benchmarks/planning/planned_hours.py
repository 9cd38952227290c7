"""Planned measurements against regular and random ones: errors at equal hours, and hours at equal error.

    python tests/benchmarks/planning/planned_hours.py [MEASUREMENTS] [MINUTES]

For each material and purpose (all numbers; the albedo): the median error of estimates from simulated measurements,
planned, on the best regular scan and on the best of some random ones, all of equal hours; the hours that regular and
random scans need for the plan's promised uncertainty (each scan's counting time is scaled: the best of all steps and
numbers counts); the scatter of the estimates over what was promised; the hours lost by plans made at a third and at
thrice the true α, and with that range stated; the Kiefer-Wolfowitz residual. `no plan`: how many times fewer hours than
a regular or random scan the best of all designs would need that spent no time on the way; where photons are the limit
that is little. Without measurements (0) none is simulated.
"""

import sys

import jax
import numpy as np
from scipy.optimize import least_squares

from gonio.data import layouts
from gonio.instrument import Instrument, measure
from gonio.instrument.pace import scan_order
from gonio.instrument.scans import in_plane, isotropic, spherical
from gonio.planning.candidates import readable, space_filling
from gonio.planning.design import Problem, covariance, gram, optimal_design
from gonio.planning.planned import plan
from gonio.planning.planner import PLANE_STEPS, REGULAR_STEPS, Planner
from gonio.planning.prior import prior_of
from gonio.planning.shots import Shots
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
    even = space_filling(INSTRUMENT, False, 4 * count)
    chosen = even[:, np.random.default_rng(count).permutation(even.shape[1])[:count]]
    return chosen[:, np.argsort(chosen[0])]


def gain(planner: Planner, covariance: np.ndarray) -> float:
    """A plan's variance by its own criterion, in the mean over the numbers."""
    loss = planner.loss(covariance)
    return float(np.exp(loss / (planner.size if planner.wanted is None else 1)))


def least(planner: Planner, budget: float) -> float:
    """The least variance that any shots of so many seconds have, were there no way between them [Kiefer-Wolfowitz]."""
    times = planner.candidates.best_seconds(0.0, budget)
    rows = planner.candidates.rows(times) * np.sqrt(budget / times)[:, None, None]
    design = optimal_design(Problem(rows, planner.before, planner.size, planner.wanted))
    return gain(planner, covariance(gram(rows[:1], design.shares) + planner.before, planner.size)[0][0])


def equal(planner: Planner, angles: np.ndarray, budget: float, promised: float) -> tuple[float, float, Shots]:
    """(variance at equal hours, hours at the promised variance, shots of equal hours) of a scan."""
    way = INSTRUMENT.pace.path_seconds(angles, 0.0)
    # A second in each direction: variances of counts go with one over the time.
    second = Shots(angles, np.ones(angles.shape[1]))
    try:
        variance = gain(planner, planner.covariance(second))
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
    best = gain(judge, judge.covariance(plan(truth, INSTRUMENT, budget=budget).shots))
    losses = []
    for factor in (1 / 3, 3.0):
        p = prior.p.copy()
        p[widths] = np.minimum(p[widths] * factor, 0.9)
        wrong = plan(prior.brdf(p), INSTRUMENT, budget=budget)
        losses.append(gain(judge, judge.covariance(wrong.shots)) / best)
    ranges = {prior.names[k]: (prior.p[k] / 3, min(3 * prior.p[k], 0.9)) for k in widths}
    robust = plan(truth, INSTRUMENT, budget=budget, ranges=ranges)
    return [*losses, gain(judge, judge.covariance(robust.shots)) / best]


def main(number: int, budget: float) -> None:
    print(f"{number} simulated measurements, {budget / 60:g} min each")
    for name, truth in MATERIALS.items():
        for purpose, wanted in PURPOSES.items():
            prior = prior_of(truth, None)
            q = quantities(prior, prior.p, wanted) if wanted else None
            planned = plan(truth, INSTRUMENT, budget=budget, wanted=wanted)
            planner = Planner(prior, INSTRUMENT, wanted=q and (q.slopes / q.values[:, None])[None])
            promised = gain(planner, planner.covariance(planned.shots))
            shots = {"planned": planned.shots}
            hours, most, limit = {}, {}, least(planner, budget)
            for kind in ("regular", "random"):
                each = {k: equal(planner, a, budget, promised) for k, a in scans(planner, kind == "random").items()}
                best = min(each, key=lambda k: each[k][0])
                hours[kind] = min(h for _, h, _ in each.values()) / budget
                most[kind] = min(equal(planner, a, budget, limit)[1] for a in scans(planner, kind == "random").values())
                shots[f"{kind} ({best})"] = each[best][2]
            errors = {k: simulated(truth, v, planner, number) for k, v in shots.items()} if number else {}
            scatter = np.sqrt(np.mean(errors["planned"][2] ** 2)) if number else np.nan
            print(
                f"{name}, for {purpose}: {planned.shots.seconds.size} shots; hours at equal uncertainty: regular × "
                f"{hours['regular']:.1f} (no plan × {most['regular'] / budget:.1f}), random × {hours['random']:.1f} "
                f"(no plan × {most['random'] / budget:.1f}); scatter/promised {scatter:.2f}; "
                f"Kiefer-Wolfowitz {planned.residual / planned.scale:.1e} p",
                flush=True,
            )
            for k, (numbers, albedo, _) in errors.items():
                print(f"    {k}: numbers {numbers:.2e}, albedo {albedo:.2e}", flush=True)
        print(
            "    hours lost by α/3, 3α, and with the range stated: "
            + ", ".join(f"× {x:.2f}" for x in lost(truth, budget))
        )


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50, 60 * float(sys.argv[2]) if len(sys.argv) > 2 else 1200.0)

"""Fits where they are hard: what came out, and what the result said of it.

    python tests/benchmarks/fits/fit_stability.py [SEEDS]

Each case is fitted with several seeds of noise (5 by default). `right`: every number that the fit calls determined
lies within five standard uncertainties of the truth (or twice as far as its 95 % interval), or within 1e-6 of it;
`says so`: one does not, but the result is not converged, finds structure or outliers in its residuals, or widened its
uncertainties; `refused`: one sentence; `silent`: a wrong number and no word. The last line counts the last kind. Where
several sums of lobes are the same surface, each of them is a truth.
"""

import dataclasses
import sys
import time

import jax
import numpy as np
from fit_coverage import truths

import gonio
from gonio.data import layout as layouts
from gonio.data.flags import Flag
from gonio.data.table import Channels, Table, whole_table_of_values
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

HALF = layouts.merl(counts=(60, 30, 36))
POLAR = np.radians(np.arange(0, 86, 5.0))
ANY = 0.777  # the width of a lobe of no strength
GRID = layouts.isotropic(POLAR, POLAR, np.radians(np.arange(0, 360, 20.0)))


@dataclasses.dataclass(frozen=True)
class Case:
    """A hard fit: truths, what is asked, where, and how readings are spoilt. No truth: no number is right."""

    truth: str | tuple[str, ...] | None
    asked: str
    layout: object = GRID
    noise: float = 0.01
    known: bool = True
    spikes: float = 0.0
    missing: float = 0.0
    theta_max: float | None = None
    only: int | None = None
    data: str | None = None
    options: tuple = ()


def cases() -> dict[str, Case]:
    """The cases by name."""
    plastic, asked = "lambert(rho=0.2) + 0.5*ggx(alpha={})", "lambert + ggx"
    found = {
        f"α = {a:g}, {grid}": Case(plastic.format(a), asked, layout)
        for a in (0.002, 0.005, 0.02, 0.1, 0.5, 1.0)
        for grid, layout in (("MERL's spacing", HALF), ("5° grid", GRID))
    }
    schlick = "lambert(rho=0.2) + 1*ggx(alpha=0.2, f0={})"
    found |= {f"F₀ = {f:g}": Case(schlick.format(f), "lambert + 1*ggx(f0=?)") for f in (0.0, 0.001, 0.5, 1.0)}
    usual = plastic.format(0.3)
    twins = ("0.3*ggx(alpha=.2)+0.3*ggx(alpha=.2)", *_with_nothing("", "0.6*ggx(alpha=.2)"))
    many = (
        *_with_nothing("lambert(rho=0.2) + ", "0.5*ggx(alpha=.3)"),
        "lambert(rho=0.2)+0.2*ggx(alpha=.3)+0.3*ggx(alpha=.3)",
    )
    hidden = "lambert(rho=0.2)+0.5*ggx(alpha=.3,f0=.04)"
    spiked = Case(usual, asked, spikes=0.01)
    found |= {
        "1 % outliers × 100, σ known": spiked,
        "1 % outliers × 100": dataclasses.replace(spiked, known=False),
        "1 % outliers × 100, σ known, robust": dataclasses.replace(spiked, options=(("robust", True),)),
        "1 % outliers × 100, robust": dataclasses.replace(spiked, known=False, options=(("robust", True),)),
        "20 % outliers × 100, robust": dataclasses.replace(
            spiked, spikes=0.2, known=False, options=(("robust", True),)
        ),
        "60 % of cells missing": Case(usual, asked, missing=0.6),
        "F₀ free, angles to 45°": Case(hidden, "lambert + ggx(f0=?)", theta_max=46.0),
        "F₀ free, angles to 25°": Case(hidden, "lambert + ggx(f0=?)", theta_max=26.0),
        "two equal lobes": Case(twins, "ggx + ggx"),
        "two equal lobes, no noise": Case(twins, "ggx + ggx", noise=0.0),
        "two nearly equal lobes": Case("0.3*ggx(alpha=.2)+0.3*ggx(alpha=.22)", "ggx + ggx"),
        "a lobe too many": Case(many, "lambert + ggx + ggx"),
        "a lobe too many, σ unknown": Case(many, "lambert + ggx + ggx", known=False),
        "outside the family: Beckmann": Case(None, asked, data="lambert(rho=0.2)+0.5*beckmann(alpha=.3)"),
        "outside the family: Beckmann, σ unknown": Case(
            None, asked, data="lambert(rho=0.2)+0.5*beckmann(alpha=.3)", known=False
        ),
        "outside the family: cloth": Case(None, asked, data="lambert(rho=0.2)+0.5*charlie(alpha=.4)", known=False),
        "outside the family: two lobes": Case(
            None, asked, data="lambert(rho=0.2)+0.3*ggx(alpha=.1)+0.3*ggx(alpha=.4)", known=False
        ),
        "all zero": Case("lambert(rho=0) + 0*ggx(alpha=.3)", asked, noise=0.0),
        "all zero, noise of 0.001": Case("lambert(rho=0) + 0*ggx(alpha=.3)", asked, noise=-0.001),
        "constant": Case("lambert(rho=0.5) + 0*ggx(alpha=.3)", asked, noise=0.0),
        "constant, noise": Case("lambert(rho=0.5) + 0*ggx(alpha=.3)", asked),
        "12 samples": Case(usual, asked, only=12),
        "12 samples, σ unknown": Case(usual, asked, only=12, known=False),
        "3 samples": Case(usual, asked, only=3),
        "2 samples": Case(usual, asked, only=2),
        "30 % noise": Case(usual, asked, noise=0.3),
        "30 % noise, σ unknown": Case(usual, asked, noise=0.3, known=False),
        "no noise": Case(usual, asked, noise=0.0),
    }  # fmt: skip
    return found


def _with_nothing(before: str, lobe: str) -> tuple[str, str]:
    nothing = f"0*ggx(alpha={ANY})"
    return f"{before}{lobe} + {nothing}", f"{before}{nothing} + {lobe}"


def table_of(c: Case, seed: int) -> Table:
    """The readings of a case. `noise` is a share of f, or, below 0, an amount in 1/sr."""
    rng = np.random.default_rng(seed)
    f = np.asarray(evaluate(build(c.data or spelled(c)[0]), *c.layout.directions()), float).reshape(*c.layout.shape, 1)
    usual = np.median(np.abs(f[np.isfinite(f)]))
    sigma = -c.noise * np.ones_like(f) if c.noise < 0 else c.noise * np.maximum(np.abs(f), 1e-3 * usual)
    y = f + sigma * rng.standard_normal(f.shape)
    y = np.where(rng.random(f.shape) < c.spikes, 100 * y, y)
    u = sigma if c.known and c.noise else None
    table = whole_table_of_values(c.layout, y, Channels.grey(), u_f=u, name="hard")
    if c.missing:
        gone = (rng.random(f.shape) < c.missing) & (table.flag == Flag.VALID)
        table.flag[gone], table.f[gone] = Flag.NOT_MEASURED, np.nan
    return table


def outcome(c: Case, seed: int) -> tuple[str, float, list[str]]:
    """(verdict, worst error over what it may be, what the result said) of one fit."""
    theta_max = None if c.theta_max is None else np.radians(c.theta_max)
    try:
        r = gonio.fit(table_of(c, seed), c.asked, samples=c.only, theta_max=theta_max, seed=seed, **dict(c.options))
    except GonioError as error:
        return "refused", float("nan"), [str(error)]
    verdict = r.residuals.noisiness.verdict
    said = [] if r.converged else [f"not converged: {r.reason}"]
    said += [
        s for s in r.residuals.sentences if verdict == "structure" or "scales off" in s or "too few" in s
    ] + r.notes
    warned = bool(said)
    said += r.undetermined + [f"active bound: {b}" for b in r.active_bounds]
    if c.truth is None:
        return ("says so" if warned else "silent"), float("nan"), said
    worst = min(_worst(r, truths(t, c.layout)) for t in spelled(c))
    return ("right" if worst <= 1 else "says so" if warned else "silent"), worst, said


def spelled(c: Case) -> tuple[str, ...]:
    """The truths of a case."""
    return (c.truth,) if isinstance(c.truth, str) else c.truth or ()


def _worst(r, actual: dict[str, float]) -> float:
    worst = 0.0
    for p in (p for p in r.parameters if p.status != "fixed" and p.status != "undetermined"):
        t = actual[p.label]
        if t == ANY:
            continue
        # An interval that is no normal one may reach farther than five standard uncertainties.
        reach = max(abs(e - p.value) for e in p.interval95)
        u = p.standard_uncertainty if np.isfinite(p.standard_uncertainty) else 0.0
        worst = max(worst, abs(p.value - t) / max(5 * u, 2 * reach, 1e-6 * max(abs(t), 1e-3)))
    return worst


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    total = dict.fromkeys(("right", "says so", "refused", "silent"), 0)
    print(f"{'case':44} {'outcome of ' + str(seeds):32} {'error/allowed':>13} {'s':>5}  said")
    for name, c in cases().items():
        began = time.perf_counter()
        found = [outcome(c, seed) for seed in range(seeds)]
        verdicts = [v for v, _, _ in found]
        for v in verdicts:
            total[v] += 1
        counts = ", ".join(f"{verdicts.count(v)} {v}" for v in total if v in verdicts)
        worst = max((e for _, e, _ in found), key=lambda e: (e == e, e))
        words = next((w for v, _, w in found if v == "silent"), found[0][2])
        took = (time.perf_counter() - began) / seeds
        print(f"{name:44} {counts:32} {worst:13.3g} {took:5.2f}  {'; '.join(w[:150] for w in words[:2])}", flush=True)
    print("total: " + ", ".join(f"{n} {v}" for v, n in total.items()))


if __name__ == "__main__":
    main()

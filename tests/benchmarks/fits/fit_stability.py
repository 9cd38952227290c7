"""Fits where they are hard: what came out, and what the result said of it.

    python tests/benchmarks/fits/fit_stability.py [SEEDS]

Each case is fitted with several seeds of noise (5 by default). `right`: every number that the fit calls determined
lies within five standard uncertainties of the truth (or twice as far as its 95 % interval), or within 1e-6 of it;
`says so`: one does not, but the result is not converged, finds structure or outliers in its residuals, or widened its
uncertainties; `refused`: one sentence; `silent`: a wrong number and no word. The last line counts the last kind. Where
several sums of lobes are the same surface, each of them is a truth.
"""

import pathlib
import sys
import time

import jax
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

import gonio
from gonio.fitting.result import FitResult
from gonio.models.errors import GonioError
from gonio.stability.problems import ANY, RECOVERIES, RecoveryProblem, tagged, true_numbers
from support.scans import table_of_problem


def outcome(problem: RecoveryProblem, seed: int) -> tuple[str, float, list[str]]:
    """(verdict, worst error over what it may be, what the result said) of one fit."""
    limits = {} if problem.theta_max >= 90 else {"theta_max": np.radians(problem.theta_max)}
    robust = {"robust": True} if problem.robust else {}
    try:
        table = table_of_problem(problem, seed)
        r = gonio.fit(table, problem.model, samples=problem.samples, seed=seed, **limits, **robust)
    except GonioError as error:
        return "refused", float("nan"), [str(error)]
    verdict = r.residuals.noisiness.verdict
    said = [] if r.converged else [f"not converged: {r.reason}"]
    said += [s for s in r.residuals.sentences if verdict == "structure" or "scales off" in s or "too few" in s] + [
        note for note in r.notes if "which nothing states" not in note
    ]  # which every fit of a bare table says
    warned = bool(said)
    said += r.undetermined + [f"active bound: {b}" for b in r.active_bounds]
    if not problem.truths:
        return ("says so" if warned else "silent"), float("nan"), said
    worst = min(_worst(r, true_numbers(t)) for t in problem.truths)
    return ("right" if worst <= 1 else "says so" if warned else "silent"), worst, said


def _worst(r: FitResult, actual: dict[str, float]) -> float:
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
    for problem in tagged(RECOVERIES, "hard"):
        began = time.perf_counter()
        found = [outcome(problem, seed) for seed in range(seeds)]
        verdicts = [v for v, _, _ in found]
        for v in verdicts:
            total[v] += 1
        counts = ", ".join(f"{verdicts.count(v)} {v}" for v in total if v in verdicts)
        worst = max((e for _, e, _ in found), key=lambda e: (e == e, e))
        words = next((w for v, _, w in found if v == "silent"), found[0][2])
        took = (time.perf_counter() - began) / seeds
        print(
            f"{problem.name:44} {counts:32} {worst:13.3g} {took:5.2f}  {'; '.join(w[:150] for w in words[:2])}",
            flush=True,
        )
    print("total: " + ", ".join(f"{n} {v}" for v, n in total.items()))


if __name__ == "__main__":
    main()

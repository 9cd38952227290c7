"""Whether the 95 % intervals of fits cover the truth, and whether what readings leave open is named.

    python tests/benchmarks/fits/fit_coverage.py [DRAWS [MATERIAL...|open]]

Five materials (or those named) are measured DRAWS times each (1,000 by default) by an instrument with shot, dark,
read-out and source noise, and fitted. For each number that a fit calls determined: the share of intervals that hold the
truth, with the range in which 99 % of such shares lie if intervals are right. Then (or with `open` alone) cases built
to leave numbers open, a fifth of DRAWS each.
"""

import dataclasses
import pathlib
import sys
import time

import jax
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

import gonio
from gonio.data.table import Table, whole_table_of_values
from gonio.instrument.instrument import Instrument
from gonio.stability.problems import RECOVERIES, RecoveryProblem, tagged, true_numbers
from support.scans import layout_of

CHANNELS = ("R", "G", "B")
INSTRUMENT = Instrument(photons=2e4, dark=5.0, read_noise=3.0, noise=0.01)


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    z = 2.576 * np.sqrt(0.95 * 0.05 / draws)
    print(f"{draws} measurements of each material; 99 % of right shares lie in {0.95 - z:.3f}–{0.95 + z:.3f}")
    print(f"{'':10} {'number':18} {'determined':>10} {'covered':>8} {'bootstrap':>9} {'rms z':>6} {'mean z':>7}")
    shares = []
    problems = tagged(RECOVERIES, "coverage")
    for problem in (p for p in problems if p.name in sys.argv[2:] or len(sys.argv) < 3):
        began = time.perf_counter()
        shares += coverage(problem, draws)
        print(f"{'':10} {draws} measurements and fits in {time.perf_counter() - began:.0f} s")
    if shares:
        print(f"worst and best share: {min(shares):.3f} and {max(shares):.3f}", flush=True)
    if len(sys.argv) > 2 and "open" not in sys.argv:
        return
    print(f"\n{'left open':24} {'named':>6} {'of':>5} {'not converged':>13}   said the last time")
    for problem in tagged(RECOVERIES, "left open"):
        named, stuck, said = 0, 0, ""
        for draw in range(draws // 5):
            result = gonio.fit(measured(problem, draw), problem.model, starts=2)
            held = {p.name for p in result.parameters if p.status == "undetermined"}
            left_open = problem.left_open
            named += left_open <= held and any(n in words for words in result.undetermined for n in left_open)
            stuck += not result.converged
            said = result.undetermined[0] if result.undetermined else ""
        print(f"{problem.name:24} {named:6} {draws // 5:5} {stuck:13}   {said}")


def coverage(problem: RecoveryProblem, draws: int) -> list[float]:
    actual = true_numbers(problem.measured, CHANNELS)
    covered, again, z, determined = ({n: [] for n in actual} for _ in range(4))
    for draw in range(draws):
        table = measured(problem, draw)
        # A bootstrap is fifty fits: every tenth measurement has one.
        result = gonio.fit(table, problem.model, starts=2, bootstrap=100 if draw % 10 == 0 else 0)
        assert result.converged, result.reason
        refits = {n["name"]: n for n in (result.bootstrap or {"numbers": []})["numbers"]}
        for p in (p for p in result.parameters if p.status != "fixed"):
            determined[p.label].append(p.status == "determined")
            if p.status != "determined":
                continue
            t = actual[p.label]
            covered[p.label].append(p.interval95[0] <= t <= p.interval95[1])
            z[p.label].append((p.value - t) / p.standard_uncertainty)
            if p.label in refits:
                low, high = refits[p.label]["interval95"]
                again[p.label].append(low <= t <= high)
    for n in (n for n in actual if determined[n]):
        e = np.array(z[n])
        print(
            f"{problem.name:10} {n:18} {np.mean(determined[n]):10.3f} {np.mean(covered[n]):8.3f} "
            f"{np.mean(again[n]):9.2f} "
            f"{np.sqrt(np.mean(e**2)):6.3f} {e.mean():+7.3f}"
        )
    return [float(np.mean(c)) for n, c in covered.items() if c]


_EXACT: dict[str, Table] = {}


def measured(problem: RecoveryProblem, draw: int) -> Table:
    """What the instrument reads; the expected readings are worked out once for each material."""
    from gonio.instrument import noise

    truth, layout = problem.measured, layout_of(problem.scan)
    if problem.name not in _EXACT:
        _EXACT[problem.name] = gonio.measure(truth, None, layout)
    exact = _EXACT[problem.name]
    wi, _ = layout.directions()
    expected = np.nan_to_num(np.asarray(exact.f, float).reshape(layout.size, -1))
    lit = np.maximum(np.asarray(wi.z), 1e-9)
    f, _ = noise.read(INSTRUMENT, 1000 + draw, 0, expected, lit)
    u = noise.standard_uncertainty(INSTRUMENT, expected, lit)
    made = whole_table_of_values(layout, f, u_f=u.reshape(*layout.shape, -1), name=truth)
    return dataclasses.replace(made, flag=exact.flag)


if __name__ == "__main__":
    main()

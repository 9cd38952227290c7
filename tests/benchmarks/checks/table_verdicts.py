"""Verdicts on energy of tables on grids of 1°, 2°, 5° and 10°, with a node on the mirror direction and without, of
lobes of any width that conserve energy or do not, against the truth: how many are wrong, and how many undecided.

    python table_verdicts.py [--model | --planned] [STEP ...]     (1 2 5 10)

With `--model`, what is undecided is judged again with the help of a model that is fitted to the table; with
`--planned` then with the few further readings that `gonio plan --for energy` names, twice at the most.
"""

import collections
import sys

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402
from random_mixtures import verdict  # noqa: E402

from gonio.checks.table.energy import table_energy  # noqa: E402
from gonio.checks.table.evidence import TableEvidence  # noqa: E402
from gonio.data import layouts  # noqa: E402
from gonio.data.table import whole_table_of_values  # noqa: E402
from gonio.data.tabulate import grid_values  # noqa: E402
from gonio.models.albedo import directional_albedo  # noqa: E402
from gonio.models.expression.builder import build  # noqa: E402

ALPHAS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
STEPS = (1.0, 2.0, 5.0, 10.0)
MATERIALS = ("0.7 * ggx(alpha={a})", "1.3 * ggx(alpha={a})", "lambert(rho=0.3) + 0.9 * beckmann(alpha={a})",
             "lambert(rho=0.3) + 0.6 * ggx(alpha={a})")  # fmt: skip
THETA_I = np.radians(np.arange(0, 81, 20.0))
TOLERANCE = 0.01


def main() -> None:
    counts, wrong, undecided = collections.Counter(), [], []
    assisted, planned = (name in sys.argv[1:] for name in ("--model", "--planned"))
    steps = [float(a) for a in sys.argv[1:] if not a.startswith("-")] or STEPS
    print(f"{'step':>5} {'alpha':>6} " + "".join(f"{m.replace('{a}', 'α'):>42}" for m in MATERIALS))
    for step in steps:
        for alpha in ALPHAS:
            cells = []
            for expression in MATERIALS:
                brdf = build(expression.format(a=alpha))
                albedo = directional_albedo(brdf, THETA_I, tolerance=1e-7)
                lawful = np.max(albedo.value) <= 1 + TOLERANCE
                verdicts = []
                for shift in (0.0, 0.5):
                    polar, azimuth = (np.radians(np.arange(a, b, step)) for a, b in ((shift * step, 89.9), (0, 360)))
                    layout = layouts.isotropic(THETA_I, polar, azimuth)
                    table = whole_table_of_values(layout, grid_values(brdf, layout))
                    energy = table_energy(TableEvidence(table), TOLERANCE)
                    if assisted and energy.verdict == "undecided":
                        energy = table_energy(TableEvidence(table, model="auto"), TOLERANCE)
                    if planned and energy.verdict == "undecided":
                        energy = verdict(table, brdf, "auto")[1]
                    right = energy.verdict == ("pass" if lawful else "fail")
                    outcome = "undecided" if energy.verdict == "undecided" else "right" if right else "WRONG"
                    if outcome == "undecided":
                        unread = energy.facts.get("incidences_without_mirror_direction", 0) > 0
                        counts[step, "undecided, mirror direction not read"] += unread
                        undecided.append((step, shift, expression.format(a=alpha), energy.detail))
                    if outcome == "WRONG":
                        wrong.append((step, shift, brdf, energy.detail))
                    counts[step, outcome] += 1
                    verdicts.append(energy.verdict)
                cells.append(f"{'lawful' if lawful else 'lawless'}: {' / '.join(verdicts)}")
            print(f"{step:5g} {alpha:6g} " + "".join(f"{c:>42}" for c in cells), flush=True)
    print()
    for step in steps:
        right, open_, bad = (counts[step, k] for k in ("right", "undecided", "WRONG"))
        unread = counts[step, "undecided, mirror direction not read"]
        print(
            f"{step:4g}°: {right} right, {bad} wrong, {open_} undecided ({open_ / (right + open_ + bad):.0%}), "
            f"{unread} of them without a node in the mirror direction"
        )
    for one in undecided if assisted or planned else ():
        print("undecided", *one)
    for one in wrong:
        print("WRONG", *one)


if __name__ == "__main__":
    main()

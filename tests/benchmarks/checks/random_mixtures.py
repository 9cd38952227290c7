"""Energy of tables of random mixtures that gain 0, 0.5, 2 or 10 % of light: how many verdicts are wrong, or open.

    python random_mixtures.py [MIXTURES] [SEED] [auto|own|other] [RECORD]     (150 0 auto)

A mixture is a diffuser and one or two lobes of random kind and width. It is scaled so that its greatest albedo at the
table's incidences is 1, 1.005, 1.02 or 1.1; with the tolerance of 1 % the first two are lawful. Each is tabulated
without noise on an isotropic grid of 5° and of 10°, every other one with nodes half a step off the mirror direction.
A table is judged alone; where that is undecided, with a model that is fitted to it: selected (auto), of the mixture's
own families, which costs a tenth of the time, or of other families, which have to decide nothing wrongly. Where it
still is, with the few further readings that `gonio plan --for energy` names, twice at the most.

RECORD is a file that takes a line a verdict: those that stand in it are not run again, and counted with the others.
"""

import collections
import json
import re
import sys
import time
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

from gonio.checks.certificate import Property  # noqa: E402
from gonio.checks.energy_plan import plan_energy  # noqa: E402
from gonio.checks.table.energy import table_energy  # noqa: E402
from gonio.checks.table.evidence import TableEvidence  # noqa: E402
from gonio.checks.table.further_readings import joined  # noqa: E402
from gonio.data import layouts  # noqa: E402
from gonio.data.table import Table, whole_table_of_values  # noqa: E402
from gonio.data.tabulate import grid_values  # noqa: E402
from gonio.models.albedo import directional_albedo  # noqa: E402
from gonio.models.brdf import AbstractBRDF  # noqa: E402
from gonio.models.errors import GonioError  # noqa: E402
from gonio.models.evaluation import evaluate  # noqa: E402
from gonio.models.expression.builder import build  # noqa: E402

THETA_I = np.radians(np.arange(0, 81, 20.0))
TOLERANCE = 0.01
GAINS = (0.0, 0.005, 0.02, 0.1)
STEPS = (5.0, 10.0)
DIFFUSERS = ("lambert(rho={a:.3f})", "eon(rho={a:.3f}, r={b:.3f})")
LOBES = (
    "ggx(alpha={a:.5f}, f0={f:.3f})", "beckmann(alpha={a:.5f}, f0={f:.3f})", "phong(n={n:.2f})", "ward(alpha={a:.5f})",
    "cook_torrance(alpha={a:.5f}, f0={f:.3f})", "gtr(alpha={a:.5f}, gamma={g:.2f}, f0={f:.3f})",
)  # fmt: skip
OTHER = {
    "ggx": "beckmann",
    "beckmann": "ggx",
    "phong": "ggx",
    "ward": "phong",
    "cook_torrance": "ward",
    "gtr": "beckmann",
}
WITH_F0 = ("ggx", "beckmann", "cook_torrance", "gtr")
STAGES = ("alone", "with a model", "with readings")
ROUNDS = 2


def mixture(rng: np.random.Generator) -> str:
    """A diffuser and one or two lobes, each with its share."""
    terms = [str(rng.choice(DIFFUSERS)).format(a=rng.uniform(0.05, 0.9), b=rng.uniform())]
    for _ in range(int(rng.integers(1, 3))):
        alpha = 10 ** rng.uniform(-2.5, -0.2)
        lobe = str(rng.choice(LOBES)).format(a=alpha, f=rng.uniform(0.02, 1), n=2 / alpha**2, g=rng.uniform(1.2, 4))
        terms.append(f"{10 ** rng.uniform(-1.5, 0):.4f} * {lobe}")
    return " + ".join(terms)


def model_of(expression: str, kind: str) -> str:
    """The model to fit to a mixture: "auto", or its own families, or others."""
    families = re.findall(r"([a-z_]+)\(", expression)
    families = [OTHER.get(name, name) for name in families] if kind == "other" else families
    return "auto" if kind == "auto" else " + ".join(f"{n}(f0=?)" if n in WITH_F0 else n for n in families)


def verdict(table: Table, brdf: AbstractBRDF, model: str) -> tuple[str, Property]:
    """The stage at which energy is decided (or the last), and what it says there."""
    energy = table_energy(TableEvidence(table), TOLERANCE)
    if energy.verdict != "undecided":
        return STAGES[0], energy
    evidence = TableEvidence(table, model=model)
    energy = table_energy(evidence, TOLERANCE)
    if energy.verdict != "undecided":
        return STAGES[1], energy
    further = None
    for _ in range(ROUNDS):
        fitted = evidence.refitted
        assert fitted is not None
        try:
            plan = plan_energy(table, tolerance=TOLERANCE, model=model, further=further, fitted=fitted)
        except GonioError as nothing:
            return f"no readings decide: {nothing}", energy
        read = whole_table_of_values(plan.layout, np.asarray(evaluate(brdf, *plan.layout.directions())))
        further = read if further is None else joined(further, read)
        # The structure that the table asks for; where that leaves energy open, the one that all readings ask for.
        for name in dict.fromkeys((fitted.requested, model)):
            evidence = TableEvidence(table, model=name, further=further)
            energy = table_energy(evidence, TOLERANCE)
            if energy.verdict != "undecided":
                return STAGES[2], energy
    return STAGES[2], energy


def judged(k: int, step: float, seed: int, kind: str) -> dict[str, object]:
    """The verdict of mixture `k` on a grid of `step` degrees, and whether it is right."""
    expression, gain = mixture(np.random.default_rng([seed, k])), GAINS[k % 4]
    greatest = float(np.max(directional_albedo(build(expression), THETA_I, tolerance=1e-7).value))
    scaled = f"{(1 + gain) / greatest:.12g} * ({expression})"
    brdf = build(scaled)
    shift = 0.5 * (k // 4 % 2)
    polar, azimuth = (np.radians(np.arange(a, b, step)) for a, b in ((shift * step, 89.9), (0, 360)))
    layout = layouts.isotropic(THETA_I, polar, azimuth)
    start = time.process_time()
    stage, energy = verdict(whole_table_of_values(layout, grid_values(brdf, layout)), brdf, model_of(expression, kind))
    right = energy.verdict == ("pass" if gain < TOLERANCE else "fail")
    outcome = "undecided" if energy.verdict == "undecided" else "right" if right else "WRONG"
    return {
        "mixture": k, "step": step, "seed": seed, "kind": kind, "gain": gain, "shift": shift, "outcome": outcome,
        "stage": stage, "seconds": round(time.process_time() - start, 1), "of": scaled, "detail": energy.detail,
    }  # fmt: skip


def main(mixtures: int = 150, seed: int = 0, kind: str = "auto", record: str | None = None) -> None:
    path = Path(record) if record else None
    kept = [json.loads(line) for line in path.read_text().splitlines()] if path is not None and path.exists() else []
    done = {(v["mixture"], v["step"]): v for v in kept if (v["seed"], v["kind"]) == (seed, kind)}
    counts: collections.Counter[tuple[float, str]] = collections.Counter()
    for k in range(mixtures):
        for step in STEPS:
            one = done.get((k, step)) or judged(k, step, seed, kind)
            if path is not None and (k, step) not in done:
                with path.open("a") as file:
                    file.write(json.dumps(one) + "\n")
            counts[step, one["stage"] if one["outcome"] == "right" else one["outcome"]] += 1
            if one["outcome"] != "right":
                print(
                    f"{one['outcome']} {k} {step:g}° shift {one['shift']} gain {one['gain']}: {one['of']}: "
                    f"{one['stage']}: {one['detail']}",
                    flush=True,
                )
    for step in STEPS:
        alone, model, readings, undecided, wrong = (counts[step, s] for s in (*STAGES, "undecided", "WRONG"))
        print(
            f"{step:4g}°: {wrong} wrong; right {alone} alone, {model} with a model, {readings} with further readings; "
            f"{undecided} undecided; undecided alone {1 - (alone + wrong) / mixtures:.0%}, with a model "
            f"{1 - (alone + model + wrong) / mixtures:.0%}, with further readings {undecided / mixtures:.0%}"
        )


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:3]), *sys.argv[3:5])

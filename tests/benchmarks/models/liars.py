"""The confusion table: published liars, losers and honest models, judged by `gonio check` at its usual tolerances."""

import jax

jax.config.update("jax_enable_x64", True)

import math  # noqa: E402

from gonio import check  # noqa: E402
from gonio.checks.controls.known_violations import HONEST, LEAST_LOSS, LIARS, LOSERS  # noqa: E402
from gonio.models.catalog import MODELS  # noqa: E402
from gonio.models.expression.builder import build, example  # noqa: E402


def judged(expression: str) -> dict:
    return {p.name: p for p in check(expression).properties}


def main() -> None:
    counts = {}
    print(f"{'kind':8} {'model':58} {'energy':10} {'reciprocity':12} {'worst E − 1':>11} {'largest loss':>12}")
    every = [("liar", s, law) for s, law in LIARS.items()] + [("loser", s, None) for s in LOSERS]
    every += [("honest", s, None) for s in HONEST]
    known = {s.partition("(")[0] for _, s, _ in every}
    rest = [example(n).strip("'") for n in MODELS if n not in known]
    every += [("honest", s, None) for s in rest if not build(s).violates]
    for kind, expression, law in every:
        found = judged(expression)
        e, r = found["energy"], found["reciprocity"]
        loss = e.facts.get("largest_loss", math.nan)
        if kind == "liar":
            outcome = "caught" if found[law].verdict == "fail" else f"MISSED ({found[law].verdict})"
        else:
            good = e.verdict == "pass" and r.verdict == "pass"
            outcome = "passes" if good else f"NOT PASSED ({e.verdict}, {r.verdict})"
            if kind == "loser":
                outcome += ", loses" if loss > LEAST_LOSS else ", LOSS NOT SEEN"
        counts[kind, outcome] = counts.get((kind, outcome), 0) + 1
        print(
            f"{kind:8} {expression[:58]:58} {e.verdict:10} {r.verdict:12} {e.residual:11.4g} {loss:12.4g}  {outcome}",
            flush=True,
        )
    print()
    for (kind, outcome), n in sorted(counts.items()):
        print(f"{kind:8} {outcome:40} {n}")


if __name__ == "__main__":
    main()

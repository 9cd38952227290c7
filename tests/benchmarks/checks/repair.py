"""A measured table made reciprocal and lawful in energy: residuals before and after, and how far its readings moved.

python repair.py FILE [STEP]
"""

import sys
import time

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

from gonio import repair  # noqa: E402
from gonio.checks.table.energy import table_albedos  # noqa: E402
from gonio.cli.verbs.check_verb import repair_sentence  # noqa: E402


def main(path: str, step: float | None = None) -> None:
    for nonnegative in (False, True):
        start = time.process_time()
        result = repair(path, nonnegative=nonnegative, step=step)
        seconds = time.process_time() - start
        print(f"{path}{', no reading negative' if nonnegative else ''}: {seconds:.1f} CPU s")
        for name in ("reciprocity", "energy", "positivity"):
            b, a = result.before[name], result.after[name]
            print(f"  {name:12} {b.verdict:>9} {b.residual:10.3g} ± {b.bound:8.2g}   →   {a.verdict:>9}"
                  f" {a.residual:10.3g} ± {a.bound:8.2g}")  # fmt: skip
        print(f"  median reciprocity by channel {result.before['reciprocity'].facts['median_by_channel']}")
        print(f"  largest albedo after {np.max(table_albedos(result.table).value):.6f}")
        print(f"  {repair_sentence(result)}")


if __name__ == "__main__":
    main(sys.argv[1], *(float(a) for a in sys.argv[2:]))

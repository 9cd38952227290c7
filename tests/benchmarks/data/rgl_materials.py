"""RGL files: how many readings and negatives, how near one and two GGX lobes over Lambert come, what the checks say.

python rgl_materials.py FOLDER
"""

import math
import pathlib
import sys
import time

import jax

import gonio

ONE, TWO = "lambert + ggx(f0=?)", "lambert + ggx(f0=?) + ggx(f0=?)"
THETA_MAX = math.radians(80)


def main(folder: str) -> None:
    jax.config.update("jax_enable_x64", True)
    head = ("material", "readings", "negative", "1 lobe: rms, median", "2 lobes: rms, median", "BIC prefers")
    print("{:20} {:>8} {:>8} {:>20} {:>21} {:>11}  reciprocity          energy     s".format(*head))
    for path in sorted(pathlib.Path(folder).glob("*.bsdf")):
        began = time.perf_counter()
        table = gonio.open(path)
        one, two = (gonio.fit(table, m, theta_max=THETA_MAX) for m in (ONE, TWO))
        certificate = gonio.check(table)
        reciprocity, energy = certificate["reciprocity"], certificate["energy"]
        seconds = time.perf_counter() - began
        counts = table.counts()
        prefers = "2 lobes" if two.bic < one.bic else "1 lobe"
        print(
            f"{path.stem.removesuffix('_rgb'):20} {counts['valid']:8d} {counts['negative']:8d} {_errors(one):>20}"
            f" {_errors(two):>21} {prefers:>11}  {reciprocity.residual:7.4f} {reciprocity.verdict:10}"
            f" {energy.verdict:10} {seconds:4.1f}"
        )
    print("rms: √(Σ(m−y)²/Σy²) over the readings below 80°; median of |m−y|/|y|; loss cbrt; * did not converge.")
    print("reciprocity: median relative residual below 70°, tolerance 5 %.")


def _errors(result) -> str:
    m = result.metrics
    return f"{m['relative_rms']:.3f}, {m['median_relative']:.3f}{' ' if result.converged else '*'}"


if __name__ == "__main__":
    main(sys.argv[1])

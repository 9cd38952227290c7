"""RGL files: how many readings and negatives, how near one and two GGX lobes over Lambert come, what the checks say.

python rgl_materials.py FOLDER
"""

import pathlib
import sys
import time

import jax

import gonio

ONE, TWO = "lambert + ggx(f0=0.04)", "lambert + ggx(f0=0.04) + ggx(f0=0.04)"


def main(folder: str) -> None:
    jax.config.update("jax_enable_x64", True)
    head = (
        "material",
        "readings",
        "negative",
        "1 lobe",
        "median",
        "2 lobes",
        "median",
        "BIC prefers",
        "reciprocity",
        "verdict",
        "energy",
        "s",
    )
    print("{:22} {:>8} {:>8} {:>7} {:>7} {:>7} {:>7} {:>12} {:>12} {:>10} {:>10} {:>5}".format(*head))
    for path in sorted(pathlib.Path(folder).glob("*.bsdf")):
        began = time.perf_counter()
        table = gonio.open(path)
        one, two = (gonio.fit(table, m) for m in (ONE, TWO))
        certificate = gonio.check(table)
        reciprocity, energy = certificate["reciprocity"], certificate["energy"]
        seconds = time.perf_counter() - began
        counts = table.counts()
        print(
            f"{path.stem.removesuffix('_rgb'):22} {counts['valid']:8d} {counts['negative']:8d}"
            f" {_rms(one)} {one.metrics['median_relative']:7.3f} {_rms(two)} {two.metrics['median_relative']:7.3f}"
            f" {'2 lobes' if two.bic < one.bic else '1 lobe':>12} {reciprocity.residual:12.4f} {reciprocity.verdict:>10}"
            f" {energy.verdict:>10} {seconds:5.1f}"
        )
    print("1 lobe, 2 lobes: relative rms of f over all readings (loss cbrt; * not converged), and the median of |Δ|/f.")
    print("reciprocity: median relative residual below 70°, tolerance 5 %.")


def _rms(result) -> str:
    return f"{result.metrics['relative_rms']:6.3f}{' ' if result.converged else '*'}"


if __name__ == "__main__":
    main(sys.argv[1])

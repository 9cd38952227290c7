"""How far apertures bias a fitted width, with the model at their centres and averaged over them, and what it costs.

    python tests/benchmarks/fits/aperture_bias.py [detector|both [PHOTONS]]

A single-channel plastic is measured on the default scan (by 5°, 23,328 cells) with a disc detector (or source and
detector of equal discs) of several half-angles, for widths α from narrow to broad, and fitted with `aperture="ignore"`
and "average". Shown are (α̂ − α)/u of each (u: standard uncertainty of independent noise, before any widening), what
the first fit says of itself, the most pairs of directions of the second, its seconds of processor (the whole call, all
threads, compiled before; median of five), and their ratio to those of the same fit of a table that states no apertures.
"""

import dataclasses
import statistics
import sys
import time

import jax
import numpy as np

import gonio
from gonio.fitting.result import FitResult

HALF_ANGLES = (0.1, 0.2, 0.5, 1.0, 2.0)
ALPHAS = (0.02, 0.05, 0.1, 0.15, 0.3)
MODEL = "lambert + ggx(f0=0.04)"


def fitted(table: gonio.Table, how: str = "average") -> tuple[FitResult, float]:
    """The fit, and the seconds of processor that it takes."""
    result, times = gonio.fit(table, MODEL, aperture=how), []
    for _ in range(5):
        start = time.process_time()
        result = gonio.fit(table, MODEL, aperture=how)
        times.append(time.process_time() - start)
    return result, statistics.median(times)


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    both = "both" in sys.argv[1:2]
    photons = float(sys.argv[2]) if len(sys.argv) > 2 else 1e7
    gonio.fit(gonio.measure("lambert(rho=0.3)"), MODEL)
    print(f"{'source and detector' if both else 'detector'}, {photons:g} photons; biases in standard uncertainties u")
    print("half-angle  alpha        u   centres  said   averages  neglected  pairs    CPU   ratio   χ²ᵣ")
    for half_angle in HALF_ANGLES:
        for alpha in ALPHAS:
            s = np.radians(half_angle)
            instrument = gonio.Instrument(source_half_angle=s if both else 0.0, detector_half_angle=s, photons=photons)
            table = gonio.measure(f"lambert(rho=0.3) + 1*ggx(alpha={alpha}, f0=0.04)", instrument, seed=1)
            unstated = dataclasses.replace(table, source_solid_angle=None, receiver_solid_angle=None, provenance={})
            (centres, _), (averages, after), (_, before) = fitted(table, "ignore"), fitted(table), fitted(unstated)
            biases = []
            number = averages.free_names.index("ggx.alpha")
            for r in (centres, averages):
                value = next(p.value for p in r.parameters if p.name == "ggx.alpha")
                information = r.uncertainty[0].views[0].information
                biases.append((value - alpha) / np.sqrt(np.linalg.inv(information)[number, number]))
            u = (value - alpha) / biases[1]
            said, made = centres.apertures or {}, averages.apertures or {}
            largest = said["at_the_centres"]
            print(
                f"{half_angle:8.1f}°  {alpha:5.2f}  {u:.1e}  {biases[0]:8.2f}  "
                f"{'yes' if any('centres' in n for n in centres.notes) else 'no':>4}  {biases[1]:9.2f}  "
                f"{made['neglected']:9.2f}  {made['directions'][1]:5d}  {after:5.2f}  {after / before:6.2f}  "
                f"{averages.metrics['reduced_chi2']:5.2f}  {largest and largest['name']}",
                flush=True,
            )


if __name__ == "__main__":
    main()

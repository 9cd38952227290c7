"""Measured materials fitted without naming a model: what is chosen, how near it comes, and SciPy on the same model.

python real_materials.py [--starts N] FILE...     (RGL .bsdf files; NIST's PTFE.data.csv at 633 nm)

`over SciPy`: gonio's cost over the least of N random starts (default 20) of SciPy's bounded least squares with exact
derivatives, same residuals, same bounds, less one. `one more`: what the next larger model tried would have taken off
the error on held-out directions. Readings beyond 80° are left out, the loss is the cube root.
"""

import math
import pathlib
import sys
import time

import jax
import numpy as np
from scipy.optimize import least_squares

import gonio
from gonio.data.formats.nist_ptfe import read_nist
from gonio.fitting.problem.readings import floor_of, readings_of
from gonio.fitting.selection.automatic import shows_anisotropy
from gonio.fitting.selection.candidate_model import CandidateProblem, SelectionData
from gonio.fitting.selection.stepwise import stepwise_selection

THETA_MAX = math.radians(80)


def scipy_best(terms, readings, starts: int) -> tuple[float, float]:
    """(least ½Σr², CPU seconds) of random starts, widths drawn evenly in their logarithm."""
    cosine = np.asarray(readings.wi.z)[:, None]
    floor = floor_of("cbrt", (readings.f * cosine)[readings.valid])
    data = SelectionData.of(readings.wi, readings.wo, readings.f, readings.valid.astype(float), "cbrt", floor)
    problem = CandidateProblem(terms, data)
    _, low, high = problem.domains
    high = np.minimum(high, 1e3)
    width = problem.parameters.parameterisation.each(lambda g: g.info.role == "width")
    rng, best, began = np.random.default_rng(0), math.inf, time.process_time()
    last: dict[bytes, tuple] = {}

    def both(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if x.tobytes() not in last:
            last.clear()
            last[x.tobytes()] = problem.residuals(x)
        return last[x.tobytes()]

    for _ in range(starts):
        top = np.where(high > 100, 1.0, high)
        u = rng.random(low.size)
        x0 = np.where(width, np.where(width, low, 1.0) ** (1 - u) * top**u, low + (top - low) * u)
        found = least_squares(
            lambda x: both(x)[0].ravel(), x0,
            jac=lambda x: both(x)[1].reshape(-1, x.size),
            bounds=(low, high), x_scale="jac", method="trf", max_nfev=200,
        )  # fmt: skip
        best = min(best, float(found.cost))
    return best, time.process_time() - began


def one(path: str, starts: int) -> None:
    table = read_nist(path, wavelength_nm=633) if path.endswith(".csv") else gonio.open(path)
    began = time.process_time()
    result = gonio.fit(table, theta_max=THETA_MAX, loss="cbrt", starts=4)
    seconds = time.process_time() - began
    larger = [a for a in result.alternatives if a["free"] > len(result.free_names)]
    more = min(larger, key=lambda a: a["held_out_above_best"], default=None)
    m = result.metrics
    name = pathlib.Path(path).stem.removesuffix("_rgb")
    print(f"{name}: {result.requested}{'' if result.converged else '  NOT converged: ' + result.reason}")
    print("   " + ", ".join(f"{k.replace('_', ' ')} {v:.4g}" for k, v in m.items() if isinstance(v, float)))
    tried = len(result.alternatives)
    print(f"   {seconds:.1f} CPU s in all ({result.seconds['select']:.1f} s wall to choose of {tried})")
    if more:
        print(f"   one more: {-100 * more['held_out_above_best']:+.2f} % by {more['model']} ({more['verdict']})")
    sys.stdout.flush()
    if starts:
        readings = readings_of(table, theta_max=THETA_MAX)
        anisotropic = shows_anisotropy(table.layout, readings)
        terms = stepwise_selection(readings, "cbrt", None, anisotropic).chosen.terms
        least, seconds = scipy_best(terms, readings, starts)
        print(f"   over SciPy {result.cost / least - 1:+.1e} ({starts} starts, {seconds:.0f} CPU s)", flush=True)


def main(arguments: list[str]) -> None:
    jax.config.update("jax_enable_x64", True)
    starts = 20
    if arguments[:1] == ["--starts"]:
        starts, arguments = int(arguments[1]), arguments[2:]
    for path in arguments:
        one(path, starts)


if __name__ == "__main__":
    main(sys.argv[1:])

"""Fits of seven numbers (Lambert + GGX, RGB, log(1 + f) below 80°) beside SciPy's bounded least squares, in one run.

python fits_beside_scipy.py [NOISE]     relative noise of the synthetic MERL table (default 0.05)

Same readings, same loss, same bounds; SciPy on a NumPy model of its own, by differences and with the exact Jacobian.
Timings are CPU seconds of one thread, both in one process in turn, medians; peak memory of a process of its own each,
with the reading of the file. Then whole processes: `gonio fit`, with and without compiled code kept, and SciPy.
"""

import json
import os
import pathlib
import resource
import statistics
import sys
import tempfile
import time
import tomllib

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from support.process import gonio, python, timed

MODEL = "lambert + ggx(eta=1.5)"
NUMBERS = np.array([0.1, 0.2, 0.4, 0.2, 1.0, 0.8, 0.6])  # in the order of a fit: albedos, alpha, scales
TRUTH = "lambert(rho=[0.1, 0.2, 0.4]) + [1, 0.8, 0.6] * ggx(alpha=0.2, eta=1.5)"
LOW, HIGH = np.r_[np.zeros(6), 1e-4], np.r_[np.ones(3), np.full(3, 1e6), 1.0]
STARTS = 20
ONE_THREAD = {
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
    "OPENBLAS_NUM_THREADS": "1",
    "JAX_ENABLE_X64": "1",
    "GONIO_NO_CACHE": "1",
}


def main() -> None:
    noise = sys.argv[1] if len(sys.argv) > 1 else "0.05"
    with tempfile.TemporaryDirectory() as folder:
        done = timed([*python(), __file__, "make", noise], folder, **ONE_THREAD)
        assert done.status == 0, done.output
        for samples in ("20000", "0"):
            print(f"\n{'20,000 readings' if samples != '0' else 'the full table'} × 3, noise {noise}")
            found = _child(folder, "together", samples)
            print(f"{'':34}{'CPU s':>9}{'peak MB':>9}{'cost':>24}{'at the best cost':>19}")
            for name, (seconds, cost, success) in found["rows"].items():
                peak = _child(folder, name.split(",")[0], samples)["peak"] if not name.endswith("exact J") else None
                print(f"{name:34}{seconds:9.4f}{peak or '':>9}{cost:24.16g}{success:>19}")
            ours, best = found["rows"]["gonio"][1], min(r[1] for n, r in found["rows"].items() if n != "gonio")
            print(f"first fit in a process: {found['first']:.2f} CPU s, of which compiling {found['compiling']:.2f}")
            print(f"cost above SciPy's best start: {ours / best - 1:+.1e}")
        _program(folder)


def _child(folder: str, *command: str) -> dict:
    done = timed([*python(), __file__, *command], folder, **ONE_THREAD)
    assert done.status == 0, done.output
    return json.loads(done.output.splitlines()[-1])


def _program(folder: str) -> None:
    fit = [*gonio(), "fit", "t.binary", "-m", MODEL, "-o", "f.toml", "--force", "--loss", "log1p", "--theta-max", "80"]
    cache = {"XDG_CACHE_HOME": folder}
    runs = {"gonio, no compiled code": [timed(fit, folder, GONIO_NO_CACHE="1")]}
    timed(fit, folder, **cache)
    runs["gonio, compiled code kept"] = [timed(fit, folder, **cache) for _ in range(3)]
    runs["of it, importing"] = [timed([*python(), "-c", "from gonio import fit, open"], folder) for _ in range(3)]
    runs["SciPy, one start"] = [timed([*python(), __file__, "SciPy", "0"], folder, **ONE_THREAD)]
    print(f"\n{'whole processes, t.binary':34}{'wall s':>9}{'CPU s':>9}{'peak MB':>9}")
    for name, done in runs.items():
        wall, cpu, peak = (statistics.median(getattr(r, what) for r in done) for what in ("wall", "cpu", "peak_mb"))
        print(f"{name:34}{wall:9.2f}{cpu:9.2f}{peak:9.0f}")
    numbers = tomllib.loads(pathlib.Path(folder, "f.toml").read_text())["fit"]["parameters"]
    free = np.array([p["value"] for p in numbers if p["status"] != "fixed"])
    print(f"worst relative error of gonio's seven numbers: {np.max(np.abs(free / NUMBERS - 1)):.1e}")


def make(noise: str) -> None:
    from gonio.data import layouts
    from gonio.data.formats.merl import write_merl
    from gonio.data.table import whole_table_of_values
    from gonio.data.tabulate import grid_values
    from gonio.models.expression.builder import build

    grid = layouts.merl()
    f = grid_values(build(TRUTH), grid)
    f = f * (1 + float(noise) * np.random.default_rng(0).standard_normal(f.shape))
    write_merl("t.binary", whole_table_of_values(grid, f))


def _table(samples: int):
    """The table to fit, and its readings: a part of them as a table of its own."""
    from gonio.data import layouts
    from gonio.data.formats.registry import read
    from gonio.data.table import whole_table_of_values
    from gonio.fitting.problem.readings import readings_of

    table = read("t.binary")
    if not samples:
        return table, readings_of(table, theta_max=np.radians(80))
    part = table.samples(limit=samples, theta_max=np.radians(80), seed=1)
    angles = [a for w in (part.wi, part.wo) for a in layouts.spherical_angles(*w)]
    table = whole_table_of_values(layouts.scattered(*angles), part.f, channels=table.channels)
    return table, readings_of(table)


def _ours(table):
    from gonio.fitting.fit_table import fit

    return fit(table, MODEL, loss="log1p", theta_max=np.radians(80))


class SciPy:
    """What a user writes without gonio: the model in NumPy, geometry computed once."""

    def __init__(self, readings):
        wi, wo, half = (np.stack(readings.wi), np.stack(readings.wo), None)
        half = wi + wo
        half /= np.linalg.norm(half, axis=0)
        self.cos_i, self.cos_o, self.cos_h = wi[2], wo[2], half[2]
        c = np.sum(wi * half, axis=0)
        g = np.sqrt(1.5**2 - 1 + c**2)
        self.f = 0.5 * ((g - c) / (g + c)) ** 2 * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2)
        self.target = np.log1p(readings.f)
        assert readings.valid.all()

    def _lobe(self, alpha):
        a2 = alpha**2
        s = self.cos_h**2 * (a2 - 1) + 1
        r_i, r_o = np.sqrt(a2 + (1 - a2) * self.cos_i**2), np.sqrt(a2 + (1 - a2) * self.cos_o**2)
        below = self.cos_o * r_i + self.cos_i * r_o
        lobe = self.f * a2 / (np.pi * s**2) * 0.5 / below
        slope = self.cos_o * (1 - self.cos_i**2) / r_i + self.cos_i * (1 - self.cos_o**2) / r_o
        return lobe, lobe * (2 / alpha - 4 * alpha * self.cos_h**2 / s - alpha * slope / below)

    def residual(self, x):
        return (np.log1p(x[:3] / np.pi + x[3:6] * self._lobe(x[6])[0][:, None]) - self.target).ravel()

    def jacobian(self, x):
        lobe, slope = self._lobe(x[6])
        weight = 1 / (1 + x[:3] / np.pi + x[3:6] * lobe[:, None])
        rows = np.zeros((*weight.shape, 7))
        for c in range(3):
            rows[:, c, c] = weight[:, c] / np.pi
            rows[:, c, 3 + c] = weight[:, c] * lobe
        rows[:, :, 6] = weight * x[3:6] * slope[:, None]
        return rows.reshape(-1, 7)

    def fit(self, start, exact: bool):
        from scipy.optimize import least_squares

        jac = self.jacobian if exact else "2-point"
        return least_squares(self.residual, start, jac, bounds=(LOW, HIGH), x_scale="jac", method="trf")


def _starts() -> list[np.ndarray]:
    rng = np.random.default_rng(1)
    drawn = [np.r_[rng.random(6), 10 ** rng.uniform(-2, 0)] for _ in range(STARTS - 1)]
    return [np.r_[np.full(6, 0.5), 0.3], *drawn]


def together(samples: int) -> dict:
    """Fits in turn in one process: medians of CPU seconds, cost, and how many starts end at the best cost."""
    import jax

    compiling = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda name, seconds, **_: compiling.append(seconds) if name.startswith("/jax/core/compile/") else None
    )
    table, readings = _table(samples)
    clock = time.process_time
    began = clock()
    result = _ours(table)
    first, spent, scipy = clock() - began, sum(compiling), SciPy(readings)
    times, ends = {"gonio": [], "SciPy, differences": [], "SciPy, exact J": []}, {False: [], True: []}
    for k, start in enumerate(_starts() if samples else _starts()[:3]):
        for _ in range(2 if samples else 1):  # the other's fit emptied the caches: the second one is warm
            began = clock()
            result = _ours(table)
        times["gonio"].append(clock() - began)
        for exact in (False, True):
            # By differences, a full table takes long a start.
            if exact or samples or k < 1:
                if samples:
                    scipy.fit(start, exact)
                began = clock()
                ends[exact].append(scipy.fit(start, exact).cost)
                times["SciPy, exact J" if exact else "SciPy, differences"].append(clock() - began)
    rows = {"gonio": (statistics.median(times["gonio"]), result.cost, f"{result.starts_agreed} of {result.starts}")}
    for exact, name in ((False, "SciPy, differences"), (True, "SciPy, exact J")):
        best = min(ends[exact])
        agreed = sum(c <= best * (1 + 1e-6) for c in ends[exact])
        rows[name] = (statistics.median(times[name]), best, f"{agreed} of {len(ends[exact])}")
    return {"rows": rows, "first": first, "compiling": spent}


def alone(who: str, samples: int) -> dict:
    from gonio.data.formats.registry import read

    if who == "gonio":
        _ours(_table(samples)[0] if samples else read("t.binary"))
    else:
        SciPy(_table(samples)[1]).fit(_starts()[0], False)
    return {"peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024}


if __name__ == "__main__":
    words = sys.argv[1:]
    if words[:1] in (["together"], ["gonio"], ["SciPy"]):
        # One thread: what is handed from one processor to another costs both of them, and idle ones wait aloud.
        os.sched_setaffinity(0, list(os.sched_getaffinity(0))[:1])
    if words[:1] == ["make"]:
        make(words[1])
    elif words[:1] == ["together"]:
        print(json.dumps(together(int(words[1]))))
    elif words[:1] in (["gonio"], ["SciPy"]):
        print(json.dumps(alone(words[0], int(words[1]))))
    else:
        os.chdir(pathlib.Path(__file__).parent)
        main()

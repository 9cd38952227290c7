"""`gonio fit` and SciPy on the same MERL file, loss and bounds: whole processes, and the error of seven numbers.

Both fit log(1 + f) below 80°; gonio from three starts of the data and 20 random ones, SciPy from one.
"""

import pathlib
import statistics
import sys
import tempfile
import tomllib

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from support.process import gonio, python, timed

TRUTH = {"lambert.rho": [0.1, 0.2, 0.4], "ggx.scale": [1.0, 0.8, 0.6], "ggx.alpha": [0.2]}
SPELLING = "lambert(rho=[0.1, 0.2, 0.4]) + [1, 0.8, 0.6] * ggx(alpha=0.2, eta=1.5)"
REPEATS = 3


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        for command in (
            ["measure", SPELLING, "--scan", "merl", "-o", "t.h5"],
            ["convert", "t.h5", "t.binary"],
        ):
            done = timed(gonio() + command, folder)
            assert done.status == 0, done.output
        here = pathlib.Path(__file__).with_name("scipy_fit.py")
        print(f"{'':40} {'wall s':>8} {'cpu s':>8} {'peak MB':>8} {'starts':>8} {'worst relative error':>22}")
        for samples in (20_000, 0):
            name = f"{samples:,} samples" if samples else "full table"
            few = ["--samples", str(samples)] if samples else []
            fit = [
                "fit",
                "t.binary",
                "-m",
                "lambert + ggx(eta=1.5)",
                "--loss",
                "log1p",
                "--theta-max",
                "80",
                "--starts",
                "20",
            ]
            cold = timed(gonio() + fit + few + ["-o", "f.toml", "--force"], folder, GONIO_NO_CACHE="1")
            timed(gonio() + fit + few + ["-o", "f.toml", "--force"], folder)
            warm = [timed(gonio() + fit + few + ["-o", "f.toml", "--force"], folder) for _ in range(REPEATS)]
            error, agreed = gonio_error(pathlib.Path(folder, "f.toml"))
            line(f"gonio, {name}, no compiled code", [cold], agreed, error)
            line(f"gonio, {name}, cached code", warm, agreed, error)
            runs = [
                timed([*python(), str(here), "t.binary", str(samples)], folder)
                for _ in range(REPEATS if samples else 1)
            ]
            line(f"SciPy, {name}", runs, "1", scipy_error(runs[-1].output))


def line(name: str, runs: list, starts: str, error: float) -> None:
    wall, cpu, peak = (statistics.median(getattr(r, what) for r in runs) for what in ("wall", "cpu", "peak_mb"))
    print(f"{name:40} {wall:8.2f} {cpu:8.2f} {peak:8.0f} {starts:>8} {error:22.1e}")


def gonio_error(path: pathlib.Path) -> tuple[float, str]:
    fit = tomllib.loads(path.read_text())["fit"]
    worst = 0.0
    for name, truth in TRUTH.items():
        found = [p["value"] for p in fit["parameters"] if p["name"] == name and p["status"] != "fixed"]
        worst = max(worst, float(np.max(np.abs(np.array(found) / truth - 1))))
    return worst, f"{fit['starts_agreed']}/{fit['starts']}"


def scipy_error(output: str) -> float:
    found = np.array(output.split("numbers")[1].split(), float)
    truth = np.array([*TRUTH["lambert.rho"], *TRUTH["ggx.scale"], *TRUTH["ggx.alpha"]])
    return float(np.max(np.abs(found / truth - 1)))


if __name__ == "__main__":
    main()

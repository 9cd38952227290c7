"""Random surfaces through random instruments and all verbs: what fails, what is said of what is right, what is missed.

    python random_journeys.py [JOURNEYS] [SEED]     (20 0)

A journey measures a lawful surface (a diffuser and a lobe, scaled to an albedo below 1) in a random scan by a random
instrument, then runs the verbs that a user would. It is looked for

- a status other than 0, 1, 2 or 3 (a fault of gonio), and sentences of status 2, which are printed to be read;
- a check that fails the table, which is honest, or the fit of the true form;
- a fit of the true form whose numbers lie 5 standard uncertainties or more from the truth without a word: the verdict
  is good and no note is there.
"""

import collections
import contextlib
import io
import json
import os
import sys
import tempfile
import time

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

from gonio.cli.program import main as gonio  # noqa: E402
from gonio.models.albedo import directional_albedo  # noqa: E402
from gonio.models.expression.builder import build  # noqa: E402

THETA_I = np.radians(np.arange(0, 90, 10.0))
LOBES = {
    "ggx": ("alpha", "f0={f0:.3f}"), "beckmann": ("alpha", "f0={f0:.3f}"), "ward": ("alpha", ""), "phong": ("n", ""),
    "cook_torrance": ("alpha", "f0={f0:.3f}"), "blinn_phong": ("n", ""),
}  # fmt: skip
FAR = 5.0
FILES = ("t.csv", "t.binary", "t.bsdf", "t.astm", "t.ssdd", "t.brdf", "copy.h5")


def surface(rng: np.random.Generator) -> tuple[str, str, dict[str, float]]:
    """An expression, the form to be fitted, and the true values of its free numbers."""
    name = str(rng.choice(list(LOBES)))
    number, fixed = LOBES[name]
    fixed = fixed.format(f0=rng.uniform(0.03, 1))
    alpha = 10 ** rng.uniform(-1.3, -0.2)
    value = alpha if number == "alpha" else 2 / alpha**2
    rho, scale = rng.uniform(0.02, 0.9), 10 ** rng.uniform(-1.5, 0)
    inside = ", ".join(filter(None, [f"{number}={value:.6g}", fixed]))
    text = f"lambert(rho={{rho:.8g}}) + {{scale:.8g}} * {name}({inside})"
    greatest = float(np.max(directional_albedo(build(text.format(rho=rho, scale=scale)), THETA_I).value))
    share = min(1.0, rng.uniform(0.7, 0.995) / greatest)
    truth = {"lambert.rho": rho * share, f"{name}.{number}": value, f"{name}.scale": scale * share}
    return text.format(rho=rho * share, scale=scale * share), f"lambert + {name}({fixed})", truth


def scan(rng: np.random.Generator) -> list[str]:
    kind = str(rng.choice(["isotropic", "isotropic", "in-plane", "half-difference", "spherical"]))
    step = {"spherical": [20, 30], "in-plane": [1, 2, 5]}.get(kind, [7.5, 10, 15])
    return ["--scan", kind, "--step", str(rng.choice(step))]


def instrument(rng: np.random.Generator) -> list[str]:
    options = ["--photons", f"{10 ** rng.uniform(3, 8):.4g}", "--seed", str(rng.integers(1000))]
    for option, most, chance in (
        ("--detector-half-angle", 2.0, 0.5), ("--source-half-angle", 1.0, 0.2), ("--dark", 20.0, 0.3),
        ("--read-noise", 10.0, 0.2), ("--noise", 0.02, 0.3), ("--shadow", 8.0, 0.3), ("--ambient", 0.01, 0.2),
    ):  # fmt: skip
        if rng.random() < chance:
            options += [option, f"{most * rng.random():.4g}"]
    return options


def run(*arguments: str) -> tuple[int, str, str]:
    """The exit status of a command, and what it prints."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = gonio(list(arguments))
        except SystemExit as end:
            status = end.code
    return int(status or 0), out.getvalue(), err.getvalue()


def missed(truth: dict[str, float], printed: str) -> list[str]:
    """Numbers of a fit that lie far from the truth although it is called good and notes nothing."""
    result = json.loads(printed)
    said = [note for note in result["notes"] if "which nothing states" not in note]  # of errors that are none here
    if result["judgement"]["verdict"] != "good" or said:
        return []
    far = []
    for entry in result["parameters"]:
        name, value, u = entry["name"], entry["value"], entry["standard_uncertainty"]
        if name in truth and entry["status"] == "determined" and u and abs(value - truth[name]) > FAR * u:
            far.append(f"{name} {value:.6g} ± {u:.2g}, true {truth[name]:.6g}")
    return far


def journey(seed: int, number: int, counts: collections.Counter[str]) -> None:
    rng = np.random.default_rng([seed, number])
    expression, form, truth = surface(rng)
    command = ["measure", expression, "-o", "t.h5", *scan(rng), *instrument(rng)]
    print(f"{number}: gonio {' '.join(repr(a) if ' ' in a else a for a in command)}", flush=True)

    def step(*arguments: str) -> tuple[int, str]:
        began = time.process_time()
        status, out, err = run(*arguments)
        counts[f"{arguments[0]} {status}"] += 1
        if status not in (0, 1, 3):
            print(f"   status {status}: {' '.join(arguments)}: {err.strip()[-500:]}", flush=True)
        if time.process_time() - began > 60:
            print(f"   {time.process_time() - began:.0f} CPU s: {' '.join(arguments)}", flush=True)
        return status, out

    if step(*command)[0]:
        return
    step("info", "t.h5")
    status, out = step("check", "t.h5")
    if status == 1:
        counts["FALSE ALARM of a table"] += 1
        print("   FALSE ALARM:\n" + out, flush=True)
    status, out = step("fit", "t.h5", "-m", form, "-o", "f.toml", "--json")
    if out and (far := missed(truth, out)):
        counts["MISSED by a good fit"] += 1
        print(f"   MISSED: {form}: {'; '.join(far)}", flush=True)
    if os.path.exists("f.toml"):
        status, out = step("check", "f.toml")
        if status == 1 and sum(v for k, v in truth.items() if "rho" in k) < 0.9:
            print("   the fit fails its check:\n" + out, flush=True)
        step("quantities", "f.toml")
    step("fit", "t.h5", "-o", "auto.toml")
    step("quantities", "t.h5")
    for file in rng.choice(FILES, 2, replace=False):
        if not step("convert", "t.h5", str(file))[0]:
            step("check", str(file))
    if number % 5 == 0:
        step("report", "t.h5", "-o", "page.html")


def main(journeys: int, seed: int) -> None:
    counts: collections.Counter[str] = collections.Counter()
    for number in range(journeys):
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            journey(seed, number, counts)
    print(dict(sorted(counts.items())))


if __name__ == "__main__":
    main(*(int(a) for a in [*sys.argv[1:], *("20", "0")[len(sys.argv) - 1 :]]))

"""Seconds of a fit against its number of channels, beside its accuracy.

python many_channels.py [MODEL] [CELLS] [CHANNELS...]     ("lambert + ggx", 12, 3 to 401, unless given; "" selects one)

The truth is a coloured paint, 1 % of noise: 12 geometries as a spectrophotometer has, or a grid of about so many cells.
`first`: the first fit of so many channels in this process, with the `programs` that were compiled for it; `warm`: the
same fit again, and the processor seconds of all its threads, which tell more on a busy machine. `off`: largest
difference from the truth in standard uncertainties, and its rms. `alone`: largest difference from fits of single
channels with the joint shape held, in standard uncertainties.
"""

import os
import resource
import sys
import time

import jax
import numpy as np

import gonio
from gonio.data import layouts
from gonio.data.table import Channels, Table, whole_table_of_values
from gonio.fitting.result import FitResult
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

MODEL, ALPHA, NOISE = "lambert + ggx", 0.25, 0.01
CHANNELS = (3, 9, 21, 41, 81, 161, 401)
GEOMETRIES = [(45, 20, p) for p in (0, 22.5, 45, 67.5, 90, 112.5, 157.5, 180)]
GEOMETRIES += [(15, 0, 0), (45, 30, 180), (45, 0, 0), (65, 15, 180)]
COMPARED = 4  # channels that are fitted alone


def paint(channels: int) -> dict[str, np.ndarray]:
    """Albedo and strength of the highlight in each channel."""
    x = np.linspace(0, 1, channels)
    return {"rho": 0.05 + 0.5 * np.exp(-(((x - 0.4) / 0.2) ** 2)), "scale": 0.1 + 0.5 * x * (1 - 0.6 * x)}


def table_of(cells: int, channels: int) -> Table:
    """The paint read at 12 geometries, or on a grid."""
    rng, colour = np.random.default_rng(0), Channels.of_wavelengths(np.linspace(380, 780, channels).tolist())
    lists = {name: "[" + ", ".join(map(repr, v.tolist())) + "]" for name, v in paint(channels).items()}
    truth = build(f"lambert(rho={lists['rho']}) + {lists['scale']} * ggx(alpha={ALPHA})")
    if cells <= len(GEOMETRIES):
        theta_i, theta_o, phi = np.radians(GEOMETRIES[:cells]).T
        layout = layouts.scattered(theta_i, np.zeros_like(phi), theta_o, phi)
    else:
        side = max(2, round((cells / 2) ** (1 / 3)))
        polar = np.radians(np.linspace(0, 85, side))
        layout = layouts.isotropic(
            polar, polar, np.radians(np.linspace(0, 360, round(cells / side**2), endpoint=False))
        )
    f = np.asarray(evaluate(truth, *layout.directions())).reshape(*layout.shape, channels)
    return whole_table_of_values(layout, f * (1 + NOISE * rng.standard_normal(f.shape)), colour, name="paint")


def off_truth(r: FitResult) -> tuple[float, float]:
    """(largest, rms) difference of the free numbers from the truth, in standard uncertainties."""
    truth = {"lambert.rho": paint(len(r.channels))["rho"], "ggx.scale": paint(len(r.channels))["scale"]}
    at = {name: k for k, name in enumerate(r.channels.names)}
    z = [
        (p.value - (ALPHA if p.channel is None else truth[p.name][at[p.channel]])) / p.standard_uncertainty
        for p in r.parameters
        if p.status != "fixed" and (p.name in truth or p.name == "ggx.alpha")
    ]
    return float(np.max(np.abs(z))), float(np.sqrt(np.mean(np.square(z))))


def off_alone(table: Table, r: FitResult) -> float:
    """Largest difference of some channels' numbers from those of fits of that channel alone, shapes held."""
    values = {p.label: p for p in r.parameters}
    alone, worst = MODEL.replace("ggx", f"ggx(alpha={values['ggx.alpha'].value!r})"), 0.0
    for c in np.unique(np.linspace(0, len(r.channels) - 1, COMPARED).astype(int)):
        name = r.channels.names[c]
        for p in gonio.fit(table.only([name]), alone, loss="log1p").parameters:
            if p.status != "fixed":
                joint = values[f"{p.name}[{name}]"]
                worst = max(worst, abs(p.value - joint.value) / joint.standard_uncertainty)
    return worst


def main(model: str | None, cells: int, counts: list[int]) -> None:
    jax.config.update("jax_enable_x64", True)
    compiled: list[str] = []

    def noted(event: str, *_: float, **__: object) -> None:
        if event == "/jax/core/compile/backend_compile_duration":
            compiled.append(event)

    jax.monitoring.register_event_duration_secs_listener(noted)
    print("    cells channels   first    warm     cpu  programs  relative rms   off: largest  rms    alone   peak MB")
    warm: list[float] = []
    for channels in counts:
        table, seconds = table_of(cells, channels), []
        compiled.clear()
        for _ in range(2):
            began, cpu = time.perf_counter(), time.process_time()
            r = gonio.fit(table, model)
            r.to_dict()
            seconds.append(time.perf_counter() - began)
        cpu, programs = time.process_time() - cpu, len(compiled)
        warm.append(cpu)
        off = alone = "–"
        if model == MODEL:
            off = "{:9.2f} {:8.2f}".format(*off_truth(r))
            if channels > 1 and cells <= 1000:
                alone = f"{off_alone(table, gonio.fit(table, model, loss='log1p')):.1e}"
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(
            f"{table.layout.size:9d} {channels:8d} {seconds[0]:7.2f} {seconds[1]:7.3f} {cpu:7.3f} {programs:9d} "
            f"{r.metrics['relative_rms']:13.4f}  {off:>18s} {alone:>9s} {peak:8.0f}   "
            f"{'converged' if r.converged else 'NOT converged'}: {r.requested}",
            flush=True,
        )
    if len(counts) > 1:
        slope = np.polyfit(np.log(counts), np.log(warm), 1)[0]
        steepest = np.max(np.diff(np.log(warm)) / np.diff(np.log(counts)))
        print(f"slope of log(cpu) by log(channels): {slope:.2f}; steepest between two rows: {steepest:.2f}")
        print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")


if __name__ == "__main__":
    arguments = sys.argv[1:]
    chosen = arguments[0] if arguments else MODEL
    main(
        chosen or None, int(arguments[1]) if len(arguments) > 1 else 12, [int(a) for a in arguments[2:]] or [*CHANNELS]
    )

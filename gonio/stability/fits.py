"""Fits of every model to tables of itself: right within five standard uncertainties, or it says what is not known."""

from typing import Any

import numpy as np

from gonio.data import layouts
from gonio.data.table import Table, whole_table_of_values
from gonio.fitting.fit_table import fit
from gonio.fitting.result import FitResult
from gonio.models.catalog import MODELS
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.expression.parser import Call, needed, submodels_of
from gonio.models.parameters import parameters_of
from gonio.stability.outcome import HARD, RIGHT, SAYS_SO, SILENT, Cell
from gonio.stability.problems import RECOVERIES, tagged, true_numbers

FREE_SCALE = 0.7
SIGMAS = 5.0
CLOSE = 1e-5
"""Relative error of a number that a fit without noise may have."""

REGIMES = {
    "2000 samples, no noise": (2000, 0.0),
    "2000 samples, 1 % noise": (2000, 0.01),
    "2000 samples, 10 % noise": (2000, 0.1),
    "60 samples, 1 % noise": (60, 0.01),
}


def true_surface(name: str) -> str:
    """An expression of a model with every free parameter at its usual value."""
    known = parameters_of(MODELS[name])
    arguments = [f"{m}=lambert(rho=0.6)" for m in submodels_of(MODELS[name])]
    arguments += [f"{n}={known[n].start:g}" for n in needed(Call(name, {}, {}))]
    scale = f"{FREE_SCALE} * " if MODELS[name].lobe else ""
    return f"{scale}{name}({', '.join(arguments)})"


def fitted_model(name: str) -> str:
    """The expression that frees all of these parameters."""
    inside = ", ".join(f"{m}=lambert" for m in submodels_of(MODELS[name]))
    return f"{name}({inside})" if inside else name


def readings(
    truth: str, count: int, noise: float, theta_max: float = 85.0, spikes: float = 0.0, seed: int = 0
) -> Table:
    """Scattered readings of an expression: towards the mirror, back to the light, and everywhere.

    Args:
        truth: an expression of one channel.
        count: number of readings.
        noise: standard uncertainty as a share of f; readings without noise have none.
        theta_max: largest polar angle, degrees.
        spikes: share of readings that are 100 times too large.
        seed: of the random numbers.
    """
    rng = np.random.default_rng(seed)
    top = np.radians(theta_max)
    theta_i, phi_i = top * np.sqrt(rng.random(count)), rng.uniform(0, 2 * np.pi, count)
    kind = rng.random(count)
    away = np.where(kind < 0.45, np.pi, 0.0)
    spread = np.where(rng.random(count) < 0.5, 0.05, 0.3)
    theta_o = np.abs(theta_i + spread * rng.normal(size=count))
    phi_o = phi_i + away + spread * rng.normal(size=count)
    everywhere = kind > 0.6
    theta_o = np.where(everywhere, top * np.sqrt(rng.random(count)), theta_o)
    phi_o = np.where(everywhere, rng.uniform(0, 2 * np.pi, count), phi_o)
    theta_o = np.minimum(theta_o, top)
    grid = layouts.scattered(theta_i, phi_i, theta_o, np.mod(phi_o, 2 * np.pi))
    f = np.asarray(evaluate(build(truth), *grid.directions()), float)
    # Nothing but the noise is unknown here: that a calibration is not stated would be a remark on every fit.
    exact: dict[str, Any] = {"provenance": {"instrument": "ideal"}}
    if not noise:
        return whole_table_of_values(grid, f[:, None], name="no noise", **exact)
    sigma = noise * np.maximum(np.abs(f), 1e-3 * np.median(np.abs(f)) + 1e-6)
    read = f + sigma * rng.normal(size=count)
    read = np.where(rng.random(count) < spikes, 100 * read, read)
    return whole_table_of_values(grid, read[:, None], u_f=sigma[:, None], name=f"{noise:g} noise", **exact)


NOISY = "2000 samples, 1 % noise", "2000 samples, 10 % noise", "60 samples, 1 % noise"
"""The regimes of a quick atlas: fits without noise are compiled anew."""


def fit_cells(name: str, quick: bool = False) -> list[Cell]:
    """One cell for each number of samples and noise."""
    truth, model = true_surface(name), fitted_model(name)
    return [
        _cell(name, truth, model, column, readings(truth, *regime, seed=seed))
        for seed, (column, regime) in enumerate(REGIMES.items())
        if column in NOISY or not quick
    ]


def hard_cells(quick: bool = False) -> list[Cell]:
    """One cell for each fit that is known to be hard, of sums that have more than one answer or hardly any."""
    return [
        _cell(
            HARD, h.measured, h.model, f"{h.name}, {noise * 100:g} % noise",
            readings(h.measured, 2000, noise, h.theta_max, h.spikes),
        )
        for h in tagged(RECOVERIES, "quick atlas" if quick else "atlas")
        for noise in (0.0, 0.01)
        if (noise or not h.spikes) and not (quick and not noise)
    ]  # fmt: skip


def _cell(name: str, truth: str, model: str, column: str, table: Table) -> Cell:
    row = f"{truth} as {model}"
    try:
        result = fit(table, model)
    except GonioError as error:
        return Cell("fit", name, row, column, "float64", SAYS_SO, float("inf"), 0.0, f"refused: {error}")
    error, allowed, parameter = _worst_parameter(result, true_numbers(truth))
    remarks = [f"{p.name} undetermined" for p in result.parameters if p.status == "undetermined"]
    remarks += [f"{p.name} {p.status}" for p in result.parameters if p.status.startswith("at ")]
    remarks += ["not converged"] * (not result.converged) + result.undetermined + result.notes
    verdict = SAYS_SO if remarks else RIGHT if error <= allowed else SILENT
    detail = (
        f"worst number {parameter}: off by {error:.2g} of itself, {SIGMAS:g} standard uncertainties are {allowed:.2g}; "
        f"{result.starts_agreed} of {result.starts} starts agree"
    )
    if remarks:
        detail += f"; it says: {'; '.join(dict.fromkeys(remarks))}"
    return Cell("fit", name, row, column, "float64", verdict, error, allowed, detail)


def _worst_parameter(result: FitResult, truth: dict[str, float]) -> tuple[float, float, str]:
    # (error, allowed, name) of the determined parameter whose error is largest beside what its uncertainty allows.
    worst = 0.0, CLOSE, "every number"
    for p in result.parameters:
        if p.status not in ("fixed", "undetermined"):
            size = max(abs(truth[p.name]), 1e-3)
            error, allowed = abs(p.value - truth[p.name]) / size, max(CLOSE, SIGMAS * p.standard_uncertainty / size)
            if error / allowed > worst[0] / worst[1]:
                worst = error, allowed, p.name
    return worst

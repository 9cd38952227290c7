"""Fits of every model to tables of itself: right within five standard uncertainties, or it says what is not known."""

import numpy as np

from gonio.data import layouts
from gonio.data.table import Table, whole_table_of_values
from gonio.fitting.fit_table import fit
from gonio.models.catalog import MODELS
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.expression.parser import Call, needed, submodels_of
from gonio.models.parameters import parameters_of
from gonio.stability.outcome import RIGHT, SAYS_SO, SILENT, Cell
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


def truth_of(name: str) -> str:
    """An expression of a model with every number that a fit has to find, at its usual value."""
    known = parameters_of(MODELS[name])
    said = [f"{m}=lambert(rho=0.6)" for m in submodels_of(MODELS[name])]
    said += [f"{n}={known[n].start:g}" for n in needed(Call(name, {}, {}))]
    scale = f"{FREE_SCALE} * " if MODELS[name].lobe else ""
    return f"{scale}{name}({', '.join(said)})"


def asked_of(name: str) -> str:
    """What a fit is asked that finds all of them."""
    inside = ", ".join(f"{m}=lambert" for m in submodels_of(MODELS[name]))
    return f"{name}({inside})" if inside else name


def readings(
    truth: str, count: int, noise: float, theta_max: float = 85.0, spikes: float = 0.0, seed: int = 0
) -> Table:
    """Scattered readings of a spelled model: towards the mirror, back to the light, and everywhere."""
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
    if not noise:
        return whole_table_of_values(grid, f[:, None], name="no noise")
    sigma = noise * np.maximum(np.abs(f), 1e-3 * np.median(np.abs(f)) + 1e-6)
    read = f + sigma * rng.normal(size=count)
    read = np.where(rng.random(count) < spikes, 100 * read, read)
    return whole_table_of_values(grid, read[:, None], u_f=sigma[:, None], name=f"{noise:g} noise")


NOISY = "2000 samples, 1 % noise", "2000 samples, 10 % noise", "60 samples, 1 % noise"
"""The regimes of a quick atlas: fits without noise are compiled anew."""


def fit_cells(name: str, quick: bool = False) -> list[Cell]:
    """One cell for each number of samples and noise."""
    truth, asked = truth_of(name), asked_of(name)
    return [
        _cell(name, truth, asked, column, readings(truth, *regime, seed=seed))
        for seed, (column, regime) in enumerate(REGIMES.items())
        if column in NOISY or not quick
    ]


def hard_cells(quick: bool = False) -> list[Cell]:
    """One cell for each fit that is known to be hard, of sums that have more than one answer or hardly any."""
    return [
        _cell(
            "hard fits", h.measured, h.model, f"{h.name}, {noise * 100:g} % noise",
            readings(h.measured, 2000, noise, h.theta_max, h.spikes),
        )
        for h in tagged(RECOVERIES, "quick atlas" if quick else "atlas")
        for noise in (0.0, 0.01)
        if (noise or not h.spikes) and not (quick and not noise)
    ]  # fmt: skip


def _cell(name: str, truth: str, asked: str, column: str, table: Table) -> Cell:
    row = f"{truth} as {asked}"
    try:
        result = fit(table, asked)
    except GonioError as error:
        return Cell("fit", name, row, column, "float64", SAYS_SO, float("inf"), 0.0, f"refused: {error}")
    actual = true_numbers(truth)
    worst, allowed, at = 0.0, CLOSE, "every number"
    flagged = []
    for p in result.parameters:
        if p.status == "fixed":
            continue
        if p.status == "undetermined":
            flagged.append(f"{p.name} undetermined")
            continue
        if p.status.startswith("at "):
            flagged.append(f"{p.name} {p.status}")
        size = max(abs(actual[p.name]), 1e-3)
        error, may = abs(p.value - actual[p.name]) / size, max(CLOSE, SIGMAS * p.standard_uncertainty / size)
        if error / may > worst / allowed:
            worst, allowed, at = error, may, p.name
    flagged += ["not converged"] * (not result.converged) + result.undetermined + result.notes
    verdict = RIGHT if worst <= allowed and not flagged else (SAYS_SO if flagged else SILENT)
    said = f"; it says: {'; '.join(dict.fromkeys(flagged))}" if flagged else ""
    detail = (
        f"worst number {at}: off by {worst:.2g} of itself, {SIGMAS:g} standard uncertainties are {allowed:.2g}; "
        f"{result.starts_agreed} of {result.starts} starts agree{said}"
    )
    return Cell("fit", name, row, column, "float64", verdict, worst, allowed, detail)

"""The whole atlas: which cells there are, done model by model in several processes, as they are ready."""

import multiprocessing
import os
import sys
from collections.abc import Iterator

from gonio.atlas.cell import SAYS_SO, Cell
from gonio.atlas.precision import PRECISIONS

QUICK = ("lambert", "eon", "ggx", "beckmann", "phong", "ward")
"""Six models that stand for the others: diffuse, rough diffuse, power tails, Gaussian tails, mirror lobe, unbounded."""

QUICK_SETTINGS = 4
SAMPLES = 1_000_000
QUICK_SAMPLES = 200_000
MOST = {
    ("gradient", "float32"): 4,
    ("sampler", "float64"): 3,
    ("sampler", "float32"): 1,
    ("integral", "float64"): 5,
}
"""How many settings, spread over those there are, the dearer methods look at; the others look at all."""

HARD = "hard fits"


def jobs(models: tuple[str, ...], quick: bool) -> list[tuple[str, str]]:
    """(model, method) of what there is to do, the longest first."""
    found = [(m, method) for method in ("gradient", "value", "fit", "sampler", "integral") for m in models]
    return [*found, (HARD, "fit")] if len(models) > 1 else found


def tests_of(models: tuple[str, ...], quick: bool) -> int:
    """How many χ² tests a run makes, for the level of each."""
    from gonio.atlas.samplers import INCIDENCES

    return sum(len(chosen(m, "sampler", p, quick)) for m in models for p in PRECISIONS) * len(INCIDENCES)


def chosen(name: str, method: str, precision: str, quick: bool) -> list[str]:
    """The settings of a model that a method looks at, spread over those there are."""
    from gonio.atlas.settings import settings_of

    found = settings_of(name)
    most = min(MOST.get((method, precision), len(found)), QUICK_SETTINGS if quick else len(found))
    return [found[k] for k in sorted({round(i * (len(found) - 1) / max(most - 1, 1)) for i in range(most)})]


def do(job: tuple[str, str], quick: bool, tests: int) -> list[Cell]:
    """All cells of one method of one model."""
    name, method = job
    if method == "value" or method == "gradient":
        from gonio.atlas.values import gradient_cells, value_cells

        cells = value_cells if method == "value" else gradient_cells
        return [c for p in PRECISIONS for s in chosen(name, method, p, quick) for c in cells(name, s, p)]
    if method == "sampler":
        from gonio.atlas.samplers import sampler_cells

        number = QUICK_SAMPLES if quick else SAMPLES
        every = [(s, p) for p in PRECISIONS for s in chosen(name, method, p, quick)]
        return [c for s, p in every for c in sampler_cells(name, s, p, number, tests)]
    if method == "integral":
        from gonio.atlas.integrals import integral_cells

        return [c for s in chosen(name, method, "float64", quick) for c in integral_cells(name, s)]
    from gonio.atlas.fits import fit_cells, hard_cells

    return hard_cells() if name == HARD else fit_cells(name)


def _start() -> None:
    # Each process keeps to one core, and shares the compiled programs on disk with the others.
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")


def _do(task) -> tuple[tuple[str, str], list[Cell]]:
    job, quick, tests = task
    try:
        return job, do(job, quick, tests)
    except Exception as error:  # one method that raises is a finding, and no reason to lose the others
        said = f"raised {type(error).__name__}: {error}"
        return job, [Cell(job[1], job[0], "every setting", "every regime", "", SAYS_SO, float("inf"), 0.0, said)]


def atlas(models: tuple[str, ...], quick: bool, processes: int | None = None) -> Iterator[tuple[tuple[str, str], list]]:
    """(job, its cells) as they are done; in this process where there is one model or one processor."""
    todo, tests = jobs(models, quick), tests_of(models, quick)
    tasks = [(job, quick, tests) for job in todo]
    count = processes or min(len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1, 8)
    if count == 1:
        yield from map(_do, tasks)
        return
    with multiprocessing.get_context("spawn").Pool(count, _start) as pool:
        yield from pool.imap_unordered(_do, tasks)

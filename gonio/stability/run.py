"""The cells of the atlas, computed model by model in several processes, as they are ready."""

import concurrent.futures as futures
import functools
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator

from gonio.models.errors import GonioError
from gonio.models.subsurface.catalog import BSSRDFS
from gonio.stability.outcome import HARD, SAYS_SO, SILENT, Cell
from gonio.stability.precision import PRECISIONS

QUICK = ("lambert", "eon", "ggx", "beckmann", "phong", "ward")
"""Six models that stand for the others: diffuse, rough diffuse, power tails, Gaussian tails, mirror lobe, unbounded."""

QUICK_SETTINGS = 3
SAMPLES, QUICK_SAMPLES = 1_000_000, 200_000
MOST = {("gradient", "float32"): 4, ("sampler", "float64"): 3, ("sampler", "float32"): 1, ("integral", "float64"): 5}
"""Number of settings, spread over all, that the dearer methods are applied to; the others are applied to all."""

Job = tuple[str, str]
"""A model and a method."""


def jobs(models: tuple[str, ...]) -> list[Job]:
    """The jobs of an atlas of these models, the longest first."""
    methods = ("gradient", "value", "fit", "integral", "sampler")
    # Light below the surface is drawn by no method.
    every = [(m, method) for method in methods for m in models if not (m in BSSRDFS and method == "sampler")]
    return [(HARD, "fit"), *every] if len(models) > 1 else every


def settings_for(name: str, method: str, precision: str, quick: bool) -> list[str]:
    """The settings of a model that a method is applied to, spread over all."""
    from gonio.stability.cases import settings_of

    # Bounces given back are looked up in tables, whose textbook integrals take as long as all other settings.
    settings = [s for s in settings_of(name) if not (quick and "energy=" in s)]
    most = min(MOST.get((method, precision), len(settings)), QUICK_SETTINGS if quick else len(settings))
    return [settings[k] for k in sorted({round(i * (len(settings) - 1) / max(most - 1, 1)) for i in range(most)})]


def cells_of(job: Job, quick: bool, key: str = "") -> list[Cell]:
    """All cells of one method of one model; with a cell's key, those of the setting that the key names."""
    name, method = job
    if name in BSSRDFS:
        return _profile_cells(job, quick, key)
    if method == "fit":
        from gonio.stability.fits import fit_cells, hard_cells

        return _guarded(job, "every number", "", lambda: hard_cells(quick) if name == HARD else fit_cells(name, quick))
    compute = _method(name, method, quick)
    cells = []
    for precision in ("float64",) if method == "integral" else PRECISIONS:
        for setting in settings_for(name, method, precision, quick):
            if key.startswith(f"{method}/{setting}/") or not key:
                cells += _guarded(job, setting, precision, lambda s=setting, p=precision: compute(name, s, p))
    return cells


def _profile_cells(job: Job, quick: bool, key: str) -> list[Cell]:
    """`cells_of` of a model of light below the surface."""
    from gonio.stability import profiles

    name, method = job
    if method == "fit":
        return _guarded(job, "both coefficients", "", lambda: profiles.fit_cells(name))
    cells = []
    for precision in ("float64",) if method == "integral" else PRECISIONS:
        for setting in profiles.settings(name)[:: 3 if quick else 1]:
            if key.startswith(f"{method}/{setting}/") or not key:
                compute = functools.partial(profiles.cells, method, name, setting, precision)
                cells += _guarded(job, setting, precision, compute)
    return cells


def _method(name: str, method: str, quick: bool) -> Callable[[str, str, str], list[Cell]]:
    if method == "sampler":
        from gonio.stability.samplers import sampler_cells

        return lambda name, setting, precision: sampler_cells(
            name, setting, precision, QUICK_SAMPLES if quick else SAMPLES
        )
    if method == "integral":
        from gonio.stability.albedos import integral_cells

        return integral_cells
    from gonio.stability.textbook import TEXTBOOK

    if name not in TEXTBOOK:
        from gonio.stability.laws import law_cells

        return functools.partial(law_cells, method)
    from gonio.stability.values_and_gradients import gradient_cells, value_cells

    return value_cells if method == "value" else gradient_cells


def _guarded(job: Job, setting: str, precision: str, compute: Callable[[], list[Cell]]) -> list[Cell]:
    # A setting that is refused by name says so; any other exception is a silent failure.
    try:
        return compute()
    except GonioError as error:
        verdict, detail = SAYS_SO, f"refused: {error}"
    except MemoryError:
        raise
    except Exception as error:
        verdict, detail = SILENT, f"crashed with {type(error).__name__}: {error}"
    return [Cell(job[1], job[0], setting, "every regime", precision, verdict, float("inf"), 0.0, detail)]


def start_worker() -> None:
    """Keeps a process to one core, leaves Ctrl-C to its parent, and ends it when its parent has ended, however."""
    os.environ["XLA_FLAGS"] = (
        os.environ.get("XLA_FLAGS", "") + " --xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    )
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def atlas(models: tuple[str, ...], quick: bool, processes: int | None = None) -> Iterator[tuple[Job, list[Cell]]]:
    """(job, its cells) as they are ready; in this process where there is one processor.

    Raises:
        GonioError: a process was killed, and its cells are lost.
    """
    count = processes or min(len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1, 8)
    if count == 1:
        yield from ((job, cells_of(job, quick)) for job in jobs(models))
        return
    pool = futures.ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), start_worker)
    try:
        job_of = {pool.submit(cells_of, job, quick): job for job in jobs(models)}
        for ready in futures.as_completed(job_of):
            yield job_of[ready], ready.result()
    except futures.process.BrokenProcessPool:
        raise GonioError(
            "A process of the atlas was killed (for memory, perhaps); nothing was written: try --processes 1"
        ) from None
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in multiprocessing.active_children():
            process.terminate()

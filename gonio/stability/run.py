"""The whole atlas: which cells there are, done model by model in several processes, as they are ready."""

import concurrent.futures as futures
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator

from gonio.models.errors import GonioError
from gonio.stability.outcome import SAYS_SO, SILENT, Cell
from gonio.stability.precision import PRECISIONS

QUICK = ("lambert", "eon", "ggx", "beckmann", "phong", "ward")
"""Six models that stand for the others: diffuse, rough diffuse, power tails, Gaussian tails, mirror lobe, unbounded."""

QUICK_SETTINGS = 3
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


def jobs(models: tuple[str, ...]) -> list[tuple[str, str]]:
    """(model, method) of what there is to do, the longest first."""
    found = [(m, method) for method in ("gradient", "value", "fit", "integral", "sampler") for m in models]
    return [(HARD, "fit"), *found] if len(models) > 1 else found


def chosen(name: str, method: str, precision: str, quick: bool) -> list[str]:
    """The settings of a model that a method looks at, spread over those there are."""
    from gonio.stability.cases import settings_of

    # Bounces given back are looked up in tables, whose textbook integrals take as long as all other settings.
    found = [s for s in settings_of(name) if not (quick and "energy=" in s)]
    most = min(MOST.get((method, precision), len(found)), QUICK_SETTINGS if quick else len(found))
    return [found[k] for k in sorted({round(i * (len(found) - 1) / max(most - 1, 1)) for i in range(most)})]


def do(job: tuple[str, str], quick: bool, key: str = "") -> list[Cell]:
    """All cells of one method of one model; of the one setting that a cell's key names, where a key is given."""
    name, method = job
    if method == "fit":
        from gonio.stability.fits import fit_cells, hard_cells

        return _guarded(job, "every number", "", lambda: hard_cells(quick) if name == HARD else fit_cells(name, quick))
    kinds = _kinds(quick)[method]
    found = []
    for precision, cells in kinds.items():
        for setting in chosen(name, method, precision, quick):
            if key.startswith(f"{method}/{setting}/") or not key:
                found += _guarded(job, setting, precision, lambda c=cells, s=setting, p=precision: c(name, s, p))
    return found


def _kinds(quick: bool) -> dict[str, dict]:
    from gonio.stability.albedos import integral_cells
    from gonio.stability.samplers import sampler_cells
    from gonio.stability.values_and_gradients import gradient_cells, value_cells

    def drawn(name, setting, precision):
        return sampler_cells(name, setting, precision, QUICK_SAMPLES if quick else SAMPLES)

    every = {"value": value_cells, "gradient": gradient_cells, "sampler": drawn}
    return {m: dict.fromkeys(PRECISIONS, c) for m, c in every.items()} | {"integral": {"float64": integral_cells}}


def _guarded(job: tuple[str, str], setting: str, precision: str, cells) -> list[Cell]:
    # A setting that is refused by name says so; any other exception is a failure that nobody was told of.
    try:
        return cells()
    except GonioError as error:
        verdict, said = SAYS_SO, f"refused: {error}"
    except MemoryError:
        raise
    except Exception as error:
        verdict, said = SILENT, f"crashed with {type(error).__name__}: {error}"
    return [Cell(job[1], job[0], setting, "every regime", precision, verdict, float("inf"), 0.0, said)]


def _start() -> None:
    # Each process keeps to one core, leaves Ctrl-C to its parent, and ends when its parent has, however that ended.
    os.environ["XLA_FLAGS"] = (
        os.environ.get("XLA_FLAGS", "") + " --xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    )
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    multiprocessing.parent_process().join()
    os._exit(1)


def atlas(models: tuple[str, ...], quick: bool, processes: int | None = None) -> Iterator[tuple[tuple[str, str], list]]:
    """(job, its cells) as they are done; in this process where there is one processor.

    Raises GonioError where a process was killed: what it did cannot be known.
    """
    count = processes or min(len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1, 8)
    if count == 1:
        yield from ((job, do(job, quick)) for job in jobs(models))
        return
    context = multiprocessing.get_context("spawn")
    pool = futures.ProcessPoolExecutor(count, context, _start)
    try:
        asked = {pool.submit(do, job, quick): job for job in jobs(models)}
        for done in futures.as_completed(asked):
            yield asked[done], done.result()
    except futures.process.BrokenProcessPool:
        raise GonioError(
            "A process of the atlas was killed (for memory, perhaps); nothing was written: try --processes 1"
        ) from None
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in multiprocessing.active_children():
            process.terminate()

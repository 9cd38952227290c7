"""Many tables, one model: the same compiled programs fit one table after another, on every processor at once."""

import functools
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, as_completed
from typing import Unpack

from gonio.data.subject import SubjectLike
from gonio.data.table import Table
from gonio.fitting.fit_table import fit
from gonio.fitting.options import FitOptions
from gonio.fitting.result import FitResult
from gonio.models.errors import GonioError

Source = SubjectLike | Callable[[], Table]


def fit_many(
    tables: Sequence[Source],
    model: str | list[str] | None = None,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    done: Callable[[int, FitResult | GonioError], None] | None = None,
    **options: Unpack[FitOptions],
) -> list[FitResult | GonioError]:
    """Fits of many tables, on all processors; each result is what `gonio.fit` alone would give.

    Args:
        tables: tables, files, or functions that return a table; the latter two are read when their turn comes, so that
            no more than `workers` tables are in memory at a time.
        model: as of `gonio.fit`.
        workers: number of threads; by default one for each processor.
        executor: what does the fits in place of these threads, in the precision of this process; a Dask client's is
            ``client.get_executor()``. Tables and results then go from process to process, files are read there.
        done: called with the index and the outcome of each table as soon as it is fitted.
        options: those of `gonio.fit`.

    Returns:
        Results in the tables' order, and a GonioError in the place of a table that was refused.

    Raises:
        GonioError: no tables, or `workers` below 1.
    """
    outcomes: dict[int, FitResult | GonioError] = {}
    for index, outcome in as_fitted(tables, model, workers=workers, executor=executor, **options):
        outcomes[index] = outcome
        if done is not None:
            done(index, outcome)
    return [outcomes[k] for k in range(len(tables))]


def as_fitted(
    tables: Sequence[Source],
    model: str | list[str] | None = None,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    **options: Unpack[FitOptions],
) -> Iterator[tuple[int, FitResult | GonioError]]:
    """(index, outcome) of each table as soon as it is fitted; see `fit_many`."""
    if not len(tables):
        raise GonioError("No table came to fit; give at least one.")
    if executor is not None:
        if workers is not None:
            raise GonioError("workers are those of the executor; give one of both.")
        yield from _as_completed(executor, functools.partial(_in_precision, _has_float64()), tables, model, options)
        return
    if workers is None:
        workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if workers < 1:
        raise GonioError(f"workers is {workers}; expected 1 or more.")
    # The first one alone: it compiles what the others share.
    yield 0, _outcome(tables[0], model, options)
    with ThreadPoolExecutor(workers, "gonio-fit") as pool:
        for index, outcome in _as_completed(pool, _outcome, tables[1:], model, options):
            yield index + 1, outcome


def _as_completed(
    pool: Executor,
    outcome: Callable[[Source, str | list[str] | None, FitOptions], FitResult | GonioError],
    tables: Sequence[Source],
    model: str | list[str] | None,
    options: FitOptions,
) -> Iterator[tuple[int, FitResult | GonioError]]:
    """(index, outcome) of each table as soon as an executor has it; what was not begun is not, where this ends."""
    waiting: dict[Future[FitResult | GonioError], int] = {
        pool.submit(outcome, table, model, options): k for k, table in enumerate(tables)
    }
    try:
        for future in as_completed(list(waiting)):
            yield waiting.pop(future), future.result()
    finally:
        for future in waiting:
            future.cancel()


def _has_float64() -> bool:
    import jax.numpy as jnp

    return jnp.result_type(float) == jnp.dtype("float64")


def _in_precision(
    double: bool, table: Source, model: str | list[str] | None, options: FitOptions
) -> FitResult | GonioError:
    """`_outcome` in another process, in double or single precision as the one that asked for it."""
    import jax

    with jax.enable_x64(double):
        return _outcome(table, model, options)


def _outcome(table: Source, model: str | list[str] | None, options: FitOptions) -> FitResult | GonioError:
    try:
        return fit(table() if callable(table) else table, model, **options)
    except GonioError as error:
        return error

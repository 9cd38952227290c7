"""`campaign`: a recipe's tasks done by many processes, results one file each, and a catalogue of all."""

import contextlib
import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from gonio.campaigns.catalogue import write_catalogue
from gonio.campaigns.engine import Executor, Run, Tally
from gonio.campaigns.estimate import Estimate, estimate
from gonio.campaigns.executors import ThisProcess, dask_cluster
from gonio.campaigns.recipe import read_recipe
from gonio.campaigns.store import CATALOGUE, PART, RECORDS, Record, Store
from gonio.campaigns.tasks import Task, tasks_of
from gonio.models.deprecation import settings_of
from gonio.models.display import Displayed
from gonio.models.errors import GonioError, one_line

if TYPE_CHECKING:
    from pandas import DataFrame

RecipeLike = str | os.PathLike[str] | Mapping[str, Any]


class CampaignOptions(TypedDict, total=False):
    """Keywords of `gonio.campaign`; `help(gonio.campaign)` describes each."""

    workers: int | None
    scheduler: str | None
    part: tuple[int, int] | None
    retry: bool
    over: Callable[[Task, Record, int, int], None]


@dataclasses.dataclass(frozen=True)
class CampaignSettings:
    """The options of a campaign, complete and checked; see `gonio.campaign`."""

    workers: int | None = None
    scheduler: str | None = None
    part: tuple[int, int] | None = None
    retry: bool = False
    over: Callable[[Task, Record, int, int], None] = lambda task, record, done, count: None

    def __post_init__(self) -> None:
        if self.workers is not None and not 0 <= self.workers <= 1024:
            raise GonioError(f"workers is {self.workers}; give a number of processes, or 0 to work in this one alone")
        if self.scheduler is not None and self.workers is not None:
            raise GonioError("workers are those of the scheduler; give one of both")
        if self.part is not None and not 1 <= self.part[0] <= self.part[1]:
            k, n = self.part
            raise GonioError(f"part is {k} of {n}; give the first to the last part, such as 1/{max(n, 1)}")

    @contextlib.contextmanager
    def executor(self) -> Iterator[Executor]:
        """What does the tasks."""
        if self.workers == 0:
            yield ThisProcess()
            return
        usual = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        with dask_cluster(self.workers or usual, self.scheduler) as cluster:
            yield cluster


@dataclasses.dataclass(frozen=True, repr=False)
class Campaign(Displayed):
    """What became of a campaign's tasks: `tally` by kind, `worst` in sentences; the catalogue has a row for each."""

    name: str
    folder: Path
    tally: Tally
    worst: tuple[str, ...] = ()

    @property
    def exit_status(self) -> int:
        """0 where all is good, else 1."""
        return 0 if self.tally.all_good else 1

    def facts(self) -> dict[str, str]:
        """Counts by kind, and the worst."""
        counts = {name: getattr(self.tally, name) for name in ("done", "kept", "refused", "bad")}
        words = {name: ", ".join(f"{n} {kind}" for kind, n in c.items() if n) for name, c in counts.items()}
        return {"campaign": f"{self.name}, in {self.folder}", **words, "worst": "; ".join(self.worst)}

    def to_pandas(self) -> "DataFrame":
        """The catalogue, as pandas reads it."""
        import pandas

        return pandas.read_parquet(self.folder / CATALOGUE)


def campaign(recipe: RecipeLike, output: str | os.PathLike[str], **options: Unpack[CampaignOptions]) -> Campaign:
    """Does the tasks of a recipe that are not done yet, and writes the catalogue and the page of all.

    Each task is named by the digest of what determines its result: a killed campaign goes on, a changed recipe adds,
    and no number of workers, order or interruption changes a bit of a table, fit, check or reduction.

    Args:
        recipe: a TOML file (see `gonio.campaigns.recipe`), or a dictionary of the same entries.
        output: the folder of the results.
        workers: processes of this machine, by default one for each processor; 0 works in this process, without Dask.
        scheduler: address of a Dask scheduler, such as "tcp://host:8786", whose workers see the folder too.
        part: (k, n) does the k-th of n parts alone, k from 1; the catalogue is left to `catalogue`.
        retry: does again what was refused.
        over: called with each task that is over, its record, how many are over and how many there are.

    Raises:
        GonioError: the recipe is wrong, Dask is not installed, the scheduler is lost, the disk is full. What is done is
            kept.
    """
    settings = settings_of(CampaignSettings, "campaign", options)
    asked_for = read_recipe(recipe)
    every = tasks_of(asked_for)
    k, n = settings.part or (1, 1)
    tasks = every if n == 1 else tasks_of(asked_for, (k - 1, n))
    store = Store(Path(output).absolute())
    store.prepare()
    store.write_plan(asked_for.name, [task.key for task in every if task.kind != PART])

    def over(task: Task, record: Record) -> None:
        settings.over(task, record, len(run.ended) + 1, len(run.tasks))

    run = Run(tasks, store, over)
    run.keep(settings.retry)
    if run.ready:
        with settings.executor() as executor:
            run.work(executor)
    if settings.part is None:
        catalogue(store.folder)
    return Campaign(asked_for.name, store.folder, run.tally, worst_of(run))


def catalogue(folder: str | os.PathLike[str]) -> int:
    """Makes the catalogue and the page of a campaign's folder anew from its records; returns how many there are."""
    store = Store(Path(folder))
    if not (store.folder / RECORDS).is_dir():
        raise GonioError(
            f"{folder} is no folder of a campaign; give one that gonio campaign wrote, or a recipe (.toml)"
        )
    from gonio.campaigns.page import write_page

    rows = write_catalogue(store)
    write_page(store, rows)
    return len(rows)


def dry_run(recipe: RecipeLike, output: str | os.PathLike[str]) -> tuple[str, Estimate]:
    """(name of the recipe, what it takes), without doing anything."""
    asked_for = read_recipe(recipe)
    return asked_for.name, estimate(asked_for, tasks_of(asked_for), Store(Path(output)))


MOST_WORST = 10


def worst_of(run: Run) -> tuple[str, ...]:
    """Sentences about what a user must look after, one for each kind of work on each material, with their number.

    What was not done goes before what was refused, and that before failed fits and checks.
    """
    groups: dict[tuple[Any, ...], list[str]] = {}
    for name, why in run.tally.faults.items():
        groups.setdefault((0, why), []).append(f"{name}: {why}")
    if run.tally.refused.total() or run.tally.bad.total():
        for key, task in run.tasks.items():
            record = run.store.record(key)
            if record is not None and not record.good:
                why = record.error or record.row.get("sentence") or str(record.row.get("verdict"))
                group = (1 if record.error else 2, task.kind, task.labels["subject"], task.labels["model"])
                groups.setdefault(group, []).append(f"{task.name}: {why}")
    ranked = sorted(groups.items(), key=lambda item: (item[0][0], -len(item[1])))
    return tuple(one_line(s[0], 240) + f" (and {len(s) - 1} like it)" * (len(s) > 1) for _, s in ranked[:MOST_WORST])

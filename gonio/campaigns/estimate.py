"""What a campaign takes, before it is begun: tasks, hours on a real instrument, bytes, and seconds of computing."""

import dataclasses
import statistics
from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import Any

from gonio.campaigns.recipe import MeasureBlock, Recipe
from gonio.campaigns.store import DONE, PART, Store
from gonio.campaigns.table_parts import layout_of, scan_name
from gonio.campaigns.tasks import KINDS, Task
from gonio.data.layouts import Layout
from gonio.data.subject import load_material
from gonio.instrument.scans import listed_seconds

USUAL_SECONDS = {"part": 2.0, "measure": 0.1, "fit": 0.7, "check": 1.0, "reduce": 3.0, "report": 4.0}
"""Of a task of 5,000 readings on one core, where the folder has no results of the kind yet."""


@dataclasses.dataclass(frozen=True)
class Estimate:
    """What a campaign takes. `hours`: of measuring on a real instrument; `seconds`: of computing on one core.

    `bytes` are those of the tables before compression, at most.
    """

    tasks: dict[str, int]
    kept: int
    cells: int
    bytes: int
    hours: float
    seconds: float
    measured: bool
    """Whether the seconds come from results that are there, for each kind that is still to be done."""


def estimate(recipe: Recipe, tasks: Sequence[Task], store: Store) -> Estimate:
    """What the tasks of a recipe take, less what the folder has already."""
    there = store.keys()
    counts = Counter(task.kind for task in tasks)
    known: dict[str, list[float]] = defaultdict(list)
    for key in sorted(there)[:: max(1, len(there) // 500)]:
        record = store.record(key)
        if record is not None and record.status == DONE:
            known[record.kind].append(record.cpu_seconds)
    there |= {part for task in tasks if task.key in there for part in task.parts}
    waiting = Counter(task.kind for task in tasks if task.key not in there)
    kinds = (PART, *KINDS)
    each = {kind: statistics.median(known[kind]) if known[kind] else USUAL_SECONDS[kind] for kind in kinds}
    seconds = sum(each[kind] * count for kind, count in waiting.items())
    cells = size = 0
    hours = 0.0
    for block in recipe.measure:
        new = _of_block(block)
        cells, size, hours = cells + new[0], size + new[1], hours + new[2]
    return Estimate(
        {k: counts[k] for k in kinds if counts[k]}, sum(t.key in there for t in tasks), cells, size, hours, seconds,
        all(known[kind] for kind in waiting),
    )  # fmt: skip


def _of_block(block: MeasureBlock) -> tuple[int, int, float]:
    """(cells, bytes, hours) of all tables of a block."""
    cells, size, hours = 0, 0, 0.0
    for material in block.materials:
        for scan in block.scans:
            layout, counting = _layout(material.value, scan.value)
            for instrument in block.instruments:
                takes = instrument.value.pace.scan_time(
                    layout, instrument.value.seconds if counting is None else counting
                )
                noisy = instrument.value.has_noise or block.photons != (None,)
                times = len(block.photons) * len(block.seeds)
                cells += layout.size * times
                size += layout.size * material.channels * (17 if noisy else 9) * times
                hours += takes.seconds / 3600 * times
    return cells, size, hours


def _layout(material: Any, options: dict[str, Any]) -> tuple[Layout, Any]:
    brdf = load_material(material).brdf
    return layout_of(brdf, options), listed_seconds(scan_name(brdf, options["name"]))

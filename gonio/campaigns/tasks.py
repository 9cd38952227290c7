"""The tasks of a recipe: each has a key by everything that determines its result, and knows what it waits for."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

from gonio import __version__
from gonio.campaigns.check_parts import Size, check_shares, size_of_file
from gonio.campaigns.choices import USUAL_SCAN, Choice, instrument_spec
from gonio.campaigns.keys import key_of
from gonio.campaigns.recipe import MeasureBlock, Recipe, Work
from gonio.campaigns.store import PART
from gonio.campaigns.table_parts import layout_of, part_ranges
from gonio.data.subject import load_material
from gonio.instrument.instrument import Instrument

MEASURE, FIT, CHECK, REDUCE, REPORT = KINDS = ("measure", "fit", "check", "reduce", "report")
AUTO = "auto"


@dataclasses.dataclass(frozen=True)
class Task:
    """One result to be made.

    Attributes:
        kind: measure, fit, check, reduce or report; part: of a large table that is measured or checked.
        key: digest of what determines the result, the name of its file.
        inputs: what the work takes, with paths of files.
        labels: names for the catalogue.
        digests: SHA-256 of the files among the inputs, by their paths: they must not change meanwhile.
        needs: keys of tasks without whose results there is none.
        after: keys of tasks that must be over, well or not.
        version: of the gonio that made the key, which no other may follow.
    """

    kind: str
    key: str
    inputs: dict[str, Any]
    labels: dict[str, Any]
    digests: dict[str, str] = dataclasses.field(default_factory=dict)
    needs: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    version: str = __version__

    @property
    def parts(self) -> tuple[str, ...]:
        """Keys of the parts of which a large table, or its check, is put together."""
        return tuple(self.inputs.get("parts", ()))

    @property
    def name(self) -> str:
        """What the task is, for a line of text."""
        labels = self.labels
        words = [f"{self.kind} {labels['model']} of" if labels["model"] else self.kind, str(labels["subject"])]
        words += [
            str(labels[name]) for name in ("instrument", "scan") if labels[name] not in (None, "ideal", USUAL_SCAN)
        ]
        words += [f"{labels['photons']:g} photons"] if labels["photons"] else []
        words += [f"seed {labels['seed']}"] if labels["seed"] is not None else []
        if "cells" in self.inputs:
            words.append("cells {:,} to {:,}".format(*self.inputs["cells"]))
        if "share" in self.inputs:
            name, start, stop = self.inputs["share"]
            words.append(f"its {name}" + f" at incidences {start:,} to {stop:,}" * (stop > 0))
        return ", ".join([" ".join(words[:2]), *words[2:]])


LABELS = ("subject", "material", "instrument", "scan", "photons", "seed", "model")


@dataclasses.dataclass(frozen=True)
class _Table:
    """A table that tasks read: its key, or its file; with what determines it."""

    spec: dict[str, Any]
    inputs: dict[str, Any]
    labels: dict[str, Any]
    digests: dict[str, str]
    needs: tuple[str, ...]
    size: Size | None = None
    """Where it is known."""


def tasks_of(recipe: Recipe, part: tuple[int, int] = (0, 1)) -> list[Task]:
    """The tasks of a recipe in the order of their subjects, each once.

    Args:
        recipe: the recipe.
        part: (k, n): every n-th subject alone, from the k-th on; for arrays of jobs.
    """
    tasks: dict[str, Task] = {}
    for number, subject in enumerate(_subjects(recipe)):
        if number % part[1] == part[0]:
            for task in subject:
                tasks.setdefault(task.key, task)
    return list(tasks.values())


def _subjects(recipe: Recipe) -> Iterator[list[Task]]:
    """The tasks of one subject after another: tables that are there, materials, tables that are measured."""
    for choice in recipe.tables:
        labels = _labels(subject=choice.label)
        path = str(choice.value)
        size = size_of_file(path) if "tables" in recipe.work.check else None
        table = _Table(choice.spec, {"table": path}, labels, {path: choice.spec["sha256"]}, (), size)
        yield list(_work_on(table, recipe.work))
    for block in recipe.measure:
        if "materials" in block.work.check:
            for material in block.materials:
                yield [_check_of_material(material, block.work)]
        yield from _measured(block)


def _labels(**labels: Any) -> dict[str, Any]:
    return {name: labels.get(name) for name in LABELS}


def _material_inputs(material: Choice) -> tuple[dict[str, Any], dict[str, str]]:
    """The inputs of a material, and the digest of its file."""
    of_file = {str(material.value): material.spec["sha256"]} if "file" in material.spec else {}
    return {"material": str(material.value), "file": bool(of_file)}, of_file


def _check_of_material(material: Choice, work: Work) -> Task:
    inputs, digests = _material_inputs(material)
    key = key_of(CHECK, {"material": material.spec, "options": dict(work.check_options)})
    labels = _labels(subject=material.label, material=material.label)
    return Task(CHECK, key, inputs | {"options": dict(work.check_options)}, labels, digests)


def _measured(block: MeasureBlock) -> Iterator[list[Task]]:
    instruments = {
        (i, photons): instrument.value if photons is None else dataclasses.replace(instrument.value, photons=photons)
        for i, instrument in enumerate(block.instruments)
        for photons in block.photons
    }
    specs = {which: instrument_spec(instrument) for which, instrument in instruments.items()}
    sizes = {
        (material.label, scan.label): Size(layout_of(load_material(material.value).brdf, scan.value), material.channels)
        for material in block.materials
        for scan in block.scans
    }
    for material in block.materials:
        for i, choice in enumerate(block.instruments):
            for scan in block.scans:
                for photons in block.photons:
                    instrument, spec = instruments[i, photons], specs[i, photons]
                    spec = {"material": material.spec, "instrument": spec, "scan": scan.spec}
                    labels = _labels(subject=material.label, material=material.label, instrument=choice.label)
                    labels |= {"scan": scan.label, "photons": instrument.photons}
                    size = sizes[material.label, scan.label]
                    for seed in block.seeds:
                        task = _measure(material, instrument, scan, spec | {"seed": seed}, labels | {"seed": seed})
                        parts = _parts(task, spec | {"seed": seed}, part_ranges(*size))
                        if parts:
                            keys = tuple(part.key for part in parts)
                            task = dataclasses.replace(task, inputs=task.inputs | {"parts": list(keys)}, needs=keys)
                        table = _Table({"key": task.key}, {"key": task.key}, task.labels, {}, (task.key,), size)
                        yield [*parts, task, *_work_on(table, block.work)]


def _parts(table: Task, spec: dict[str, Any], ranges: Sequence[tuple[int, int]]) -> list[Task]:
    """Tasks that measure the parts of a large table; none for one of a single range."""
    return [
        Task(PART, key_of(PART, spec | {"cells": cells}), table.inputs | {"cells": cells}, table.labels, table.digests)
        for cells in ranges
        if len(ranges) > 1
    ]


def _measure(
    material: Choice, instrument: Instrument, scan: Choice, spec: dict[str, Any], labels: dict[str, Any]
) -> Task:
    inputs, digests = _material_inputs(material)
    inputs |= {"instrument": instrument, "scan": scan.value, "seed": labels["seed"]}
    if "sha256" in scan.spec:
        digests = digests | {scan.value["name"]: scan.spec["sha256"]}
    return Task(MEASURE, key_of(MEASURE, spec), inputs, labels, digests)


def _work_on(table: _Table, work: Work) -> Iterator[Task]:
    """The tasks of a table: fits, checks of it and of them, reductions, a page."""
    options, checking = dict(work.fit_options), dict(work.check_options)
    common = (table.digests, table.needs)
    fits: list[str] = []
    for model in work.fit:
        key = key_of(FIT, {"table": table.spec, "model": model, "options": options})
        labels = table.labels | {"model": model or AUTO}
        yield Task(FIT, key, table.inputs | {"model": model, "options": options}, labels, *common)
        fits.append(key)
        if "fits" in work.check:
            of_fit = key_of(CHECK, {"fit": key, "options": checking})
            yield Task(CHECK, of_fit, {"fit": key, "options": checking}, labels, {}, (key,))
    if "tables" in work.check:
        yield from _check_of_table(table, checking)
    for scene in work.reduce:
        key = key_of(REDUCE, {"table": table.spec, "scene": scene.spec})
        digests = table.digests | ({scene.value: scene.spec["sha256"]} if "file" in scene.spec else {})
        labels = table.labels | {"model": scene.label}
        yield Task(REDUCE, key, table.inputs | {"scene": scene.value}, labels, digests, table.needs)
    if work.report:
        key = key_of(REPORT, {"table": table.spec, "fits": fits})
        yield Task(REPORT, key, table.inputs | {"fits": fits}, table.labels, *common, tuple(fits))


def _check_of_table(table: _Table, options: dict[str, Any]) -> Iterator[Task]:
    """The check of a table; of a large one its shares before it."""
    key = key_of(CHECK, {"table": table.spec, "options": options})
    inputs, common = table.inputs | {"options": options}, (table.labels, table.digests)
    shares, needs = check_shares(table.size, options), table.needs
    if shares:
        keys = [key_of(PART, {"check": key, "share": share}) for share in shares]
        for share, part in zip(shares, keys, strict=True):
            yield Task(PART, part, inputs | {"share": share}, *common, needs)
        inputs, needs = inputs | {"shares": shares, "parts": keys}, (*needs, *keys)
    yield Task(CHECK, key, inputs, *common, needs)

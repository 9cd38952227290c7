"""What each kind of task does: from its inputs to a result that can be written, and its row of the catalogue."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from gonio.campaigns.store import PART, Store
from gonio.campaigns.tasks import CHECK, FIT, MEASURE, REDUCE, REPORT, Task
from gonio.data.serialise import unboxed

if TYPE_CHECKING:
    from gonio.data.table import Table

TIMES = ("created", "seconds")
"""Entries that differ from run to run: a record keeps the seconds, and the file's own date says when it was made."""


class Product(NamedTuple):
    """A result: its row of the catalogue, whether it is good, and what writes it."""

    row: dict[str, Any]
    good: bool
    write: Callable[[Path], object]


def measured(task: Task, store: Store) -> Product:
    """A table, as `gonio.measure` gives it."""
    from gonio.campaigns.table_parts import assembled, layout_of, scan_name, without_place
    from gonio.data.hdf5.writer import write_table
    from gonio.data.subject import load_material
    from gonio.instrument.measurement import measure
    from gonio.instrument.scans import listed_seconds

    inputs = task.inputs
    if task.parts:
        row, write = assembled(inputs, store)
        return Product(row, True, write)
    material = load_material(_subject(inputs))
    layout, name = layout_of(material.brdf, inputs["scan"]), scan_name(material.brdf, inputs["scan"]["name"])
    remarks: list[str] = []
    table = measure(
        material, inputs["instrument"], layout, seed=inputs["seed"], seconds=listed_seconds(name), log=remarks.append
    )
    table.provenance = without_place(table.provenance)
    row = {"readings": table.layout.size, "channels": len(table.channels), "remarks": "; ".join(remarks[:-1])}
    return Product(row, True, lambda path: write_table(path, table, force=True))


def part_done(task: Task, store: Store) -> Product:
    """Some cells of a table, or a share of its check, that is put together when all are there."""
    import numpy as np

    from gonio.campaigns.check_parts import part_of_check
    from gonio.campaigns.table_parts import read_part

    if "share" in task.inputs:
        row, values = {}, part_of_check(_kept_table(*_state(_path(task, store))), task.inputs)
    else:
        row, values = read_part(task.inputs)

    def write(path: Path) -> None:
        with path.open("wb") as file:
            np.savez(file, allow_pickle=False, **values)

    return Product(row, True, write)


def fitted(task: Task, store: Store) -> Product:
    """A fitted material, as `gonio fit -o` writes it."""
    import tomli_w

    from gonio.fitting.fit_table import fit

    result = fit(_table(task, store), task.inputs["model"], **task.inputs["options"])
    content = _without_times(result.to_material_dict(f"fit of {result.table}" if result.table else "fit"))
    row: dict[str, Any] = {
        "readings": result.samples,
        "channels": len(result.channels),
        "expression": result.expression,
    }
    row |= {"verdict": result.judgement.verdict, "sentence": result.judgement.sentence}
    row |= {"converged": result.converged, "bic": result.bic, "undetermined": len(result.undetermined)}
    row |= {name: result.metrics.get(name) for name in ("reduced_chi2", "relative_rms", "largest_albedo")}
    numbers = [p for p in result.parameters if p.status != "fixed"]
    row["parameters"] = [[p.label, p.value, p.standard_uncertainty, *p.interval95, p.status] for p in numbers]
    text = tomli_w.dumps(content)
    return Product(unboxed(row), result.exit_status == 0, lambda path: path.write_text(text, "utf-8"))


def checked(task: Task, store: Store) -> Product:
    """A certificate, as `gonio check --json` gives it."""
    from gonio.campaigns.check_parts import check_of_parts
    from gonio.checks.certify import check

    inputs, name = task.inputs, str(task.labels["subject"])
    kind = next((name for name in ("fit", "material") if name in inputs), "table")
    of_kind = {
        "fit": lambda: store.path(FIT, inputs["fit"]),
        "material": lambda: _subject(inputs),
        "table": lambda: _table(task, store),
    }
    subject = of_kind[kind]()
    if task.parts:
        certificate = check_of_parts(subject, name, inputs, store)
        _kept_table.cache_clear()  # no part of it follows
    else:
        certificate = check(subject, name=name, **inputs["options"])
    row: dict[str, Any] = {"verdict": certificate.overall, "of": kind}
    row["verdicts"] = {p.name: p.verdict for p in certificate.properties}
    worst = [p.detail for p in certificate.properties if p.name in certificate.counted and p.verdict != "pass"]
    row["sentence"] = worst[0] if worst else ""
    text = certificate.to_json()
    good = certificate.overall != "fail"
    return Product(row, good, lambda path: path.write_text(text, "utf-8"))


def reduced(task: Task, store: Store) -> Product:
    """The coarsest table that a scene's tolerance allows, as `gonio reduce` writes it."""
    from gonio.data.hdf5.writer import write_table
    from gonio.data.reduction.coarsest_table import reduce_table

    result = reduce_table(_table(task, store), task.inputs["scene"])
    result.table.provenance.pop("created", None)
    row = {"verdict": "kept" if result.keeps else "not kept", "sentence": result.promise()}
    row |= {"readings": result.cells[1], "readings_before": result.cells[0], "promised": result.promised}
    return Product(unboxed(row), result.keeps, lambda path: write_table(path, result.table, force=True))


def reported(task: Task, store: Store) -> Product:
    """A page about the table and those of its fits that there are."""
    from gonio.reports.build import report

    paths = [store.path(FIT, key) for key in task.inputs["fits"]]
    fits = [path for path in paths if path.exists()]
    page = report([_table(task, store, blockwise=False)], fits=fits, title=task.name.removeprefix("report, "))
    text = str(page)
    return Product({"fits": len(fits)}, True, lambda path: path.write_bytes(text.encode(errors="backslashreplace")))


STEPS: dict[str, Callable[[Task, Store], Product]] = {
    MEASURE: measured, PART: part_done, FIT: fitted, CHECK: checked, REDUCE: reduced, REPORT: reported,
}  # fmt: skip


def _subject(inputs: dict[str, Any]) -> Any:
    return Path(inputs["material"]) if inputs["file"] else inputs["material"]


def _table(task: Task, store: Store, blockwise: bool = True) -> "Table":
    """The table of a task, named after its file where it has no name; the values of a large one stay in its file."""
    return _read_table(_path(task, store), blockwise)


def _path(task: Task, store: Store) -> Path:
    inputs = task.inputs
    return store.path(MEASURE, inputs["key"]) if "key" in inputs else Path(inputs["table"])


def _read_table(path: Path, blockwise: bool) -> "Table":
    from gonio.data.files import stem
    from gonio.data.formats.registry import read

    table = read(path, blockwise=blockwise)
    table.name = table.name or stem(path)
    return table


def _state(path: Path) -> tuple[Path, int, int]:
    """A path, with what tells whether its file is another one by now."""
    try:
        state = path.stat()
    except OSError:  # said where it is read
        return path, 0, 0
    return path, state.st_size, state.st_mtime_ns


@functools.lru_cache(maxsize=1)
def _kept_table(path: Path, *state: int) -> "Table":
    """The large table that this process opened last: that looks through all readings, and parts follow one another."""
    return _read_table(path, True)


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_times(inner) for key, inner in value.items() if key not in TIMES}
    return [_without_times(inner) for inner in value] if isinstance(value, list) else value

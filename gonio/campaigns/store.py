"""The folder of a campaign: one file for each result, one record beside it, written whole or not at all.

    runs/tables/KEY.h5    runs/fits/KEY.fit.toml    runs/checks/KEY.json    runs/reduced/KEY.h5    runs/reports/KEY.html
    runs/parts/KEY.npz                    parts of large tables that are not whole yet
    runs/records/KEY.json                 what was done, when it is done: status, numbers for the catalogue, seconds
    runs/plan.json                        the keys of the last recipe
    runs/catalogue.parquet, index.html    made from the records

A record is written after its result, so a result without one is not there yet.
"""

import contextlib
import dataclasses
import json
import os
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from gonio.data.files import new_file, output_errors, publish, temporary_beside
from gonio.data.serialise import plain
from gonio.models.errors import GonioError

RECORD_FORMAT = 1
PART = "part"
"""The kind of a task that measures a part of a large table: its file is there until the table is."""
FILES = {"measure": "tables/{}.h5", "fit": "fits/{}.fit.toml", "check": "checks/{}.json", "reduce": "reduced/{}.h5",
         "report": "reports/{}.html",
         PART: "parts/{}.npz"}  # fmt: skip
"""Where the result of each kind of task goes, by its key."""
RECORDS, PLAN, CATALOGUE, PAGE = "records", "plan.json", "catalogue.parquet", "index.html"
DONE, REFUSED = "done", "refused"
STALE = 60
"""Seconds after which an unfinished file is of a killed process: no result takes so long to write."""


@dataclasses.dataclass(frozen=True)
class Record:
    """What became of a task. `row`: numbers for the catalogue; `good`: nothing that a user must look after."""

    key: str
    kind: str
    status: str
    good: bool
    labels: dict[str, Any]
    row: dict[str, Any]
    error: str = ""
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    file: str | None = None


@dataclasses.dataclass(frozen=True)
class Store:
    """The folder of a campaign."""

    folder: Path

    def path(self, kind: str, key: str) -> Path:
        """The file of a result."""
        return self.folder / FILES[kind].format(key)

    def prepare(self) -> None:
        """Makes the folders and removes what killed processes were writing. Raises GonioError where it cannot."""
        for name in (RECORDS, *(pattern.split("/")[0] for pattern in FILES.values())):
            folder = self.folder / name
            if self.folder.exists() and not self.folder.is_dir():
                raise GonioError(f"{self.folder} is a file; name a folder for the results")
            if folder != self.path(PART, "").parent:
                with output_errors(folder / "result"):
                    folder.mkdir(parents=True, exist_ok=True)
            with contextlib.suppress(OSError):
                for entry in os.scandir(folder):
                    if entry.name.endswith(".tmp") and time.time() - entry.stat().st_mtime > STALE:
                        os.unlink(entry.path)

    def write(self, kind: str, key: str, write: Callable[[Path], object]) -> str:
        """Writes the result of a task by `write`, which takes a temporary path; its name within the folder."""
        path = self.path(kind, key)
        with output_errors(path):
            path.parent.mkdir(exist_ok=True)
        with new_file(path, force=True) as temporary:
            write(temporary)
        return path.relative_to(self.folder).as_posix()

    def write_record(self, record: Record) -> None:
        """Marks a task as over."""
        content = {"gonio_campaign_record": RECORD_FORMAT, **plain(dataclasses.asdict(record))}
        self._write_json(self.folder / RECORDS / f"{record.key}.json", content)

    def forget(self, key: str) -> None:
        """Removes the record of a task, which is to be done again."""
        path = self.folder / RECORDS / f"{key}.json"
        with output_errors(path):
            path.unlink(missing_ok=True)

    def discard_parts(self, keys: Iterable[str]) -> None:
        """Removes parts of a table that is there."""
        for key in keys:
            with contextlib.suppress(OSError):
                (self.folder / RECORDS / f"{key}.json").unlink(missing_ok=True)
                self.path(PART, key).unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.path(PART, "").parent.rmdir()  # where it is empty

    def write_plan(self, recipe: str, keys: list[str]) -> None:
        """Keeps the name of the last recipe with its keys: the catalogue tells what is of it."""
        self._write_json(self.folder / PLAN, {"gonio_campaign_plan": RECORD_FORMAT, "recipe": recipe, "keys": keys})

    def plan(self) -> tuple[str, list[str]]:
        """(name of the last recipe, keys of its tasks); nothing where there is none."""
        try:
            content = json.loads((self.folder / PLAN).read_text("utf-8"))
            return str(content["recipe"]), [str(k) for k in content["keys"]]
        except (OSError, ValueError, KeyError, TypeError):
            return "", []

    def keys(self) -> set[str]:
        """Keys of the tasks that have a record."""
        try:
            names = os.listdir(self.folder / RECORDS)
        except OSError:
            return set()
        return {name.removesuffix(".json") for name in names if name.endswith(".json") and name[0] != "."}

    def not_done(self) -> int:
        """How many tasks of the last recipe have no record."""
        return len({*self.plan()[1]}.difference(self.keys()))

    def record(self, key: str) -> Record | None:
        """The record of a task; None where there is none that can be read, or its result is gone."""
        try:
            content = json.loads((self.folder / RECORDS / f"{key}.json").read_text("utf-8"))
            if content.pop("gonio_campaign_record") != RECORD_FORMAT:
                return None
            record = Record(**content)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None
        lost = record.file is not None and not (self.folder / record.file).exists()
        return None if lost or record.key != key or record.kind not in FILES else record

    def records(self) -> Iterator[Record]:
        """Every record, in the order of the last recipe, what is of other recipes behind it."""
        keys, planned = self.keys(), self.plan()[1]
        first = [key for key in planned if key in keys]
        for key in [*first, *sorted(keys.difference(first))]:
            record = self.record(key)
            if record is not None:
                yield record

    def _write_json(self, path: Path, content: Any) -> None:
        text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        # Without waiting for the disk: a record that a power cut breaks is none, and its task is done again.
        with output_errors(path):
            temporary = temporary_beside(path)
            try:
                temporary.write_text(text + "\n", encoding="utf-8", errors="backslashreplace")
                publish(temporary, path, durable=False)
            except BaseException:
                temporary.unlink(missing_ok=True)
                raise

"""`stress`: where each method fails, and whether it says so; as cells, a CSV, and a page of pictures."""

import csv
import dataclasses
import io
import os
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from gonio.data.files import new_file
from gonio.models.catalog import MODELS
from gonio.models.errors import GonioError, nearest
from gonio.stability.known_failures import reason_of
from gonio.stability.outcome import METHODS, RIGHT, SAYS_SO, SILENT, VERDICTS, Cell, worst
from gonio.stability.run import HARD, QUICK, atlas, do

PAGE, TABLE = "index.html", "stress.csv"
FIELDS = (
    "method",
    "model",
    "setting",
    "regime",
    "precision",
    "verdict",
    "error",
    "allowed",
    "detail",
    "recipe",
    "reason",
)


@dataclasses.dataclass(frozen=True)
class Atlas:
    """The cells of a run, and how long it took."""

    cells: tuple[Cell, ...]
    quick: bool
    seconds: float

    def counts(self, method: str | None = None) -> dict[str, int]:
        """How many cells have each verdict."""
        found = Counter(c.verdict for c in self.cells if method in (None, c.method))
        return {v: found.get(v, 0) for v in VERDICTS}

    @property
    def silent(self) -> list[Cell]:
        """The cells that are wrong and do not say so."""
        return [c for c in self.cells if c.verdict == SILENT]

    @property
    def exit_status(self) -> int:
        """0 where nothing fails silently, else 1."""
        return 1 if self.silent else 0

    def last_line(self) -> str:
        """The count that matters."""
        n, known = len(self.silent), sum(bool(reason_of(c)) for c in self.silent)
        return f"{n} silent failure{'s' * (n != 1)}" + (f", {known} with a known reason" if known else "")


def stress(
    models: Sequence[str] | str = (),
    *,
    quick: bool = False,
    output: str | os.PathLike | None = None,
    processes: int | None = None,
    force: bool = False,
    say: Callable[[str], None] = lambda line: None,
) -> Atlas:
    """The stability atlas of some models (all, where none is named; six that stand for all, where `quick`).

    Values and gradients are held against textbook forms at forty digits, samplers against their density, hemisphere
    integrals against rings about the lobe, fits against the truth that was measured. Each cell is right, wrong but says
    so, or silently wrong. `output`: a folder for the page, the pictures and the CSV. `say` hears a line for each method
    of each model. Raises GonioError for an unknown model and for a folder that cannot be written.
    """
    names = (models,) if isinstance(models, str) else tuple(models)
    for name in names:
        if name not in MODELS:
            raise GonioError(f"Unknown model '{name}'; {nearest(name, MODELS)}")
    names = names or (tuple(n for n in QUICK if n in MODELS) if quick else tuple(MODELS))
    if output is not None:
        _require_folder(output, force)
    began = time.perf_counter()
    cells: list[Cell] = []
    for (name, method), found in atlas(names, quick, processes):
        cells += found
        counts = Counter(c.verdict for c in found)
        say(f"{method:9} {name:24} " + ", ".join(f"{counts[v]} {v}" for v in VERDICTS if counts[v]))
    order = {name: k for k, name in enumerate((*names, HARD))}
    cells.sort(key=lambda c: (METHODS.index(c.method), order[c.model]))
    done = Atlas(tuple(cells), quick, time.perf_counter() - began)
    if output is not None:
        write(done, output, force)
    return done


QUICK_KEYS = ", made with --quick as well"


def again(name: str, key: str, quick: bool = False) -> list[Cell]:
    """One cell of a model, or of the hard fits, by the key that the CSV gives it, done anew."""
    method = key.split("/")[0]
    if method not in METHODS:
        raise GonioError(f"'{key}' is no cell; a key begins with one of {', '.join(METHODS)}, as the CSV gives it.")
    if name not in MODELS and not (name == HARD and method == "fit"):
        raise GonioError(f"Unknown model '{name}'; {nearest(name, MODELS)}")
    found = [c for c in do((name, method), quick, key) if c.key == key]
    if not found:
        said = "gonio stress -o FOLDER" if name == HARD else f"gonio stress {name} -o FOLDER"
        raise GonioError(f"{name} has no cell '{key}'; copy a key from the CSV of '{said}'{QUICK_KEYS * quick}")
    return found


def _require_folder(output: str | os.PathLike, force: bool) -> None:
    folder = Path(output)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GonioError(f"{folder} cannot be a folder ({error.strerror}); name another with -o") from None
    # Before the work, not after it.
    if not force and any((folder / name).exists() for name in (PAGE, TABLE, *(f"{m}.svg" for m in METHODS))):
        raise GonioError(f"{folder} holds an atlas already; name another folder, or --force to replace it")
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise GonioError(f"{folder} cannot be written to ({error.strerror}); name another with -o") from None


def write(done: Atlas, output: str | os.PathLike, force: bool = False) -> Path:
    """The page, its pictures as SVG, and the CSV, in a folder; the path of the page."""
    from gonio.stability.page import page, pictures

    folder = Path(output)
    drawn = pictures(done)
    parts = {f"{method}.svg": text for method, text in drawn.items()}
    parts[TABLE] = table(done)
    parts[PAGE] = page(done, drawn)
    for name, text in parts.items():
        with new_file(folder / name, force) as path:
            path.write_text(text, encoding="utf-8")
    return folder / PAGE


def table(done: Atlas) -> str:
    """The cells as CSV, a header first."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(FIELDS)
    for c in done.cells:
        said = (c.method, c.model, c.row, c.column, c.precision, c.verdict, f"{c.error:.3g}", f"{c.allowed:.3g}")
        writer.writerow([*said, c.detail, recipe(c, done.quick), reason_of(c) if c.verdict == SILENT else ""])
    return text.getvalue()


def recipe(c: Cell, quick: bool) -> str:
    """The command that does a cell again."""
    name = f"'{HARD}'" if c.model == HARD else c.model
    return f"gonio stress {name}{' --quick' * quick} --cell '{c.key}'"


def grid_of(done: Atlas, method: str) -> tuple[dict[str, dict[str, str]], list[str]]:
    """(verdicts by model and column, the columns): the worst over the settings of each model."""
    cells = [c for c in done.cells if c.method == method]
    several = len({c.precision for c in cells}) > 1
    title = {c: f"{c.column} {c.precision[-2:]} bit" if several else c.column for c in cells}
    columns = list(dict.fromkeys(title[c] for c in sorted(cells, key=lambda c: c.precision, reverse=True)))
    grid: dict[str, dict[str, list[str]]] = {}
    for c in cells:
        grid.setdefault(c.model, {}).setdefault(title[c], []).append(c.verdict)
    return {m: {k: worst(v) for k, v in row.items()} for m, row in grid.items()}, columns


def summary(done: Atlas) -> list[list[str]]:
    """Rows of (method, cells, right, says so, silently wrong)."""
    rows = []
    for method in METHODS:
        counts = done.counts(method)
        if any(counts.values()):
            rows.append(
                [method, *(f"{n:,}" for n in (sum(counts.values()), *(counts[v] for v in (RIGHT, SAYS_SO, SILENT))))]
            )
    return rows

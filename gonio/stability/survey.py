"""`stress`: the stability atlas, which tells where each method fails and whether the method reports it."""

import os
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from gonio.data.files import new_file
from gonio.models.catalog import MODELS
from gonio.models.deprecation import old_keywords
from gonio.models.errors import GonioError, nearest
from gonio.models.subsurface.catalog import BSSRDFS
from gonio.stability.outcome import HARD, METHODS, VERDICTS, Cell
from gonio.stability.result import Atlas
from gonio.stability.run import QUICK, atlas, cells_of

EVERY = (*MODELS, *BSSRDFS)
PAGE, TABLE = "index.html", "stress.csv"


@old_keywords(say="log")
def stress(
    models: Sequence[str] | str = (),
    *,
    quick: bool = False,
    output: str | os.PathLike[str] | None = None,
    processes: int | None = None,
    force: bool = False,
    log: Callable[[str], None] = lambda line: None,
) -> Atlas:
    """Computes the stability atlas of some models: where each method fails, and whether it says so.

    Values and gradients are compared with textbook forms at forty digits, samplers with their density, hemisphere
    integrals with rings about the lobe, and fits with the parameters that made the readings; of light below a surface
    profiles, their totals and fits to them. Each cell is right, wrong
    but says so, or silently wrong.

    Args:
        models: names of models; all where none is given, six that stand for all with `quick`.
        quick: fewer models, settings and samples: about a minute on two cores.
        output: a folder for the page, the pictures (SVG) and the CSV.
        processes: number of processes; one for each processor where none is given.
        force: replaces an atlas in `output`.
        log: called with a line for each method of each model.

    Raises:
        GonioError: a model is unknown, or the folder cannot be written or holds an atlas.
    """
    names = (models,) if isinstance(models, str) else tuple(models)
    for name in names:
        _require_model(name)
    names = names or (tuple(n for n in QUICK if n in MODELS) if quick else EVERY)
    if output is not None:
        _require_folder(output, force)
    began = time.perf_counter()
    cells: list[Cell] = []
    for (name, method), new in atlas(names, quick, processes):
        cells += new
        counts = Counter(c.verdict for c in new)
        log(f"{method:9} {name:24} " + ", ".join(f"{counts[v]} {v}" for v in VERDICTS if counts[v]))
    order = {name: k for k, name in enumerate((*names, HARD))}
    cells.sort(key=lambda c: (METHODS.index(c.method), order[c.model]))
    result = Atlas(tuple(cells), quick, time.perf_counter() - began)
    if output is not None:
        write(result, output, force)
    return result


def repeat_cell(name: str, key: str, quick: bool = False) -> list[Cell]:
    """Computes one cell of a model, or of the hard fits, again, by the key that the CSV gives it."""
    method = key.split("/")[0]
    if method not in METHODS:
        raise GonioError(f"'{key}' is no cell; a key begins with one of {', '.join(METHODS)}, as the CSV gives it.")
    if not (name == HARD and method == "fit"):
        _require_model(name)
    cells = [c for c in cells_of((name, method), quick, key) if c.key == key]
    if not cells:
        command = f"gonio stress{f' {name}' * (name != HARD)} -o FOLDER"
        made = ", made with --quick as well" * quick
        raise GonioError(f"{name} has no cell '{key}'; copy a key from the CSV of '{command}'{made}")
    return cells


def write(result: Atlas, output: str | os.PathLike[str], force: bool = False) -> Path:
    """Writes the page, its pictures as SVG, and the CSV into a folder; returns the path of the page."""
    from gonio.stability.page import page, pictures

    folder = Path(output)
    svg = pictures(result)
    files = {f"{method}.svg": text for method, text in svg.items()}
    for name, text in (files | {TABLE: result.to_csv(), PAGE: page(result, svg)}).items():
        with new_file(folder / name, force) as path:
            path.write_text(text, encoding="utf-8")
    return folder / PAGE


def _require_model(name: str) -> None:
    if name not in EVERY:
        raise GonioError(f"Unknown model '{name}'; {nearest(name, EVERY)}")


def _require_folder(output: str | os.PathLike[str], force: bool) -> None:
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

"""``gonio fit`` of many files or a folder: one line and one file each, and a killed batch goes on where it stopped."""

import argparse
import hashlib
import time
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from gonio.cli.arguments import read_table, write_json, write_text
from gonio.models.errors import GonioError
from gonio.text import show

if TYPE_CHECKING:
    from gonio.data.table import Table

SUFFIX = ".fit.toml"
STALE = 60  # seconds after which an unfinished file is of a killed batch: no result takes so long to write


class Job(NamedTuple):
    """A file to fit, where its result goes, and what that depends on."""

    file: Path
    target: Path
    recipe: dict[str, Any]


def is_batch(files: Sequence[str]) -> bool:
    """Whether the files of a command line are many: more than one, or a folder."""
    return len(files) > 1 or Path(files[0]).is_dir()


def table_of(file: str | Path, args: argparse.Namespace) -> "Table":
    """The table of a file, with the channels that the command line names; a fit goes through large ones in blocks."""
    table = read_table(str(file), args, blockwise=not args.nuisance)
    return table.only(args.channel) if args.channel else table


def run_batch(args: argparse.Namespace, options: dict[str, Any]) -> int:
    """Fits all files, each result written to the folder `args.output` as soon as it is there.

    `options` are those of `gonio.fit`. A result that exists is kept if it was made of the same file by the same
    command. Exit status 2 if a file was refused, else 1 if a fit did not converge, else 0.
    """
    models: list[str] = args.model or []
    from gonio.data.files import refuse_outputs
    from gonio.fitting.batch import as_fitted
    from gonio.models.expression.parser import parse

    for model in models:
        parse(model)  # a wrong word is refused once, not for every file
    folder = Path(args.output or ".")
    if folder.exists() and not folder.is_dir():
        raise GonioError(f"{folder} is a file; of many files, -o names the folder of the results.")
    files, ignored = _files(args.files)
    jobs = [Job(f, t, _recipe(args, options, f)) for f, t in zip(files, _targets(files, folder), strict=True)]
    # Whether a result that exists may be replaced is decided by its recipe, below.
    refuse_outputs([job.target for job in jobs], [*files, args.scene, *models], force=True, makes_folder=True)
    finished = [job for job in jobs if not args.force and _is_finished(job)]
    folder.mkdir(parents=True, exist_ok=True)
    _remove_stale(jobs)
    show(f"{len(jobs)} tables" + (f", {ignored} other files passed over" if ignored else ""))
    if finished:
        show(f"{len(finished)} of them were fitted before and are kept")
    waiting = [job for job in jobs if job not in finished]
    status = 0 if all(tomllib.loads(j.target.read_text("utf-8"))["fit"]["converged"] for j in finished) else 1
    facts = [_facts(j, tomllib.loads(j.target.read_text("utf-8"))["fit"]) for j in finished]
    if not waiting:
        return write_json(args, {"fits": facts}, status)
    began = time.perf_counter()
    tables = [lambda job=job: table_of(job.file, args) for job in waiting]
    for count, (index, outcome) in enumerate(as_fitted(tables, args.model, **options), len(finished) + 1):
        status = max(status, _write_outcome(waiting[index], outcome, f"[{count}/{len(jobs)}]", args.force))
        facts.append(_facts(waiting[index], outcome if isinstance(outcome, GonioError) else outcome.to_dict()))
    seconds = time.perf_counter() - began
    show(f"{len(waiting)} fits in {seconds:.1f} s, {len(waiting) / seconds:.3g} a second; written to {folder}")
    return write_json(args, {"fits": facts}, status)


def kept_results(args: argparse.Namespace) -> str:
    """What an interrupted batch has kept."""
    folder = Path(args.output or ".")
    count = len(list(folder.glob(f"*{SUFFIX}"))) if folder.is_dir() else 0
    return f"{count} results are in {folder}: run it again to go on" if count else "nothing was written"


def _facts(job: Job, outcome: Mapping[str, Any] | GonioError) -> dict[str, Any]:
    """What JSON says of a file: its fit as the material file holds it, or why it was refused."""
    if isinstance(outcome, GonioError):
        return {"file": str(job.file), "written": None, "refused": str(outcome)}
    facts = {key: outcome.get(key) for key in ("converged", "requested", "metrics", "judgement", "samples")}
    return {"file": str(job.file), "written": str(job.target), **facts}


def _write_outcome(job: Job, outcome: Any, count: str, force: bool) -> int:
    """Writes and prints one result or refusal; its exit status."""
    import tomli_w

    start = f"{count} {job.file.name}: "
    if isinstance(outcome, GonioError):
        show(f"{start}refused: {outcome}")
        return 2
    content = outcome.to_material_dict(job.target.name.removesuffix(SUFFIX)) | {"recipe": job.recipe}
    write_text(str(job.target), tomli_w.dumps(content), force)
    show(
        f"{start}{'converged' if outcome.converged else 'NOT converged'}, {outcome.requested}, relative rms "
        f"{outcome.metrics['relative_rms']:.3g}, {outcome.starts_agreed} of {outcome.starts} starts agree, "
        f"{outcome.seconds['fit']:.2f} s"
    )
    return outcome.exit_status


def _files(names: Sequence[str]) -> tuple[list[Path], int]:
    """(files to fit, number of files of the folders that are no tables)."""
    files: list[Path] = []
    ignored = 0
    for path in map(Path, names):
        if not path.exists():
            raise GonioError(_not_there(str(path)))
        if not path.is_dir():
            files.append(path)
            continue
        inside = [p for p in sorted(path.iterdir()) if p.is_file() and not p.name.startswith(".")]
        tables = [p for p in inside if _is_table(p)]
        if not tables:
            raise GonioError(f"{path} holds no table that can be read; name a folder of tables, or the files.")
        files += tables
        ignored += len(inside) - len(tables)
    return files, ignored


def _not_there(name: str) -> str:
    """Why a name is no file: it may be the model, whose option was forgotten."""
    from gonio.models.expression.parser import parse

    try:
        parse(name)
    except GonioError:
        return f"{name} does not exist; check the name and the folder."
    return f"{name} is a model, not a file; give models by -m, as in: gonio fit TABLE -m '{name}'."


def _is_table(path: Path) -> bool:
    from gonio.data.formats.registry import sniff

    try:
        return sniff(path).holds == "table"
    except GonioError:
        return False


def _targets(files: Sequence[Path], folder: Path) -> list[Path]:
    sources: dict[Path, Path] = {}
    for path in files:
        target = folder / f"{path.stem}{SUFFIX}"
        if target in sources:
            raise GonioError(
                f"{sources[target]} and {path} would both be written to {target}; fit them into different folders."
            )
        sources[target] = path
    return list(sources)


def _recipe(args: argparse.Namespace, options: dict[str, Any], path: Path) -> dict[str, Any]:
    """What a result depends on, as TOML can hold it: file, model, options and program."""
    from gonio import __version__

    digest = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
    how = {"model": args.model, "channel": args.channel, "merl_nodes": args.merl_nodes, **options}
    how |= {name: getattr(args, name) for name in ("angles", "quantity", "missing")}
    how = {name: value for name, value in how.items() if value is not None}
    return {"file": path.name, "sha256": digest, "gonio": __version__, **how}


def _is_finished(job: Job) -> bool:
    """Whether the result is there already, made by this recipe; GonioError where it was made otherwise."""
    if not job.target.exists():
        return False
    try:
        recipe = tomllib.loads(job.target.read_text(encoding="utf-8")).get("recipe")
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        recipe = None
    if recipe != job.recipe:
        why = "is no result of a batch" if recipe is None else "was fitted from another file or by another command"
        raise GonioError(f"{job.target} {why}; name another folder with -o, or --force to replace it.")
    return True


def _remove_stale(jobs: Sequence[Job]) -> None:
    """Removes what a killed batch was writing."""
    for job in jobs:
        for path in job.target.parent.glob(f".{job.target.name}.*.tmp"):
            if time.time() - path.stat().st_mtime > STALE:
                path.unlink(missing_ok=True)

"""``gonio fit`` of many files or a folder: one line and one file each, and a killed batch goes on where it stopped."""

import argparse
from pathlib import Path
from typing import Any

SUFFIX = ".fit.toml"


def is_batch(files: list[str]) -> bool:
    """Whether the files of a command line are many: more than one, or a folder."""
    return len(files) > 1 or Path(files[0]).is_dir()


def run_batch(args: argparse.Namespace, table_of, options: dict[str, Any]) -> int:
    """Fits of all files, each written to the folder `args.output` as soon as it is finished.

    `table_of` reads one file; `options` are those of `gonio.fit`. A result that is there already is kept if it was made
    of the same file by the same command. Exit status 2 if a file was refused, else 1 if a fit did not converge, else 0.
    """
    import time

    import tomli_w

    from gonio.data.files import new_file
    from gonio.models.errors import GonioError
    from gonio.text import say

    if args.json:
        raise GonioError("--json takes the fit of a single file; of many, each material file holds everything already.")
    from gonio.models.expression.parser import parse

    for model in args.model or []:
        parse(model)  # a wrong word is said once, not of every file
    folder = Path(args.output or ".")
    if folder.exists() and not folder.is_dir():
        raise GonioError(f"{folder} is a file; of many files, -o names the folder of the results.")
    files, ignored = _files(args.files)
    targets = _targets(files, folder)
    recipes = [_recipe(args, options, path) for path in files]
    there = [_there(target, recipe, args.force) for target, recipe in zip(targets, recipes, strict=True)]
    folder.mkdir(parents=True, exist_ok=True)
    _clear(targets)
    say(f"{len(files)} tables" + (f", {ignored} other files passed over" if ignored else ""))
    if any(there):
        say(f"{sum(there)} of them were fitted before and are kept")
    left = [k for k, done in enumerate(there) if not done]
    if not left:
        return 0 if all(_converged(target) for target in targets) else 1
    from gonio.fitting.batch import as_fitted

    began, number, worst = time.perf_counter(), len(files) - len(left), 0
    for k, target in enumerate(targets):
        if there[k] and not _converged(target):
            worst = 1
    for at, outcome in as_fitted([lambda path=files[k]: table_of(path) for k in left], args.model, **options):
        k, number = left[at], number + 1
        start = f"[{number}/{len(files)}] {files[k].name}: "
        if isinstance(outcome, GonioError):
            say(f"{start}refused: {outcome}")
            worst = 2
            continue
        held = outcome.to_material_dict(targets[k].name.removesuffix(SUFFIX))
        held["recipe"] = recipes[k]
        with new_file(targets[k], args.force) as path:
            path.write_text(tomli_w.dumps(held), encoding="utf-8")
        worst = max(worst, outcome.exit_status)
        say(
            f"{start}{'converged' if outcome.converged else 'NOT converged'}, {outcome.asked}, relative rms "
            f"{outcome.metrics['relative_rms']:.3g}, {outcome.starts_agreed} of {outcome.starts} starts agree, "
            f"{outcome.seconds['fit']:.2f} s"
        )
    seconds = time.perf_counter() - began
    say(f"{len(left)} fits in {seconds:.1f} s, {len(left) / seconds:.3g} a second; written to {folder}")
    return worst


def _files(given: list[str]) -> tuple[list[Path], int]:
    """(files to fit, number of files of the folders that are no tables)."""
    from gonio.data.formats.registry import sniff
    from gonio.models.errors import GonioError

    files, ignored = [], 0
    for name in given:
        path = Path(name)
        if not path.is_dir():
            files.append(path)
            continue
        inside = [p for p in sorted(path.iterdir()) if p.is_file() and not p.name.startswith(".")]
        for p in inside:
            try:
                sniff(p)
            except GonioError:
                ignored += 1
            else:
                files.append(p)
        if not any(p.parent == path for p in files):
            raise GonioError(f"{path} holds no table that can be read; name a folder of tables, or the files.")
    return files, ignored


def _targets(files: list[Path], folder: Path) -> list[Path]:
    from gonio.models.errors import GonioError

    targets, taken = [], {}
    for path in files:
        target = folder / f"{path.stem}{SUFFIX}"
        if target in taken:
            raise GonioError(
                f"{taken[target]} and {path} would both be written to {target}; fit them into different folders."
            )
        taken[target] = path
        targets.append(target)
    return targets


def _recipe(args: argparse.Namespace, options: dict[str, Any], path: Path) -> dict[str, Any]:
    """What a result depends on, as TOML can hold it: file, model, options and program."""
    import hashlib

    from gonio import __version__

    digest = ""
    if path.is_file():
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    said = {"model": args.model, "channel": args.channel, "merl_nodes": args.merl_nodes, **options}
    said = {name: value for name, value in said.items() if value is not None}
    return {"file": path.name, "sha256": digest, "gonio": __version__, **said}


def _there(target: Path, recipe: dict[str, Any], force: bool) -> bool:
    """Whether a result is there already, made by this recipe; GonioError where it was made otherwise."""
    import tomllib

    from gonio.models.errors import GonioError

    if force or not target.exists():
        return False
    try:
        held = tomllib.loads(target.read_text(encoding="utf-8")).get("recipe")
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        held = None
    if held != recipe:
        why = "is no result of a batch" if held is None else "was fitted from another file or by another command"
        raise GonioError(f"{target} {why}; name another folder with -o, or --force to replace it.")
    return True


def _converged(target: Path) -> bool:
    import tomllib

    return bool(tomllib.loads(target.read_text(encoding="utf-8"))["fit"]["converged"])


def _clear(targets: list[Path]) -> None:
    # What a killed batch was writing: never a result. Nothing is written for as long as a minute.
    import time

    for target in targets:
        for left in target.parent.glob(f".{target.name}.*.tmp"):
            if time.time() - left.stat().st_mtime > 60:
                left.unlink(missing_ok=True)

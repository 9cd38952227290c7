"""What several verbs share: tables of options, what they refuse before any work, and how they write a text."""

import argparse
import contextlib
import json
import math
import re
import sys
from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, Any, cast

from gonio.models.errors import GonioError, printable
from gonio.text import log

if TYPE_CHECKING:
    from gonio.data.subject import Subject
    from gonio.data.table import Table

MATERIAL = "a reference material, a readable file or an expression"
JSON_FORMAT = 1
"""Of the keys that all JSON of the command line begins with."""
Options = dict[str, str | dict[str, Any]]
"""Options by "-m/--model MODEL" or "--flag", each with its help or with the arguments of `add_argument`."""

FORCE: Options = {"--force": "replace existing outputs"}
MERL: Options = {
    "--merl-nodes": {"choices": ("lower", "centre"), "help": "where a MERL or CSAIL file's nodes lie in their bins"}
}
READING: Options = {
    "--angles": {
        "choices": ("degrees", "radians"),
        "help": "unit of the angles of a CSV or ASTM file, where the file does not say it",
    },
    "--quantity KIND": {
        "choices": ("brdf", "brdf_cos", "brdf_cos_i", "reflectance_factor", "i_over_f"),
        "help": "what a file's values are: brdf (f, the default), brdf_cos (f cos(theta_o)), brdf_cos_i "
        "(f cos(theta_i)), reflectance_factor (π f) or i_over_f (π f cos(theta_i))",
    },
    "--missing VALUE": "the number that stands for no reading in a CSV file, such as -999; none: there is none",
    "--mirror-azimuth DEG": {
        "choices": (0, 180),
        "type": int,
        "help": "azimuth of the mirror side from the light in a CSV or a laboratory's file: 180 (default) or 0",
    },
    "--scale X": "f over the numbers of a UTIA or CSAIL file (default 1); tis: each incidence of Zemax to its TIS",
    "--coverage K": {
        "type": float,
        "help": "standard uncertainties in those of a CSV, BiRD or ALTA file (default: as it says, else 1)",
    },
}
"""How a file of readings is to be taken; of verbs that take any file."""
DESCRIPTION: Options = {"--instrument LAB.toml": "a description of the instrument; options given beside it win"}
UNITS = {"h": 3600.0, "min": 60.0, "s": 1.0}
"""Of time, in seconds."""
OUTPUT: Options = {
    "-q/--quiet": "print errors only; the exit status is the verdict",
    "-v/--verbose": "print everything that is known",
}
"""Of every verb."""
JSON: Options = {
    "--json FILE.json": {
        "nargs": "?",
        "const": "-",
        "help": "print the result as JSON in place of words, or write it to FILE.json beside them",
    }
}
"""Of every verb that says numbers."""


def degrees(text: str) -> float:
    """Radians of an angle that is written in degrees."""
    return math.radians(float(text))


def seconds_of(text: str) -> float:
    """Seconds of a time such as 2h, 1h30min or 90s. Raises GonioError for what is none."""
    parts = re.findall(r"(\d+(?:\.\d+)?|\.\d+)\s*(h|min|s)", text)
    if not parts or re.sub(r"\s", "", "".join(v + u for v, u in parts)) != re.sub(r"\s", "", text):
        raise GonioError(f"--budget is {text!r}; give a time, such as 2h, 30min or 90s")
    return sum(float(value) * UNITS[unit] for value, unit in parts)


def hours(seconds: float) -> str:
    """Seconds as text: 1.5 h, 12 min or 40 s."""
    unit = next((u for u, size in UNITS.items() if seconds >= size), "s")
    return f"{seconds / UNITS[unit]:.3g} {unit}"


def share_of(text: str, option: str = "--target") -> float:
    """A share written as 1% or 0.01. Raises GonioError, naming the option, for what is none."""
    try:
        return float(text.rstrip("%").strip()) / (100 if text.strip().endswith("%") else 1)
    except ValueError:
        raise GonioError(f"{option} is {text!r}; give a share, such as 1% or 0.01") from None


def json_name(text: str) -> str:
    """Where JSON goes; the ending keeps an input that is meant to be read from being taken for it."""
    if text != "-" and not text.lower().endswith(".json"):
        raise argparse.ArgumentTypeError(
            f"--json is {text!r}; give a name that ends in .json, or put --json last to print it"
        )
    return text


def number_or_tis(text: str) -> float | str:
    """What scales a file's numbers. Raises ArgumentTypeError for what is neither."""
    try:
        return text.lower() if text.lower() == "tis" else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"--scale is {text!r}; give a number, or tis") from None


KINDS: dict[str, Callable[[str], Any]] = {
    "DEG": degrees, "DEG/S": degrees, "N": int, "SEED": int, "FILE.json": json_name,
    "X": number_or_tis,
    **dict.fromkeys(("SHARE", "REL", "ERROR", "T", "P", "1/S"), float),
}  # fmt: skip


def add_options(add: Callable[..., object], options: Options, **kinds: Callable[[str], Any]) -> None:
    """Adds options to a verb.

    Args:
        add: `add_argument` of the verb's parser, or of a group of it.
        options: the word in capitals decides the type (see `KINDS`).
        kinds: types of this verb's words in capitals, where `KINDS` has another or none.
    """
    for words, text in options.items():
        names, _, word = words.partition(" ")
        how: dict[str, Any] = {"help": text} if isinstance(text, str) else dict(text)
        if word:
            how = {"metavar": word, "type": (KINDS | kinds).get(word, str), **how}
        elif "choices" not in how:
            how["action"] = "store_true"
        add(*names.split("/"), **how)


def words_of(args: argparse.Namespace, name: str) -> list[str]:
    """The words of an argument that takes one or several; none where it takes something else."""
    value = getattr(args, name, None)
    every = cast("list[object]", value) if isinstance(value, list) else [value]
    return [word for word in every if isinstance(word, str)]


def given(args: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Those of the options that the command line gives."""
    return {name: getattr(args, name) for name in names if getattr(args, name) is not None}


def reading_options(args: argparse.Namespace) -> dict[str, Any]:
    """The keywords by which `gonio.data.formats.registry.load` takes a file as the command line says."""
    names = ("angles", "quantity", "missing", "mirror_azimuth", "coverage", "scale")
    options = {name: getattr(args, name, None) for name in names}
    options["nodes"] = getattr(args, "merl_nodes", None)
    return {name: value for name, value in options.items() if value is not None}


def read_table(path: str, args: argparse.Namespace, blockwise: bool = False) -> "Table":
    """The table of a file, named after the file where it has no name of its own; its warnings go to standard error.

    `blockwise`: the values of a large one stay in the file, as they are read in blocks anyway.
    """
    from gonio.data.files import stem
    from gonio.data.formats.registry import is_there, read

    if not is_there(path):
        from gonio.data.subject import resolve_subject

        resolve_subject(path).require_table()  # says what the name is instead, and what to do
    table = read(path, blockwise=blockwise, **reading_options(args))
    table.name = table.name or stem(path)
    for warning in table.provenance.get("warnings", []):
        log(f"gonio: {path}: {warning}")
    return table


def as_stated(subject: str, args: argparse.Namespace) -> "Subject | str":
    """A subject, read as the command line says; itself where that says nothing.

    Raises GonioError where it is no file of readings.
    """
    options = reading_options(args)
    if not options:
        return subject
    from gonio.data.formats.registry import is_there
    from gonio.data.subject import resolve_subject

    if not is_there(subject):
        raise GonioError(f"{subject} is no file, so leave --{next(iter(options))} out")
    return resolve_subject(subject, **options)


def beside_stated(subject: str, args: argparse.Namespace) -> "Subject | str":
    """Another subject, read as the command line says as far as its format knows of it; itself where that is nothing."""
    from gonio.data.formats.registry import is_there, sniff
    from gonio.data.subject import resolve_subject

    if not is_there(subject):
        return subject
    options = {name: value for name, value in reading_options(args).items() if name in sniff(subject).options}
    return resolve_subject(subject, **options) if options else subject


def stated_terms(text: str) -> dict[str, str]:
    """The texts of stated uncertainties, by the names of their terms."""
    stated: dict[str, str] = {}
    for item in text.split(","):
        name, equals, value = (piece.strip() for piece in item.partition("="))
        if not (name and equals and value):
            raise GonioError(f"--uncertainty has {item.strip()!r}; give NAME=U, such as gain=0.5 %")
        stated[name] = value
    return stated


def require_degrees(option: str, angle: float | None, low: float, high: float) -> None:
    """Refuses an angle, radians, outside of [low, high], degrees; None is no angle."""
    if angle is not None and not low <= (value := round(math.degrees(angle), 9)) <= high:
        raise GonioError(f"{option} is {value:g}; give degrees from {low:g} to {high:g}")


def write_text(path: str, text: str, force: bool) -> None:
    """Writes a text whole or not at all; "-" is standard output."""
    if path == "-":
        sys.stdout.write(text)
        return
    from gonio.data.files import new_file

    with new_file(path, force) as temporary:
        temporary.write_text(text, encoding="utf-8")


def refuse_json(args: argparse.Namespace) -> None:
    """Raises GonioError, before any work, where the JSON's file is there already, or is an input of the verb."""
    from gonio.data.files import refuse_outputs

    names = [name for name in vars(args) if name not in ("json", "output", "picture", "repair")]
    refuse_outputs([args.json], [w for name in names for w in words_of(args, name)], getattr(args, "force", False))


@contextlib.contextmanager
def writing_json(args: argparse.Namespace, content: dict[str, Any], status: int = 0) -> Generator[None]:
    """Writes JSON, if it is wanted, where the block ends well, after room for it was found: both outputs, or none.

    Args:
        args: of the verb: `json` says where it goes, "-" is standard output.
        content: what the verb says; numbers that are not finite become null, see `gonio.data.serialise.finite`.
        status: the exit status.
    """
    if args.json is None or args.json == "-":
        yield
        if args.json is not None:
            sys.stdout.write(_json_text(args, content, status))
        return
    from gonio.data.files import new_file

    with new_file(args.json, getattr(args, "force", False)) as temporary:
        temporary.write_text(_json_text(args, content, status), encoding="utf-8")
        yield


def _json_text(args: argparse.Namespace, content: dict[str, Any], status: int) -> str:
    from gonio import __version__
    from gonio.data.serialise import finite

    head = {"gonio_json": JSON_FORMAT, "verb": args.verb, "gonio": __version__, "exit_status": status}
    text = json.dumps(head | finite(content), indent=2, ensure_ascii=False, allow_nan=False)
    return printable(text, kept="\n") + "\n"


def write_json(args: argparse.Namespace, content: dict[str, Any], status: int = 0) -> int:
    """Writes JSON as `writing_json` does; returns the exit status."""
    with writing_json(args, content, status):
        pass
    return status

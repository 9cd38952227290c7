"""What a recipe lists, each with its name in the catalogue and with what determines it: materials, instruments, ..."""

import dataclasses
import glob
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from gonio.campaigns.keys import digest_of
from gonio.data.channels import Channels
from gonio.data.files import check_keys, stem
from gonio.data.scene import load_scene
from gonio.data.subject import REFERENCE_FOLDER, load_material, reference_materials
from gonio.instrument.description import instrument_from, read_instrument
from gonio.instrument.instrument import Instrument
from gonio.instrument.scans import SCANS, is_file, scan
from gonio.models.errors import GonioError
from gonio.models.expression.parser import parse, with_defaults

USUAL_SCAN = "default"
"""The scan that a material takes if nothing is said."""
SCAN_ANGLES = ("step", "phi_step", "theta_max")
SCAN_KEYS: dict[str, Any] = {
    "scan": (str, "the name of a scan"), "theta_i": (list, "a list of degrees"),
    **dict.fromkeys(SCAN_ANGLES, (int | float, "degrees")), **dict.fromkeys(("hemisphere", "lit"), (str, "a text")),
}  # fmt: skip
ELSEWHERE = {"rgl": "gonio measure --scan rgl", "offsets": "gonio measure --scan offsets"}


class Choice(NamedTuple):
    """One entry of a list: its name, what a task takes, what determines it (for the key), and its channels."""

    label: str
    value: Any
    spec: dict[str, Any]
    channels: int = 1


def path_in(folder: Path, text: str) -> Path:
    """A path of a recipe, which is relative to the recipe's folder."""
    return (folder / os.path.expanduser(text)).absolute()


def files_of(text: str, folder: Path, what: str) -> list[Path]:
    """The files of a name or a pattern such as tables/*.h5, sorted. Raises GonioError where there are none."""
    path = path_in(folder, text)
    if not any(c in text for c in "*?["):
        return [path]
    files = sorted(Path(p) for p in glob.glob(str(path), recursive=True) if os.path.isfile(p))
    if not files:
        raise GonioError(f"no file is named {text}; give {what} that are there")
    return files


def _each(texts: Sequence[Any], make: Callable[[Any], list[Choice]], where: str) -> tuple[Choice, ...]:
    """Choices without repetition; those of one label get numbers."""
    choices: dict[str, Choice] = {}
    for text in texts:
        for choice in make(text):
            choices.setdefault(str(sorted(choice.spec.items())), choice)
    if not choices:
        raise GonioError(f"{where} is empty; give one at least")
    labels: dict[str, int] = {}
    named = []
    for choice in choices.values():
        labels[choice.label] = count = labels.get(choice.label, 0) + 1
        named.append(choice._replace(label=f"{choice.label} ({count})") if count > 1 else choice)
    return tuple(named)


def materials_of(texts: Sequence[str], folder: Path) -> tuple[Choice, ...]:
    """Reference materials, files and expressions; each is looked up, so that what is none ends before any work."""

    def make(text: str) -> list[Choice]:
        if text in reference_materials():
            spec = {"reference": text, "sha256": digest_of(REFERENCE_FOLDER / f"{text}.toml")}
            return [Choice(text, text, spec, _channels(text))]
        if "(" not in text and (any(c in text for c in "*?[") or path_in(folder, text).exists()):
            files = files_of(text, folder, "materials")
            return [
                Choice(stem(f).removesuffix(".fit"), f, {"file": f.name, "sha256": digest_of(f)}, _channels(f))
                for f in files
            ]
        return [Choice(text.strip(), text.strip(), {"expression": text.strip()}, _channels(text.strip()))]

    return _each(texts, make, "materials")


def _channels(material: str | Path) -> int:
    channels: Channels = load_material(material).channels
    return len(channels)


def instruments_of(entries: Sequence[str | dict[str, Any]], folder: Path) -> tuple[Choice, ...]:
    """Instruments: files of descriptions, or tables of the entries of such a file, with `photons` too."""

    def make(entry: str | dict[str, Any]) -> list[Choice]:
        if isinstance(entry, str):
            if entry == "ideal":
                return make({})
            return [_instrument(stem(f), read_instrument(f)) for f in files_of(entry, folder, "instruments")]
        content = dict(entry)
        photons, name = content.pop("photons", None), content.get("name")
        if not isinstance(photons, int | float | None) or isinstance(photons, bool):
            raise GonioError(f"photons is {photons!r}; give a number")
        instrument = instrument_from(content, "an instrument: ")
        if photons is not None:
            instrument = dataclasses.replace(instrument, photons=float(photons))
        return [_instrument(name or _in_words(entry) or "ideal", instrument)]

    return _each(entries, make, "instruments")


def _instrument(label: str, instrument: Instrument) -> Choice:
    return Choice(label, instrument, instrument_spec(instrument))


def instrument_spec(instrument: Instrument) -> dict[str, Any]:
    """The numbers of an instrument as JSON can hold them, but for names."""
    return dataclasses.asdict(instrument)


def _in_words(entry: dict[str, Any]) -> str:
    return ", ".join(
        f"{key} {value:g}" if isinstance(value, float) else f"{key} {value}" for key, value in entry.items()
    )


def scans_of(entries: Sequence[str | dict[str, Any]], folder: Path) -> tuple[Choice, ...]:
    """Scans: names, CSV files of directions, or tables with `scan` and its options, angles in degrees."""

    def make(entry: str | dict[str, Any]) -> list[Choice]:
        options: dict[str, Any] = {"scan": entry} if isinstance(entry, str) else dict(entry)
        check_keys(options, SCAN_KEYS, "a scan: ")
        name = options.pop("scan", USUAL_SCAN)
        if name in ELSEWHERE:
            raise GonioError(
                f"scan {name} is no scan of a campaign; measure by '{ELSEWHERE[name]}', and give its tables"
            )
        radians: dict[str, Any] = {key: math.radians(options.pop(key)) for key in SCAN_ANGLES if key in options}
        if "theta_i" in options:
            radians["theta_i"] = _angles(options.pop("theta_i"))
        path = path_in(folder, name)
        known = name.replace("_", "-") in (*SCANS, USUAL_SCAN)
        file = path if not known and (is_file(name) or path.is_file()) else None
        label = name if file is None else stem(file)
        if not isinstance(entry, str):
            words = _in_words({key: value for key, value in entry.items() if key != "scan"})
            label = ", ".join([*([label] if label != USUAL_SCAN else []), *([words] if words else [])]) or USUAL_SCAN
        value = {"name": str(file or name), **radians, **options}
        # Refuses it before any work; the scans that materials take by default have the same options.
        angles: Any = {**radians, **options}
        scan("isotropic" if name == USUAL_SCAN else value["name"], **angles)
        spec = dict(value) if file is None else value | {"name": file.name, "sha256": digest_of(file)}
        return [Choice(label, value, spec)]

    return _each(entries, make, "scans")


def _angles(degrees: list[Any]) -> list[float]:
    if not degrees or not all(isinstance(d, int | float) and not isinstance(d, bool) for d in degrees):
        raise GonioError(f"a scan: theta_i is {degrees!r}; give a list of degrees")
    return [math.radians(d) for d in degrees]


def models_of(texts: Sequence[str]) -> tuple[str | None, ...]:
    """Expressions of models, parsed once so that a wrong word ends before any work; None for "auto"."""
    for text in texts:
        if text != "auto":
            with_defaults(parse(text))
    return tuple(dict.fromkeys(None if text == "auto" else text.strip() for text in texts))


def scenes_of(texts: Sequence[str], folder: Path) -> tuple[Choice, ...]:
    """Scenes: shipped ones by name, or files."""

    def make(text: str) -> list[Choice]:
        if not path_in(folder, text).is_file():
            load_scene(text)
            return [Choice(text, text, {"scene": text})]
        return [
            Choice(stem(f), str(f), {"file": f.name, "sha256": digest_of(f)})
            for f in files_of(text, folder, "scenes")
            if load_scene(f)
        ]

    return _each(texts, make, "reduce") if texts else ()


def tables_of(texts: Sequence[str], folder: Path) -> tuple[Choice, ...]:
    """Files of tables; what they hold is read when their turn comes."""

    def make(text: str) -> list[Choice]:
        files = files_of(text, folder, "tables")
        return [Choice(stem(f), f, {"file": f.name, "sha256": digest_of(f)}) for f in files]

    return _each(texts, make, "tables") if texts else ()

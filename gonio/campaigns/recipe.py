"""The recipe of a campaign: what is measured with what, and what is done with each table. A TOML file.

    gonio_campaign = 1
    name = "two materials in noise"
    tables = ["lab/*.h5"]                     # subjects that are there already
    fit = ["lambert + ggx", "auto"]           # each model to each table
    check = true                              # or a list of: tables, fits, materials
    reduce = ["low_sun_car"]                  # scenes
    report = true                             # a page for each table with its fits

    [[measure]]                               # all combinations of what is listed
    materials = ["gold", "lambert(rho=0.3) + ggx(alpha=0.2)"]
    instruments = ["lab.toml", {detector_half_angle = 0.1}]
    scans = ["isotropic", {scan = "isotropic", step = 10}]
    photons = [1e4, 1e6]
    seeds = "0:100"                           # 0 to 99

    [fit_options]                             # keywords of gonio.fit, angles in degrees
    starts = 4

Paths are relative to the folder of the recipe. A `[[measure]]` may have its own fit, check, reduce and report.
"""

import dataclasses
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gonio.campaigns.choices import Choice, instruments_of, materials_of, models_of, scans_of, scenes_of, tables_of
from gonio.campaigns.entries import MOST, listed, numbers_of, seeds_of
from gonio.checks.certify import CheckSettings
from gonio.data.files import check_keys, read_toml
from gonio.data.serialise import NUMBER, require_kind
from gonio.fitting.options import FitSettings
from gonio.models.errors import GonioError, nearest
from gonio.models.expression.parser import parse

LARGEST = 1 << 20  # bytes
CHECKED = ("tables", "fits", "materials")
ANY: tuple[type, str] = (object, "")
WORK = ("fit", "check", "reduce", "report")
KEYS = {
    "name": (str, "a text"), "description": (str, "a text"), **dict.fromkeys(("tables", *WORK), ANY),
    "fit_options": (dict, "a table of keywords of a fit"), "check_options": (dict, "a table of keywords of a check"),
    "measure": (list, "tables, each under [[measure]]"),
}  # fmt: skip
MEASURE_KEYS: dict[str, tuple[type, str]] = dict.fromkeys(
    ("materials", "instruments", "scans", "photons", "seeds", *WORK), ANY
)
FIT_OPTIONS: dict[str, Any] = {
    **dict.fromkeys(("loss", "weight", "bootstrap_kind", "aperture"), str), "robust": object,
    **dict.fromkeys(("theta_max", "relative_noise"), NUMBER), "per_channel": bool,
    **dict.fromkeys(("bootstrap", "samples", "starts", "seed"), int),
}  # fmt: skip
CHECK_OPTIONS: dict[str, Any] = {"strict": bool, "level": NUMBER, "feature_width": NUMBER, "model": str}
IN_DEGREES = ("theta_max", "feature_width")


@dataclasses.dataclass(frozen=True)
class Work:
    """What is done with each table: models (None selects one) that are fitted, what is checked, scenes, a page."""

    fit: tuple[str | None, ...] = ()
    check: tuple[str, ...] = ()
    reduce: tuple[Choice, ...] = ()
    report: bool = False
    fit_options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    check_options: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def tasks_of_table(self) -> int:
        """Tasks of one table, without measuring it."""
        checks = ("tables" in self.check) + ("fits" in self.check) * len(self.fit)
        return len(self.fit) + checks + len(self.reduce) + self.report


@dataclasses.dataclass(frozen=True)
class MeasureBlock:
    """Tables to be measured: all combinations of what is listed. `photons` has None where the instrument says them."""

    materials: tuple[Choice, ...]
    instruments: tuple[Choice, ...]
    scans: tuple[Choice, ...]
    photons: tuple[float | None, ...]
    seeds: range | tuple[int, ...]
    work: Work

    @property
    def tables(self) -> int:
        """How many tables it measures."""
        return math.prod(map(len, (self.materials, self.instruments, self.scans, self.photons, self.seeds)))


@dataclasses.dataclass(frozen=True)
class Recipe:
    """A campaign as it was asked for, checked; see the module."""

    name: str
    measure: tuple[MeasureBlock, ...]
    tables: tuple[Choice, ...]
    work: Work

    @property
    def tasks(self) -> int:
        """How many tasks it has, at most: equal ones are done once."""
        of_materials = sum(len(b.materials) * ("materials" in b.work.check) for b in self.measure)
        measured = sum(b.tables * (1 + b.work.tasks_of_table) for b in self.measure)
        return of_materials + measured + len(self.tables) * self.work.tasks_of_table


def read_recipe(recipe: str | os.PathLike[str] | Mapping[str, Any]) -> Recipe:
    """The recipe in a TOML file, or in a dictionary of the same entries (without the first; paths from here).

    Raises:
        GonioError: in one sentence that names the file and the key, for anything else.
    """
    if isinstance(recipe, Mapping):
        entries = {key: value for key, value in recipe.items() if key != "gonio_campaign"}
        check_keys(entries, KEYS, "the recipe: ")
        return _recipe(entries, Path(), "campaign")
    path = Path(recipe)
    return read_toml(path, "campaign", LARGEST, KEYS, lambda data: _recipe(data, path.parent, path.stem))


def _recipe(data: dict[str, Any], folder: Path, stem: str) -> Recipe:
    work = _work(data, folder, Work())
    tables = tables_of(listed(data.get("tables", []), str, "tables"), folder)
    blocks = tuple(_block(block, folder, work, f"measure {k}: ") for k, block in enumerate(data.get("measure", []), 1))
    recipe = Recipe(data.get("name", stem), blocks, tables, work)
    if not blocks and not tables:
        raise GonioError("it has no subjects; give tables = [...], or [[measure]] with materials = [...]")
    if recipe.tasks > MOST:
        raise GonioError(f"it makes {recipe.tasks:,} tasks; give at most {MOST:,}, or several recipes")
    if not recipe.measure and not work.tasks_of_table:
        raise GonioError("nothing is done with its tables; give fit, check, reduce or report")
    return recipe


def _block(block: Any, folder: Path, work: Work, where: str) -> MeasureBlock:
    require_kind(block, dict, where.rstrip(": "))
    try:
        check_keys(block, MEASURE_KEYS)
        if "materials" not in block:
            raise GonioError("it has no materials; give materials = [...], names, files or expressions")
        return MeasureBlock(
            materials_of(listed(block["materials"], str, "materials"), folder),
            instruments_of(listed(block.get("instruments", [{}]), (str, dict), "instruments"), folder),
            scans_of(listed(block.get("scans", ["default"]), (str, dict), "scans"), folder),
            numbers_of(block.get("photons"), "photons"),
            seeds_of(block.get("seeds", 0)),
            _work(block, folder, work),
        )
    except GonioError as error:
        raise GonioError(f"{where}{error}") from None


def _work(data: Mapping[str, Any], folder: Path, usual: Work) -> Work:
    """What is done with each table, by the entries of a recipe or a block; what it does not say is as usual."""
    changed: dict[str, Any] = {}
    if "fit" in data:
        changed["fit"] = models_of(listed(data["fit"], str, "fit"))
    if "check" in data:
        changed["check"] = _checked(data["check"])
    if "reduce" in data:
        changed["reduce"] = scenes_of(listed(data["reduce"], str, "reduce"), folder)
    if "report" in data:
        require_kind(data["report"], bool, "report")
        changed["report"] = data["report"]
    if "fit_options" in data:
        changed["fit_options"] = _options(data["fit_options"], FIT_OPTIONS, "fit_options")
        FitSettings.create(changed["fit_options"])
    if "check_options" in data:
        changed["check_options"] = options = _options(data["check_options"], CHECK_OPTIONS, "check_options")
        CheckSettings(**options)
        if options.get("model") not in (None, "auto"):
            parse(options["model"])
    return dataclasses.replace(usual, **changed)


def _options(given: dict[str, Any], known: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Keywords of a verb, of the right kinds, angles in radians."""
    check_keys(given, dict.fromkeys(known, ANY), f"{where}: ")
    for key, value in given.items():
        if known[key] is not object:
            require_kind(value, known[key], f"{where}: {key}")
    if not isinstance(given.get("robust", True), bool | str):
        raise GonioError(f"{where}: robust is {given['robust']!r}; give true, or the name of the weights")
    return {key: math.radians(value) if key in IN_DEGREES else value for key, value in given.items()}


def _checked(value: Any) -> tuple[str, ...]:
    if isinstance(value, bool):
        return CHECKED[:1] if value else ()
    names = listed(value, str, "check")
    for name in names:
        if name not in CHECKED:
            raise GonioError(f"check has '{name}'; {nearest(name, CHECKED)}")
    return tuple(dict.fromkeys(names))

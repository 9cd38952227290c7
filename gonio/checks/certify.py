"""`check`: is this model, or this table, reciprocal, and does it conserve energy?"""

import os
from typing import Any

from gonio.checks.certificate import NAMES, Certificate, Property
from gonio.checks.table.significance import LEVEL
from gonio.data.material import Material
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError

MODEL_TOLERANCES = {
    "reciprocity": 1e-9,
    "energy": 1e-6,
    "positivity": 1e-9,
    "symmetry": 1e-9,
    "isotropy": 1e-6,
    "pole": 1e-3,
    "horizon": 1e-3,
    "agreement": 1e-6,
}
TABLE_TOLERANCES = {
    "reciprocity": 0.05,
    "energy": 0.01,
    "positivity": 0.01,
    "symmetry": 0.05,
    "isotropy": 0.05,
    "pole": 0.05,
    "horizon": 0.5,
    "agreement": 0.05,
}


def check(
    subject: "Material | AbstractBRDF | Table | str | os.PathLike",
    *,
    tolerances: dict[str, float] | None = None,
    strict: bool = False,
    feature_width: float = 0.0,
    level: float = LEVEL,
    against: "Material | AbstractBRDF | Table | str | os.PathLike | None" = None,
    name: str | None = None,
) -> Certificate:
    """Judges reciprocity, energy conservation, positivity, symmetries and edges of a model or a table.

    `subject` may be a material, a model, a table, or what names one: a reference material, an expression, a file.
    `tolerances` replaces defaults by name. With `strict` all properties make the overall verdict, else reciprocity,
    energy and agreement. `feature_width`, radians: for tables, no lobe is taken to be narrower than this (0: as narrow
    as they come), so a grid that never looks into the mirror direction may still be judged. `level`: for tables that
    store uncertainties, the chance of calling an honest one significantly wrong, in (0, 0.5]. `against` is the truth,
    where one is known: agreement with it is then judged too, as it alone shows what breaks no law. Raises GonioError
    for a subject that cannot be read, and for a tolerance or level that is unknown or out of range.
    """
    if not 0 < level <= 0.5:
        raise GonioError(f"the level is {level}; give a chance above 0 and up to 0.5, such as 0.01")
    kind, title, thing, channels = _subject(subject)
    title = name or title
    truth = None if against is None else _subject(against)[2]
    limits = limits_of(MODEL_TOLERANCES if kind == "model" else TABLE_TOLERANCES, tolerances)
    if kind == "model":
        from gonio.checks.model.edges import model_horizon, model_pole
        from gonio.checks.model.energy import model_energy
        from gonio.checks.model.isotropy import model_isotropy
        from gonio.checks.model.positivity import model_positivity, model_symmetry
        from gonio.checks.model.reciprocity import model_reciprocity

        found = [
            model_reciprocity(thing, limits["reciprocity"]),
            model_energy(thing, limits["energy"]),
            model_positivity(thing, limits["positivity"]),
            model_symmetry(thing, limits["symmetry"]),
            model_isotropy(thing, limits["isotropy"]),
            model_pole(thing, limits["pole"]),
            model_horizon(thing, limits["horizon"]),
        ]
    else:
        from gonio.checks.certify_table import check_table

        found = check_table(thing, limits, feature_width, level)
    if truth is not None:
        found.append(_agreement(thing, truth, limits["agreement"], level))
    for p in found:
        p.where = _with_channel_name(p.where, channels)
        if "strongest_at" in p.facts:
            p.facts["strongest_at"] = _with_channel_name(p.facts["strongest_at"], channels)
    return Certificate(title, kind, found, strict)


def _with_channel_name(where: dict[str, Any], channels: tuple[str, ...]) -> dict[str, Any]:
    """A copy of a place with its channel's name for the number; places may be shared, so none is changed."""
    return {**where, "channel": channels[where["channel"]]} if channels and "channel" in where else where


def _agreement(thing: AbstractBRDF | Table, truth: AbstractBRDF | Table, tolerance: float, level: float) -> Property:
    from gonio.checks.model.agreement import model_agreement, table_agreement

    if isinstance(truth, Table):
        from gonio.data.interpolation.multilinear import as_material

        truth = as_material(truth)
    if isinstance(thing, Table):
        return table_agreement(thing, truth, tolerance, level)
    return model_agreement(thing, truth, tolerance)


def limits_of(defaults: dict[str, float], given: dict[str, float] | None) -> dict[str, float]:
    """Tolerances by name, with those that are given; GonioError for an unknown name or a negative number."""
    given = {k: v for k, v in (given or {}).items() if v is not None}
    for key, value in given.items():
        if key not in NAMES:
            raise GonioError(f"there is no tolerance of {key!r}; expected one of {', '.join(NAMES)}")
        if not value >= 0 or value == float("inf"):
            raise GonioError(f"the tolerance of {key} is {value}; give a number from 0 up")
    return {**defaults, **given}


def _subject(subject: Any) -> tuple[str, str, Any, tuple[str, ...]]:
    """(kind, title, what is judged, names of its channels) of whatever was given."""
    if isinstance(subject, Table):
        return "table", subject.name or "table", subject, subject.channels.names
    if isinstance(subject, AbstractBRDF):
        return "model", _title(subject), subject, ()
    if isinstance(subject, str | os.PathLike):
        from gonio.data.material import load_material

        subject = load_material(subject)
    if not isinstance(subject, Material):
        raise GonioError(f"a {type(subject).__name__} cannot be checked; give a material, a model, a table or a file")
    if subject.expression is None and subject.meta.get("file"):
        from gonio.data.formats.registry import read

        # The readings themselves are judged, not what lies between them.
        table = read(subject.meta["file"])
        return "table", subject.name, table, table.channels.names
    return "model", subject.name, subject.brdf, subject.channels.names


def _title(brdf: AbstractBRDF) -> str:
    from gonio.models.expression.builder import to_expression

    try:
        return to_expression(brdf)
    except GonioError:
        return type(brdf).__name__

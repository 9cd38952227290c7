"""`check`: is this model, or this table, reciprocal, and does it conserve energy?"""

from typing import Any

from gonio.checks.certificate import NAMES, Certificate, Property
from gonio.checks.table.significance import LEVEL
from gonio.data.subject import SubjectLike, resolve_subject
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
    subject: SubjectLike,
    *,
    tolerances: dict[str, float] | None = None,
    strict: bool = False,
    feature_width: float = 0.0,
    level: float = LEVEL,
    against: SubjectLike | None = None,
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
    subject = resolve_subject(subject)
    kind, channels = subject.kind, subject.channels.names
    thing = subject.brdf if subject.table is None else subject.table
    truth = None if against is None else resolve_subject(against).brdf
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
    return Certificate(name or subject.name, kind, found, strict)


def _with_channel_name(where: dict[str, Any], channels: tuple[str, ...]) -> dict[str, Any]:
    """A copy of a place with its channel's name for the number; places may be shared, so none is changed."""
    return {**where, "channel": channels[where["channel"]]} if "channel" in where else where


def _agreement(thing: AbstractBRDF | Table, truth: AbstractBRDF, tolerance: float, level: float) -> Property:
    from gonio.checks.model.agreement import model_agreement, table_agreement

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

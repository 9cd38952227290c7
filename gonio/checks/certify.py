"""`check`: is this model, or this table, reciprocal, and does it conserve energy?"""

import dataclasses
import pkgutil
from collections.abc import Mapping
from typing import TYPE_CHECKING, TypedDict, Unpack

from gonio.checks.certificate import Certificate, Property
from gonio.checks.properties import PROPERTIES
from gonio.checks.table.evidence import LEVEL, TableEvidence
from gonio.checks.table.further_readings import joined, require_alike
from gonio.data.profile_files import profile_of
from gonio.data.subject import Subject, SubjectLike, resolve_subject
from gonio.data.table import Table
from gonio.instrument.instrument import Instrument
from gonio.instrument.media import with_media
from gonio.models.deprecation import settings_of
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.checks.model.evidence import ModelEvidence
    from gonio.models.brdf import AbstractBRDF


class CheckOptions(TypedDict, total=False):
    """Keywords of `gonio.check`; `help(gonio.check)` describes each."""

    tolerances: Mapping[str, float | None] | None
    strict: bool
    feature_width: float
    level: float
    against: SubjectLike | None
    model: str | None
    further: SubjectLike | None
    instrument: Instrument | None
    name: str | None


@dataclasses.dataclass(frozen=True)
class CheckSettings:
    """The options of a check, complete and checked; see `gonio.check`."""

    tolerances: Mapping[str, float | None] | None = None
    strict: bool = False
    feature_width: float = 0.0
    level: float = LEVEL
    against: SubjectLike | None = None
    model: str | None = None
    further: SubjectLike | None = None
    instrument: Instrument | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        if not 0 < self.level <= 0.5:
            raise GonioError(f"the level is {self.level}; give a chance above 0 and up to 0.5, such as 0.01")


def check(subject: SubjectLike, **options: Unpack[CheckOptions]) -> Certificate:
    """Judges reciprocity, energy conservation, positivity, symmetries and edges of a model or a table.

    Args:
        subject: a material, a model, a table, a fit result, or what names one: a file, a reference material, an
            expression.
        tolerances: replace the defaults by the property's name (see `gonio.checks.properties`); None keeps a default.
        strict: all properties but isotropy make the overall verdict, else reciprocity, energy and agreement.
        feature_width: radians, tables only: no lobe is narrower than this (0: as narrow as they come), so that a grid
            without readings in the mirror direction may be judged.
        level: for tables that store uncertainties, the chance of calling an honest one significantly wrong, in
            (0, 0.5].
        against: the truth, where one is known, or a table of the same surface: agreement with it is then judged too,
            with a table where it was read, by no more than its readings show between them.
        model: tables: an expression with free numbers as in `gonio.fit`, or "auto"; where the readings alone leave
            energy undecided, the model is fitted and its exact albedo carries the verdict, with a bound by how far the
            readings follow it; where they leave reciprocity open for want of exchanged directions, their ratio to the
            model is interpolated there.
        further: tables only: more readings of the same surface, such as `gonio.plan_energy` names. A list is judged
            with them; of a grid energy takes them into account.
        instrument: tables only: its `media` are those in front of the sample and behind it, where the table does not
            state them.
        name: what the certificate calls the subject.

    Returns:
        The certificate: a verdict on each property, with its residual and a bound on the residual's error.

    Raises:
        GonioError: for a subject that cannot be read, and for a tolerance or level that is unknown or out of range.
    """
    settings = settings_of(CheckSettings, "check", options)
    given = _checked(settings.tolerances or {})
    if (profile := profile_of(subject)) is not None:
        from gonio.checks.subsurface import check_profile

        _refuse_options_of_tables(settings, "a profile")
        return check_profile(profile, settings.name or profile.name or "profile", given, settings.level)
    judged = resolve_subject(subject, blockwise=True)
    if judged.material is not None and (below := _below_the_surface(judged, settings, given)) is not None:
        return below
    evidence = _evidence(judged, settings)
    every = (judged_property(key, judged.kind, evidence, given.get(key)) for key in PROPERTIES)
    return certificate_of(judged, settings, [p for p in every if p is not None])


def judged_property(
    key: str, kind: str, evidence: "ModelEvidence | TableEvidence", tolerance: float | None = None
) -> Property | None:
    """One of the properties by its name, of a "table" or a "model"; None where it is not judged."""
    spec = PROPERTIES[key]
    path = getattr(spec, kind)
    beside_readings = not isinstance(evidence, TableEvidence) and evidence.readings is not None
    stated = evidence.reference is not None or beside_readings
    if path is None or (spec.needs_reference and not stated):
        return None
    if tolerance is None:
        # Between the readings of another table nothing is known as well as a model's tolerance asks.
        by_readings = kind == "table" or (spec.needs_reference and beside_readings)
        tolerance = spec.table_tolerance if by_readings else spec.model_tolerance
    return pkgutil.resolve_name(f"gonio.checks.{path}")(evidence, tolerance)


def certificate_of(judged: Subject, settings: CheckSettings, properties: list[Property]) -> Certificate:
    """The certificate of a subject with these properties."""
    return Certificate(settings.name or judged.name, judged.kind, properties, settings.strict, _notes(judged))


def _notes(judged: Subject) -> list[str]:
    """What limits the use of a subject's values."""
    if judged.table is not None:
        return list(judged.table.provenance.get("warnings", []))
    from gonio.fitting.material_warnings import material_warnings

    return material_warnings(judged.as_material())


def _below_the_surface(judged: Subject, settings: CheckSettings, given: dict[str, float]) -> Certificate | None:
    """The certificate of a model of light below the surface; None for others."""
    from gonio.models.subsurface.wide_spots import WideSpots

    if not isinstance(judged.brdf, WideSpots):
        return None
    from gonio.checks.subsurface import check_bssrdf

    _refuse_options_of_tables(settings, "light below a surface")
    certificate = check_bssrdf(judged.brdf.bssrdf, judged.channels, settings.name or judged.name, given)
    return dataclasses.replace(certificate, notes=[*certificate.notes, *_notes(judged)])


def _compared_with(other: Subject) -> "AbstractBRDF | Table":
    """A truth, or the readings of a table."""
    return other.brdf if other.table is None else other.table


def _evidence(judged: Subject, settings: CheckSettings) -> "ModelEvidence | TableEvidence":
    other = None if settings.against is None else resolve_subject(settings.against)
    reference = None if other is None else _compared_with(other)
    channels = None if other is None else other.channels
    if judged.table is None:
        from gonio.checks.model.evidence import ModelEvidence
        from gonio.models.compiled.program_memory import free_programs

        free_programs()
        if settings.further is not None:
            raise GonioError(f"{judged.name} is a model; further readings join tables only: leave the option out")
        if settings.instrument is not None:
            raise GonioError(f"{judged.name} is a model and knows its media; leave the instrument out")
        if settings.model is not None:
            raise GonioError(f"{judged.name} is a model; another one helps tables only: leave the option out")
        if isinstance(reference, Table):
            names = judged.channels.names
            return ModelEvidence(judged.brdf, names, None, reference, settings.level, judged.channels)
        return ModelEvidence(judged.brdf, judged.channels.names, reference)
    if settings.model not in (None, "auto"):
        from gonio.models.expression.parser import parse, with_defaults

        with_defaults(parse(settings.model))  # refused whether it is needed or not
    table, further = judged.table, None
    if settings.instrument is not None:
        table = with_media(table, settings.instrument)
    if settings.further is not None:
        further = resolve_subject(settings.further).require_table()
        require_alike(table, further)
        if not table.layout.gridded:
            table, further = joined(table, further), None
    return TableEvidence(
        table, settings.level, settings.feature_width, reference, channels, settings.model, further
    )  # fmt: skip


def _refuse_options_of_tables(settings: CheckSettings, what: str) -> None:
    if any(getattr(settings, name) is not None for name in ("model", "against", "further", "instrument")):
        raise GonioError(
            f"{what} is checked for reciprocity, energy and positivity; leave model, against, further readings and "
            "instrument out"
        )


def _checked(tolerances: Mapping[str, float | None]) -> dict[str, float]:
    for name, value in tolerances.items():
        if name not in PROPERTIES:
            raise GonioError(f"there is no tolerance of {name!r}; expected one of {', '.join(PROPERTIES)}")
        if value is not None and not 0 <= value < float("inf"):
            raise GonioError(f"the tolerance of {name} is {value}; give a number from 0 up")
    return {name: value for name, value in tolerances.items() if value is not None}

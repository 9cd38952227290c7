"""Subjects of a report: tables, profiles and models, with their fits and their certificates."""

import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path

from gonio.checks.certificate import Certificate
from gonio.data.material import Material
from gonio.data.polarisation import shown_channel
from gonio.data.profile import Profile
from gonio.data.profile_files import profile_of
from gonio.data.subject import Subject, SubjectLike, load_material, resolve_subject
from gonio.data.table import Channels, Table
from gonio.figures.style import LineStyle, colour_of
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.evaluation import channel_count
from gonio.models.expression.parser import parse, with_defaults
from gonio.models.subsurface.wide_spots import WideSpots

LONGEST = 40


@dataclasses.dataclass
class ReportSubject:
    """A table, a profile or a model in a report, with its fit, its certificate, and its place in colour."""

    name: str
    channels: Channels
    table: Table | None
    material: Material | None
    file: str | None
    """The file it was read from."""
    number: int
    fits: list[Material] = dataclasses.field(default_factory=list)
    """The materials that were fitted to the table."""
    certificate: Certificate | None = None
    profile: Profile | None = None
    """Of light below a surface; then there is neither a table nor a material."""

    @property
    def kind(self) -> str:
        """What it is: table, profile or model."""
        return "profile" if self.profile is not None else "model" if self.table is None else "table"

    @property
    def below_surface(self) -> bool:
        """Whether it is about light below a surface."""
        return self.profile is not None or (self.material is not None and isinstance(self.material.brdf, WideSpots))

    @property
    def anchor(self) -> str:
        """Id of the heading of its section."""
        return f"subject-{self.number + 1}"

    @property
    def look(self) -> LineStyle:
        """Its line in figures of several subjects."""
        return colour_of(self.number)

    @property
    def model(self) -> AbstractBRDF:
        """The BRDF of a model."""
        assert self.material is not None, f"{self.name} is a table"
        return self.material.brdf

    @property
    def empty(self) -> bool:
        """Whether it is a table or a profile without a valid reading."""
        if self.profile is not None:
            return not self.profile.valid.any()
        return self.table is not None and self.table.counts()["valid"] == 0

    @property
    def shown(self) -> int:
        """Number of the channel that the pictures show: the middle one that is a radiance."""
        return shown_channel(self.channels.names)

    @property
    def channel(self) -> str:
        """Name of the shown channel."""
        return self.channels.names[self.shown]

    @property
    def in_channel(self) -> str:
        """The shown channel in words."""
        return self.channel if self.channel.startswith("channel") else f"channel {self.channel}"

    @property
    def read(self) -> int:
        """Number of directions at which a table has a valid reading."""
        return 0 if self.table is None else int(self.table.valid_cells().size)

    @property
    def fitted_model(self) -> str | None:
        """The model that its first fit asked for, which may decide on energy where the readings alone do not."""
        requested = self.fits[0].meta["fit"].get("asked") if self.fits else None
        try:
            with_defaults(parse(requested or ""))
        except GonioError:
            return None
        return requested

    def fit_name(self, number: int) -> str:
        """What one of its fits is called in captions."""
        if len(self.fits) == 1:
            return "model fitted"
        requested = str(self.fits[number].meta["fit"].get("asked") or self.fits[number].name)
        return f"fit {number + 1}, {requested if len(requested) <= LONGEST else requested[: LONGEST - 1] + '…'}"


@dataclasses.dataclass(frozen=True)
class ProfileSubject:
    """A profile that somebody gave, with its file."""

    profile: Profile
    file: str | None = None

    @property
    def name(self) -> str:
        """What a person calls it."""
        return self.profile.name or "profile"


def resolved(given: SubjectLike) -> Subject | ProfileSubject:
    """The profile, table or model that somebody gave. Raises GonioError as `resolve_subject` does."""
    if isinstance(given, ProfileSubject):
        return given
    profile = profile_of(given)
    file = os.fspath(given) if isinstance(given, str | os.PathLike) else None
    return resolve_subject(given) if profile is None else ProfileSubject(profile, file)


def subject_of(given: SubjectLike, number: int) -> ReportSubject:
    """The report's subject of a profile, or of what `resolve_subject` takes. Raises GonioError as that does."""
    s = resolved(given)
    if isinstance(s, ProfileSubject):
        return ReportSubject(s.name, s.profile.channels, None, None, s.file, number, profile=s.profile)
    return ReportSubject(s.name, s.channels, s.table, s.material, s.file, number)


def distinguish_names(subjects: Sequence[ReportSubject]) -> None:
    """Gives subjects of one name the names of their files, or numbers, beside it."""
    for name in {s.name for s in subjects}:
        same = [s for s in subjects if s.name == name]
        files = [Path(s.file).name if s.file else "" for s in same]
        for k, s in enumerate(same if len(same) > 1 else []):
            unique = files[k] and files.count(files[k]) == 1
            s.name = f"{name} ({files[k] if unique else k + 1})"


def fit_of(given: SubjectLike) -> Material:
    """A fitted material, of a fit result too. Raises GonioError for one that is not."""
    material = load_material(given)
    if "fit" not in material.meta:
        raise GonioError(f"{material.name} is not a fitted material; give one that 'gonio fit' wrote.")
    return material


def split_fits(given: Sequence[SubjectLike]) -> tuple[list[SubjectLike], list[SubjectLike]]:
    """(subjects, fits of readings among them): a fitted material that names a table or a profile of the list is a fit
    of that."""
    every = [resolved(g) for g in given]
    tables = {s.name for s in every if isinstance(s, ProfileSubject) or s.table is not None}
    of_table = [isinstance(s, Subject) and s.material is not None and _table_name(s.material) in tables for s in every]
    subjects = [s for s, is_fit in zip(every, of_table, strict=True) if not is_fit]
    return subjects, [s for s, is_fit in zip(every, of_table, strict=True) if is_fit]


def assign_fits(subjects: Sequence[ReportSubject], fits: Sequence[Material]) -> None:
    """Gives each fit to the table that it names, those that name none to the tables without one, in order.

    Raises GonioError where a fit is of another table or of other channels, and where one finds no table.
    """
    tables = [s for s in subjects if s.kind != "model"]
    if fits and not tables:
        raise GonioError(f"{len(fits)} fits came for no table; give the table that they are of.")
    # Those that name a table of the page first, so that none of it is taken.
    for fit in sorted(fits, key=lambda f: _table_name(f) not in {s.name for s in tables}):
        name = _table_name(fit)
        named = [s for s in tables if s.name == name]
        if not named and name:
            names = ", ".join(s.name for s in tables)
            raise GonioError(f"The fit is of '{name}', not of {names}; give the fit of that {tables[0].kind}.")
        free = [s for s in named or tables if not s.fits]
        if not free and not named:
            raise GonioError(f"{len(fits)} fits came for {len(tables)} tables, and {fit.name} names none of them.")
        table = (free or named)[0]
        count = channel_count(fit.brdf)
        if count not in (None, len(table.channels)):
            counts = f"The fit has {count} channels and {table.name} has {len(table.channels)}"
            raise GonioError(f"{counts}; give the fit of that table.")
        if isinstance(fit.brdf, WideSpots) != (table.profile is not None):
            of = "light below a surface" if table.profile is None else "a BRDF"
            raise GonioError(
                f"The fit is of {of}, and {table.name} is a {table.kind}; give the fit of that {table.kind}."
            )
        table.fits.append(fit)


def _table_name(fit: Material) -> str | None:
    fit_facts = fit.meta.get("fit")
    return fit_facts.get("table") if isinstance(fit_facts, dict) else None

"""The subject of a verb: the table or the model that a path, a name, an expression or an object stands for."""

import dataclasses
import functools
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, Union

from gonio.data.channels import Channels
from gonio.data.files import stem
from gonio.data.formats.registry import is_there, load, read, split_entry
from gonio.data.material import Material, channels_of, material_of
from gonio.data.table import Table
from gonio.models.errors import GonioError, nearest
from gonio.models.names import BELOW, WHERE

if TYPE_CHECKING:
    from gonio.models.brdf import AbstractBRDF

LARGEST_STREAM = 256 << 20
"""Bytes that are taken from an open file."""
CHUNK = 1 << 20
REFERENCE_FOLDER = Path(__file__).parent / "materials"

SubjectLike = Union[str, os.PathLike[str], BinaryIO, Table, Material, "AbstractBRDF", Any]
"""A readable file (path or open binary file), a reference material's name, an expression, ``FILE.fit:NAME``, or an
object: a table, a material, a model, or what has a `material` (a fit result)."""


@dataclasses.dataclass(frozen=True)
class Subject:
    """A table of readings, or a model: `kind` says which of `table` and `material` is there. `file` was read."""

    kind: Literal["table", "model"]
    name: str
    channels: Channels
    table: Table | None = None
    material: Material | None = None
    file: str | None = None

    @property
    def brdf(self) -> "AbstractBRDF":
        """The model, or the interpolant of the table. Raises GonioError for a table that cannot be interpolated."""
        return self.as_material().brdf

    def as_material(self) -> Material:
        """The material itself, or the interpolated table as one. Raises GonioError as `brdf` does."""
        return self._interpolated if self.material is None else self.material

    @functools.cached_property
    def _interpolated(self) -> Material:
        from gonio.data.interpolation.multilinear import as_material, interpolation

        table = self.require_table()
        how = interpolation(table)
        meta = {"interpolation": how, "provenance": table.provenance} | ({"file": self.file} if self.file else {})
        source, description = str(table.provenance.get("source", "")), f"a table ({table.layout.name}), {how}"
        return Material(self.name, as_material(table), None, self.channels, description, source, meta)

    def require_table(self) -> Table:
        """The table. Raises GonioError, with the remedy, where the subject is a model."""
        if self.table is None:
            what = self.file or self.name
            raise GonioError(f"{what} is a model, not a table; measure it first: gonio measure '{what}' -o T.h5")
        return self.table


def resolve_subject(subject: SubjectLike, *, blockwise: bool = False, **options: Any) -> Subject:
    """The table or the model that `subject` stands for; every verb takes its subjects through this function.

    A reference name goes before a file of the same name (write ./name for the file), a file before an expression. An
    open binary file is copied, up to `LARGEST_STREAM` bytes.

    Args:
        subject: see `SubjectLike`.
        blockwise: whether the values of a large table may stay in its file, as they are read in blocks anyway.
        options: how to read a table's file: `nodes` for MERL, `wavelength_nm` for NIST (see `gonio.data.read`).

    Raises:
        GonioError: in one sentence, for what is no subject, and for a file that cannot be read.
    """
    if isinstance(subject, Subject):
        return subject
    if isinstance(subject, str | os.PathLike):
        return _named(subject, options | ({"blockwise": True} if blockwise else {}))
    content = subject if isinstance(subject, Table | Material) else getattr(subject, "material", None)
    if isinstance(content, Table | Material):
        return _of_content(content)
    if callable(getattr(subject, "read", None)):
        return _of_stream(subject, options)
    from gonio.models.brdf import AbstractBRDF

    if isinstance(subject, AbstractBRDF):
        return _of_content(material_of(subject))
    raise GonioError(
        f"A {type(subject).__name__} is neither a table nor a model; give a file (its path, or opened as 'rb'), a "
        "reference material's name, an expression such as 'lambert(rho=0.3)', a table, a material, a model or a fit "
        "result"
    )


def reference_materials() -> list[str]:
    """The names of the reference materials that come with gonio, sorted."""
    return sorted(path.stem for path in REFERENCE_FOLDER.glob("*.toml"))


def load_material(subject: SubjectLike) -> Material:
    """The material that `subject` stands for; a table is interpolated. Takes and raises what `resolve_subject` does."""
    return resolve_subject(subject).as_material()


def _of_content(content: Table | Material, file: str | None = None) -> Subject:
    """The subject of a table or a material that `file` holds, where it is one of a file."""
    if isinstance(content, Table):
        name = content.name or ("table" if file is None else stem(file))
        return Subject("table", name, content.channels, content, file=file)
    file = content.meta.get("file")
    if content.expression is None and file:
        # The readings themselves, not what lies between them.
        table = read(file)
        return Subject("table", content.name, table.channels, table, file=file)
    return Subject("model", content.name, content.channels, material=content, file=file)


def _named(given: str | os.PathLike[str], options: dict[str, Any]) -> Subject:
    text = os.fspath(given)
    if text in reference_materials():
        # Where this gonio is installed is nobody's provenance: a reference material is known by its name.
        material = load(REFERENCE_FOLDER / f"{text}.toml")
        assert isinstance(material, Material)
        return _of_content(dataclasses.replace(material, meta={"reference": text}))
    if is_there(text) or isinstance(given, os.PathLike) or split_entry(text)[1] is not None:
        file = os.fspath(Path(text))
        return _of_content(load(file, **options), file)
    if "(" in text:
        from gonio.models.expression.builder import build

        brdf = build(text)
        return _of_content(Material(text, brdf, text, channels_of(brdf), "spelled on the spot"))
    if os.sep in text or Path(text).suffix:
        raise GonioError(f"{text} does not exist; check the name and the folder")
    if text in (*WHERE, *BELOW):
        raise GonioError(f"'{text}' is a model, not a material; give its parameters, as in '{text}(...)'")
    raise GonioError(f"Unknown material '{text[:80]}'; {nearest(text[:80], [*reference_materials(), *WHERE, *BELOW])}")


def _of_stream(stream: Any, options: dict[str, Any]) -> Subject:
    name = getattr(stream, "name", None)
    name = os.path.basename(name) if isinstance(name, str) else "stream"
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, name or "stream")
        with open(path, "wb") as copy:
            while chunk := stream.read(CHUNK):
                if not isinstance(chunk, bytes):
                    raise GonioError(f"{name} gives text, not bytes; open the file as 'rb'")
                copy.write(chunk)
                if copy.tell() > LARGEST_STREAM:
                    raise GonioError(f"{name} gives more than {LARGEST_STREAM >> 20} MiB; give the file's path")
        try:
            content = load(path, **options)
        except GonioError as error:
            raise GonioError(str(error).replace(path, name)) from None
    if isinstance(content, Table):
        return dataclasses.replace(_of_content(content, name), file=None)
    meta = {key: value for key, value in content.meta.items() if key != "file"}
    return _of_content(dataclasses.replace(content, meta=meta))

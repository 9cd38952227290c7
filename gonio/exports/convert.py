"""Any subject into a file of another format, or into the nearest expression of a renderer."""

import contextlib
import dataclasses
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np

from gonio.data.files import new_file, refuse_outputs
from gonio.data.formats.registry import sniff, targets, writable, write
from gonio.data.material import Material
from gonio.data.round_trip import RoundTrip
from gonio.data.subject import Subject, SubjectLike, load_material, resolve_subject
from gonio.exports.about import about
from gonio.exports.forms import Appearance, Form, Values, appearance_of
from gonio.exports.losses import FAR
from gonio.exports.nearest import Nearest, nearest
from gonio.exports.pairs import Pairs
from gonio.exports.reexpression import ReExpression, reexpression
from gonio.exports.targets import Target, canonical, target_of
from gonio.models.deprecation import settings_of
from gonio.models.errors import GonioError

AS_DATA = "as data (--measured, measured=True) {} would be nearer: in an RGL file beside the scene"


class ConvertOptions(TypedDict, total=False):
    """Keywords of `gonio.convert`; `help(gonio.convert)` describes each."""

    force: bool
    ascii: bool | None
    channel_bytes: int | None
    part: str | None
    channel: str | None
    step: float | None
    basis: str | None
    model: str | None
    measured: bool
    tolerance: float | None
    log: Callable[[str], None]


@dataclasses.dataclass(frozen=True)
class ConvertSettings:
    """The options of a conversion, complete; see `gonio.convert`."""

    force: bool = False
    ascii: bool | None = None
    channel_bytes: int | None = None
    part: str | None = None
    channel: str | None = None
    step: float | None = None
    basis: str | None = None
    model: str | None = None
    measured: bool = False
    tolerance: float | None = None
    log: Callable[[str], None] = lambda line: None

    @property
    def of_samples(self) -> dict[str, Any]:
        """Those of a file of samples."""
        names = ("ascii", "channel_bytes", "part", "channel", "step", "basis")
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    def refuse_for_tables(self, path: str | os.PathLike[str]) -> None:
        """Refuses what only renderers have."""
        for name in ("model", "measured", "tolerance"):
            if getattr(self, name) not in (None, False):
                raise GonioError(f"{path} is no file for a renderer, which {name!r} is for; leave it out, or say --to")


def convert(
    subject: SubjectLike, path: str | os.PathLike[str], to: str | None = None, **options: Unpack[ConvertOptions]
) -> RoundTrip | ReExpression:
    """Writes a subject in the format of the path's ending, or as the nearest expression of a renderer.

    A table, or a model where the format holds models (.bsdf, .binary), is written in a format of samples. For a
    renderer a surface is said exactly where the renderer has it, else by the numbers for which the renderer's own BRDF
    is nearest to it; a table is fitted first.

    Args:
        subject: any subject (see `gonio.data.subject.SubjectLike`).
        path: the file.
        to: "mitsuba", "pbrt", "materialx", "gltf", "blender" or "radiance" (a matrix over the Klems patches), or the
            name of a format; needed where its ending is that of others too.
        force: replaces an existing file.
        ascii: values of an .ssdd file as text, at full precision; else in single precision.
        channel_bytes: of a .bsdf file: of the samples of one channel, of an anisotropic surface those of each azimuth
            of the light; by default 16384, as published.
        part: of a Zemax file: "reflection" or "transmission".
        channel: of a Zemax or Klems file: the only channel to write.
        step: of a Zemax or Speos file that is sampled: degrees between its angles, by default 5 and 2.
        basis: of a Klems file: "full" (default), "half" or "quarter".
        model: the expression that is fitted to a table; by default it is selected.
        measured: for Mitsuba and pbrt: the surface as data in an RGL file beside `path`, to which that refers.
        tolerance: of a renderer: refuses an expression whose relative rms or difference of albedo is larger.
        log: called with a line for what takes long.

    Returns:
        What reading the file again shows to be lost; for a renderer the errors of its expression.

    Raises:
        GonioError: another ending or name, a model for a format of readings, a surface without a colour, an expression
            beyond the tolerance, a path that exists or cannot be written.
    """
    settings = settings_of(ConvertSettings, "convert", options)
    target, to = target_of(path, to), canonical(to)
    if target is None:
        settings.refuse_for_tables(path)
        writable(path, to)  # refuses other endings, before any work
        resolved = resolve_subject(subject)
        return write(path, resolved.material or resolved.require_table(), settings.force, to, **settings.of_samples)
    return _for_renderer(resolve_subject(subject), Path(path), target, settings)


def _for_renderer(subject: Subject, path: Path, target: Target, settings: ConvertSettings) -> ReExpression:
    data = path.with_suffix(".bsdf") if settings.measured else None
    refuse_outputs([path, data], [subject.file], settings.force)
    with contextlib.ExitStack() as stack:
        if data is None:
            if settings.of_samples:
                name = next(iter(settings.of_samples))
                raise GonioError(f"{name} is of samples, and {target.title} is written as an expression; leave it out")
            material, remarks = _model_of(subject, settings)
            sought = appearance_of(material)
            expression = nearest(target.forms(sought), sought)
        else:
            if target.measured is None:
                raise GonioError(f"{target.title} takes no surface as data; leave 'measured' out")
            description, remarks = target.measured(data.name, subject.channels)
            temporary = stack.enter_context(new_file(data, settings.force))
            material = subject.as_material()
            sought = appearance_of(material)
            expression = _as_data(subject, sought, temporary, description, settings)
        error = reexpression(target.title, sought, expression, remarks)
        if data is None and _nearer_as_data(error, sought, target):
            error = dataclasses.replace(error, remarks=(*error.remarks, AS_DATA.format(_nearest_data(subject))))
        if settings.tolerance is not None and not error.within(settings.tolerance):
            raise GonioError(
                f"{target.title} comes no nearer to {material.name} than {error.figures}, beyond the tolerance of "
                f"{settings.tolerance:g}; nothing was written" + "".join(f"; {remark}" for remark in error.remarks)
            )
        content = target.file(expression.form.describe(expression.values), about(material, error), path.suffix.lower())
        stack.enter_context(new_file(path, settings.force)).write_bytes(content)
    return dataclasses.replace(error, written=tuple(str(p) for p in (path, data) if p is not None))


def _nearer_as_data(error: ReExpression, sought: Appearance, target: Target) -> bool:
    """Whether samples of the surface are nearer than an expression that is this far, and can be read."""
    known = target.title == "Mitsuba 3" or sought.material.channels.wavelengths_nm is not None
    smooth = sought.isotropic and not sought.transmits
    return target.measured is not None and known and smooth and error.relative_rms > FAR


def _nearest_data(subject: Subject) -> str:
    """What an export as data begins with: of a fit the table that it is of, which holds what the model leaves out."""
    of_fit = None if subject.material is None else subject.material.meta.get("fit")
    table = of_fit.get("table") if isinstance(of_fit, dict) else None
    return "the surface" if not table else f"the table '{table}', given in place of its fit,"


def _model_of(subject: Subject, settings: ConvertSettings) -> tuple[Material, tuple[str, ...]]:
    """The model of a subject, or that of a fit to its table, and what is to be said of the fit."""
    if subject.material is not None:
        if settings.model is not None:
            raise GonioError(f"{subject.name} is a model already; leave 'model' out, which is fitted to a table")
        return subject.material, ()
    from gonio.fitting.fit_table import fit

    settings.log(f"fitting {settings.model or 'a model'} to {subject.name}")
    result = fit(subject, settings.model, log=settings.log)
    off = result.metrics["relative_rms_cosine"]
    return result.material, (
        f"the errors are against the model fitted to {subject.name}, {result.requested}, which is off the readings by "
        f"rms {100 * off:.2g} % (with cosines)",
    )


def _as_data(subject: Subject, sought: Appearance, path: Path, description: Any, settings: ConvertSettings) -> Nearest:
    """Writes the samples, or copies those of an RGL file, and reads them as a renderer does."""
    samples = targets()["rgl"]
    assert samples.write is not None
    if subject.file is not None and subject.table is not None and sniff(subject.file) is samples:
        shutil.copyfile(subject.file, path)
    else:
        samples.write(path, subject.material or subject.require_table(), force=True, **settings.of_samples)
    read = load_material(path)
    as_read = dataclasses.replace(sought, material=read)

    def f(values: Values, pairs: Pairs) -> np.ndarray:
        return as_read.f(pairs.wi, pairs.wo)

    return Nearest(Form("samples of f", (), f, lambda values: description), {}, 0.0)

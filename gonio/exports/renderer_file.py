"""A surface as the nearest expression of a renderer, or as data beside it: the file, and how far it is from that."""

import contextlib
import dataclasses
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from gonio.data.files import new_file, refuse_outputs
from gonio.data.formats.registry import sniff, targets
from gonio.data.material import Material
from gonio.data.subject import Subject, load_material
from gonio.exports.about import about
from gonio.exports.forms import Appearance, Form, Values, appearance_of
from gonio.exports.losses import FAR
from gonio.exports.nearest import Nearest, nearest
from gonio.exports.pairs import Pairs
from gonio.exports.reexpression import ReExpression, reexpression
from gonio.exports.settings import ConvertSettings
from gonio.exports.targets import Target
from gonio.models.errors import GonioError

AS_DATA = "as data (--measured, measured=True) {} would be nearer: in an RGL file beside the scene"


def write_for_renderer(subject: Subject, path: Path, target: Target, settings: ConvertSettings) -> ReExpression:
    """Writes the file, with `settings.measured` the samples too; returns the errors of the expression."""
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

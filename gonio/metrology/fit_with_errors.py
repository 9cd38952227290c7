"""The fit that `gonio.fit` is: of a model alone, or of errors of the instrument beside it."""

import inspect
from collections.abc import Mapping, Sequence
from typing import Any, Unpack, cast

from gonio.data.subject import SubjectLike
from gonio.fitting import fit_table
from gonio.fitting.options import FitOptions
from gonio.fitting.result import FitResult
from gonio.instrument.instrument import Instrument
from gonio.models.errors import GonioError

KEYWORDS = """    nuisance: errors of the instrument that are fitted beside the model, held by their uncertainties: some
        of ``["tilt", "theta_i", "gain", "dark"]``; of one table and at most one model.
    instrument: with `nuisance`: the real one, whose stated uncertainties go before those that the table stores.
    uncertainty: with `nuisance`: of single terms, before both, such as ``{"gain": "0.5 %", "tilt": "0.05 deg"}``.
"""


class AllFitOptions(FitOptions, total=False):
    """Keywords of `gonio.fit`; `help(gonio.fit)` describes each."""

    nuisance: Sequence[str] | str
    instrument: Instrument | None
    uncertainty: Mapping[str, object]


def fit(table: SubjectLike, model: str | list[str] | None = None, **options: Unpack[AllFitOptions]) -> FitResult:
    """Fit a BRDF model to a table of readings, as `gonio.fitting.fit_table.fit` does, errors of the instrument too."""
    given: dict[str, Any] = dict(options)
    nuisance, instrument, stated = (given.pop(k, None) for k in ("nuisance", "instrument", "uncertainty"))
    of_model = cast(FitOptions, given)
    if not nuisance:
        if instrument is not None or stated:
            raise GonioError("an instrument and uncertainties hold nuisance numbers; give nuisance too")
        return fit_table.fit(table, model, **of_model)
    expressions = [model] if isinstance(model, str) else list(model or [])
    if len(expressions) > 1 or given.get("per_channel") or given.get("scene") is not None:
        raise GonioError("nuisance numbers go with at most one model, without per_channel and scene")
    # Alone it is half of what an import of fits would load.
    from gonio.metrology.nuisance import fit_with_nuisance

    names = [n.strip() for n in nuisance.split(",")] if isinstance(nuisance, str) else list(nuisance)
    return fit_with_nuisance(table, expressions[0] if expressions else None, names, instrument, stated, **of_model)


_LAST = "    log: called with a line for each model.\n"
fit.__doc__ = inspect.cleandoc(fit_table.fit.__doc__ or "").replace(_LAST, _LAST + KEYWORDS) or fit.__doc__

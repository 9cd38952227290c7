"""gonio: a virtual gonioreflectometer and BRDF fitting tool.

    import gonio

    material = gonio.material("lambert(rho=0.3) + ggx(alpha=0.2, f0=0.04)")
    table = gonio.measure(material)
    fitted = gonio.fit(table, "lambert + ggx(f0=0.04)")
    certificate = gonio.check(table)
    gonio.report([table], "report.html")

The verbs and classes are loaded when they are first used, so that `import gonio` is quick.
"""

from typing import TYPE_CHECKING, Any

from gonio.models import display

if TYPE_CHECKING:
    from gonio.charts import chart as chart
    from gonio.checks.certificate import Certificate as Certificate
    from gonio.checks.certify import check as check
    from gonio.checks.repairs.nearest_table import repair as repair
    from gonio.data.formats.registry import read as _read
    from gonio.data.material import Material as Material
    from gonio.data.reduction.coarsest_table import reduce_table as reduce
    from gonio.data.scene import Scene as Scene
    from gonio.data.subject import load_material as material
    from gonio.data.table import Table as Table
    from gonio.fitting.batch import fit_many as fit_many
    from gonio.fitting.fit_table import fit as fit
    from gonio.fitting.result import FitResult as FitResult
    from gonio.instrument.instrument import Instrument as Instrument
    from gonio.instrument.measurement import measure as measure
    from gonio.models.errors import GonioError as GonioError
    from gonio.reports.build import report as report
    from gonio.stability import stress as stress

    open = _read

__version__ = "0.1.0"

display.drawings = "gonio.figures.display"

_PUBLIC = {  # public name: its module, and its name there; the imports above are the same, for type checkers
    "Certificate": ("gonio.checks.certificate", "Certificate"),
    "FitResult": ("gonio.fitting.result", "FitResult"),
    "GonioError": ("gonio.models.errors", "GonioError"),
    "Instrument": ("gonio.instrument.instrument", "Instrument"),
    "Material": ("gonio.data.material", "Material"),
    "Scene": ("gonio.data.scene", "Scene"),
    "Table": ("gonio.data.table", "Table"),
    "chart": ("gonio.charts", "chart"),
    "check": ("gonio.checks.certify", "check"),
    "fit": ("gonio.fitting.fit_table", "fit"),
    "fit_many": ("gonio.fitting.batch", "fit_many"),
    "material": ("gonio.data.subject", "load_material"),
    "measure": ("gonio.instrument.measurement", "measure"),
    "open": ("gonio.data.formats.registry", "read"),
    "reduce": ("gonio.data.reduction.coarsest_table", "reduce_table"),
    "repair": ("gonio.checks.repairs.nearest_table", "repair"),
    "report": ("gonio.reports.build", "report"),
    "stress": ("gonio.stability", "stress"),
}

__all__ = [
    "Certificate",
    "FitResult",
    "GonioError",
    "Instrument",
    "Material",
    "Scene",
    "Table",
    "__version__",
    "chart",
    "check",
    "fit",
    "fit_many",
    "material",
    "measure",
    "reduce",
    "repair",
    "report",
    "stress",
]  # without `open`: a star import leaves Python's own


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'gonio' has no attribute {name!r}")
    import importlib

    module, attribute = _PUBLIC[name]
    return getattr(importlib.import_module(module), attribute)


def __dir__() -> list[str]:
    return sorted([*__all__, "open"])

"""gonio: a virtual gonioreflectometer and BRDF fitting tool.

    import gonio

    material = gonio.material("lambert(rho=0.3) + ggx(alpha=0.2, f0=0.04)")
    table = gonio.measure(material)
    fitted = gonio.fit(table, "lambert + ggx(f0=0.04)")
    certificate = gonio.check(table)
    gonio.report([table], "report.html")

The verbs are loaded when they are first used, so that `import gonio` is quick.
"""

from typing import Any

__version__ = "0.1.0"

_VERBS = {
    "material": ("gonio.data.material", "load_material"),
    "open": ("gonio.data.formats.registry", "read"),
    "measure": ("gonio.instrument.measurement", "measure"),
    "fit": ("gonio.fitting.fit_table", "fit"),
    "fit_many": ("gonio.fitting.batch", "fit_many"),
    "check": ("gonio.checks.certify", "check"),
    "chart": ("gonio.charts.diagrams", "chart"),
    "repair": ("gonio.checks.repair.nearest_table", "repair"),
    "reduce": ("gonio.data.reduction.coarsest_table", "reduce_table"),
    "report": ("gonio.reports.build", "report"),
    "stress": ("gonio.stability.survey", "stress"),
}

__all__ = [
    "__version__",
    "chart",
    "check",
    "fit",
    "fit_many",
    "material",
    "measure",
    "open",
    "reduce",
    "repair",
    "report",
    "stress",
]


def __getattr__(name: str) -> Any:
    if name not in _VERBS:
        raise AttributeError(f"module 'gonio' has no attribute {name!r}")
    import importlib

    module, function = _VERBS[name]
    return getattr(importlib.import_module(module), function)

"""gonio: a virtual gonioreflectometer and BRDF fitting tool.

    import gonio

    material = gonio.material("lambert(rho=0.3) + ggx(alpha=0.2, f0=0.04)")
    table = gonio.measure(material)
    fitted = gonio.fit(table, "lambert + ggx(f0=0.04)")
    certificate = gonio.check(table)
    gonio.report([table], "report.html")

The verbs and classes are loaded when they are first used, so that `import gonio` is quick.
"""

import importlib
from typing import Any

from gonio.models import display

__version__ = "0.1.0"

display.drawings = "gonio.figures.display"

_PUBLIC = {  # public name: where it is defined; `__init__.pyi` has the same for type checkers
    "Certificate": "gonio.checks.certificate:Certificate",
    "FitResult": "gonio.fitting.result:FitResult",
    "GonioError": "gonio.models.errors:GonioError",
    "Instrument": "gonio.instrument.instrument:Instrument",
    "Material": "gonio.data.material:Material",
    "Profile": "gonio.data.profile:Profile",
    "ProfileFit": "gonio.fitting.subsurface.result:ProfileFit",
    "Scene": "gonio.data.scene:Scene",
    "Table": "gonio.data.table:Table",
    "adapt": "gonio.planning.adaptive.adaptive_measurement:adapt",
    "campaign": "gonio.campaigns.campaign:campaign",
    "chapter": "gonio.reports.chapter:chapter",
    "chart": "gonio.charts:chart",
    "check": "gonio.checks.certify:check",
    "convert": "gonio.exports.convert:convert",
    "fit": "gonio.metrology.fit_with_errors:fit",
    "fit_many": "gonio.fitting.batch:fit_many",
    "fit_profile": "gonio.fitting.subsurface.profile_fit:fit_profile",
    "material": "gonio.data.subject:load_material",
    "measure": "gonio.instrument.measurement:measure",
    "measure_profile": "gonio.instrument.offsets_scan:measure_profile",
    "open": "gonio.data.formats.registry:read",
    "open_profile": "gonio.data.profile_files:open_profile",
    "plan": "gonio.planning.planned:plan",
    "plan_energy": "gonio.checks.energy_plan:plan_energy",
    "quantities": "gonio.metrology.quantities:quantities",
    "reduce": "gonio.data.reduction.coarsest_table:reduce_table",
    "repair": "gonio.checks.repairs.nearest_table:repair",
    "report": "gonio.reports.build:report",
    "scan": "gonio.instrument.scans:scan",
    "standard_uncertainty": "gonio.metrology.values.standard_uncertainty:standard_uncertainty",
    "stress": "gonio.stability:stress",
}

# A star import leaves Python's own `open`.
__all__ = ["__version__", *(n for n in _PUBLIC if n != "open")]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'gonio' has no attribute {name!r}")
    module, attribute = _PUBLIC[name].split(":")
    return getattr(importlib.import_module(module), attribute)


def __dir__() -> list[str]:
    return sorted([*__all__, "open"])

from gonio.campaigns.campaign import campaign as campaign
from gonio.charts import chart as chart
from gonio.checks.certificate import Certificate as Certificate
from gonio.checks.certify import check as check
from gonio.checks.energy_plan import plan_energy as plan_energy
from gonio.checks.repairs.nearest_table import repair as repair
from gonio.data.formats.registry import read as _read
from gonio.data.material import Material as Material
from gonio.data.profile import Profile as Profile
from gonio.data.profile_files import open_profile as open_profile
from gonio.data.reduction.coarsest_table import reduce_table as reduce
from gonio.data.scene import Scene as Scene
from gonio.data.subject import load_material as material
from gonio.data.table import Table as Table
from gonio.exports.convert import convert as convert
from gonio.fitting.batch import fit_many as fit_many
from gonio.fitting.result import FitResult as FitResult
from gonio.fitting.subsurface.profile_fit import fit_profile as fit_profile
from gonio.fitting.subsurface.result import ProfileFit as ProfileFit
from gonio.instrument.instrument import Instrument as Instrument
from gonio.instrument.measurement import measure as measure
from gonio.instrument.offsets_scan import measure_profile as measure_profile
from gonio.instrument.scans import scan as scan
from gonio.metrology.fit_with_errors import fit as fit
from gonio.metrology.quantities import quantities as quantities
from gonio.metrology.values.standard_uncertainty import standard_uncertainty as standard_uncertainty
from gonio.models.errors import GonioError as GonioError
from gonio.planning.adaptive.adaptive_measurement import adapt as adapt
from gonio.planning.planned import plan as plan
from gonio.reports.build import report as report
from gonio.reports.chapter import chapter as chapter
from gonio.stability import stress as stress

open = _read

__version__: str
__all__ = [
    "Certificate",
    "FitResult",
    "GonioError",
    "Instrument",
    "Material",
    "Profile",
    "ProfileFit",
    "Scene",
    "Table",
    "__version__",
    "adapt",
    "campaign",
    "chapter",
    "chart",
    "check",
    "convert",
    "fit",
    "fit_many",
    "fit_profile",
    "material",
    "measure",
    "measure_profile",
    "open_profile",
    "plan",
    "plan_energy",
    "quantities",
    "reduce",
    "repair",
    "report",
    "scan",
    "standard_uncertainty",
    "stress",
]  # without `open`: a star import leaves Python's own

from .certificate import Certificate as Certificate
from .certificate import Property as Property
from .certify import check as check
from .repairs.nearest_table import Repaired as Repaired
from .repairs.nearest_table import repair as repair

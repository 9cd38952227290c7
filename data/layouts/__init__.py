"""Where the cells of a table are: the layouts, their constructors, and their list by name."""

from gonio.data.layouts.angle_layouts import front_samples as front_samples
from gonio.data.layouts.angle_layouts import in_plane as in_plane
from gonio.data.layouts.angle_layouts import isotropic as isotropic
from gonio.data.layouts.angle_layouts import scattered as scattered
from gonio.data.layouts.angle_layouts import spherical as spherical
from gonio.data.layouts.base import LAYOUTS as LAYOUTS
from gonio.data.layouts.base import AxisKind as AxisKind
from gonio.data.layouts.base import Layout as Layout
from gonio.data.layouts.base import spherical_angles as spherical_angles
from gonio.data.layouts.half_difference_grid import half_difference as half_difference
from gonio.data.layouts.half_difference_grid import merl as merl
from gonio.data.layouts.mirror_grid import mirror as mirror
from gonio.data.layouts.mirror_grid import straight as straight
from gonio.data.layouts.turned_grid import turned as turned

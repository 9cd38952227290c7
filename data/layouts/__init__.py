"""Where the cells of a table are: the layouts, their constructors, and their list by name."""

from gonio.data.layouts.axes import AxisKind as AxisKind
from gonio.data.layouts.base import Layout as Layout
from gonio.data.layouts.half_difference_grid import half_difference as half_difference
from gonio.data.layouts.half_difference_grid import merl as merl
from gonio.data.layouts.in_plane_grid import in_plane as in_plane
from gonio.data.layouts.isotropic_grid import isotropic as isotropic
from gonio.data.layouts.nodes import spherical_angles as spherical_angles
from gonio.data.layouts.registry import LAYOUTS as LAYOUTS
from gonio.data.layouts.registry import layout_of as layout_of
from gonio.data.layouts.scattered_samples import scattered as scattered
from gonio.data.layouts.spherical_grid import spherical as spherical

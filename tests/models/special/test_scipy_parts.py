"""Parts of SciPy that are taken without their packages."""

import subprocess
import sys

ALONE = """
import sys
from gonio.models.special import scipy_functions as part
from gonio.models.special.scipy_parts import parts
assert "scipy.special" not in sys.modules
import scipy.special as whole
assert all(getattr(part, name) is getattr(whole, name) for name in part.NAMES)
assert parts("scipy.special", "no_such_module", "erfcx") == [whole.erfcx]
(tree,) = parts("scipy.spatial", "_ckdtree", "cKDTree")
import scipy.spatial
assert issubclass(scipy.spatial.KDTree, tree)
"""


def test_they_are_the_same_as_in_the_package_which_can_be_imported_afterwards():
    done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr

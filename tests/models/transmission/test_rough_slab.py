"""A sheet with rough sides: what leaves is hardly more than what falls in, wherever its lobes grow."""

import numpy as np
import pytest

from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.expression.builder import build


@pytest.mark.parametrize(("eta", "most"), [(1.01, 0.007), (1.05, 0.0015), (1.5, 0.0004)])
def test_a_clear_sheet_gains_hardly_anything(eta, most):
    theta = np.radians([0, 20, 40, 50, 60, 66, 72, 75, 85])
    for alpha in (0.03, 0.1, 0.3, 0.5):
        sheet = build(f"rough_slab(alpha={alpha}, eta={eta})")
        total = sum(
            np.asarray(g(sheet, theta, 0.0, 1e-5).value) for g in (directional_albedo, directional_transmittance)
        )
        assert np.max(total) <= 1 + most
        assert total[0] > (0.98 if eta < 1.5 or alpha < 0.4 else 0.9)  # nor does it lose what it passes straight on

import numpy as np
import pytest

from gonio.fitting.residuals.energy import largest_albedo
from gonio.models.geometry.directions import Direction


def _lobe(wi: Direction, wo: Direction) -> np.ndarray:
    """A diffuser of albedo 0.3, and beside it a lobe of 20 cosines about the mirror direction, 0.1 at its top."""
    cosine = np.maximum(wo.z * wi.z - wo.x * wi.x - wo.y * wi.y, 0.0)
    return np.stack([np.full(cosine.shape, 0.3 / np.pi), 0.1 * cosine**20], axis=1)


def test_one_azimuth_stands_for_all_of_an_isotropic_model():
    one, two = (largest_albedo(_lobe, 2, isotropic=k) for k in (True, False))
    assert one.value == pytest.approx(two.value, rel=1e-13) and one.theta_i == two.theta_i
    assert one.value == pytest.approx(0.3, rel=0.02) and one.channel == 0


def test_a_lobe_along_one_azimuth_is_seen_from_both():
    def brushed(wi: Direction, wo: Direction) -> np.ndarray:
        return _lobe(wi, wo)[:, :1] * np.where(np.abs(wi.y) > 1e-9, 3.0, 1.0)[:, None]

    assert largest_albedo(brushed).value == pytest.approx(0.9, rel=0.02)
    assert largest_albedo(brushed, isotropic=True).value == pytest.approx(0.3, rel=0.02)

"""Repeats in lists: their scatter is that of bright readings and of dark ones, whose means are about 0."""

import numpy as np
import pytest

from gonio.checks.table.pairs.scattered_pairs import merged


@pytest.mark.parametrize(("share", "level"), [(0.01, 1e-4), (0.0, 1e-3), (0.02, 0.0), (0.05, 1e-6)])
def test_the_noise_of_means_is_what_made_their_readings_also_where_these_are_dark(share: float, level: float) -> None:
    """A third of the directions reflect nothing; of a share of their means the noise was thousands of per cent."""
    rng = np.random.default_rng(0)
    true = np.where(np.arange(300) % 3 == 0, 0.0, 10 ** rng.uniform(-2, 1, 300))
    place = np.repeat(np.arange(true.size), 4)
    noise = np.hypot(share * true, level)
    f = (true + noise * rng.standard_normal((4, true.size))).T.reshape(-1, 1)
    angles = np.stack([0.001 * place] * 4, axis=-1)
    readings = merged(angles, f, np.full_like(f, np.nan), angles)
    assert readings.repeated == 900 and readings.law is not None
    assert readings.u[:, 0] == pytest.approx(noise / 2, rel=0.15, abs=1e-9)
    assert readings.noise(np.array([0.0, 1.0])) == pytest.approx([level, np.hypot(share, level)], rel=0.15, abs=1e-9)


def test_copies_tell_nothing_of_noise() -> None:
    f = np.repeat(np.random.default_rng(1).uniform(0, 1, (40, 1)), 2, axis=0)
    angles = np.repeat(0.01 * np.arange(40.0), 2)[:, None] * np.ones(4)
    assert merged(angles, f, np.full_like(f, np.nan), angles).law is None

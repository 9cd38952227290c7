"""Integrals over grids about any direction, against their closed forms."""

import numpy as np
import pytest

from gonio.data.formats.optics.hemispherical_totals import grid_totals

POLAR, AZIMUTH = np.radians(np.arange(0, 91, 5.0)), np.radians(np.arange(0, 360, 20.0))


def of(function, polar=POLAR, azimuth=AZIMUTH, centre=0.0, mirrored=False):
    f = function(*np.meshgrid(polar, azimuth, indexing="ij"))[None, ..., None]
    return float(grid_totals(polar, azimuth, f, np.array([centre]), mirrored)[0, 0])


def test_what_is_linear_between_the_nodes_is_exact():
    assert of(lambda t, p: np.ones_like(t)) == pytest.approx(np.pi, rel=1e-12)
    # ∫ θ cosθ sinθ dθ from 0 to π/2 is π/8
    assert of(lambda t, p: t) == pytest.approx(2 * np.pi * np.pi / 8, rel=1e-9)
    assert of(lambda t, p: np.ones_like(t), POLAR[: len(POLAR) // 2 + 1]) == pytest.approx(np.pi / 2, rel=1e-9)


@pytest.mark.parametrize("centre", [0.2, 0.9])
def test_a_tilted_grid_counts_what_is_above_the_horizon(centre):
    polar = np.radians(np.arange(0, 181, 2.0))
    assert of(lambda t, p: np.ones_like(t), polar, centre=centre) == pytest.approx(np.pi, rel=2e-4)


def test_one_side_stands_for_both_and_gaps_are_filled():
    half = np.radians(np.arange(0, 181, 20.0))
    for centre in (0.0, 0.5):
        whole = of(lambda t, p: 1 + np.cos(p) * np.sin(t), centre=centre)
        assert of(lambda t, p: 1 + np.cos(p) * np.sin(t), azimuth=half, centre=centre, mirrored=True) == pytest.approx(
            whole
        )
    holes = of(lambda t, p: np.where((t > 0.5) & (t < 0.6), np.nan, 1.0))
    assert holes == pytest.approx(np.pi, rel=1e-12)

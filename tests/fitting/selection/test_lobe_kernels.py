"""Lobes of candidates and their derivatives by their shapes."""

import numpy as np
import pytest

from gonio.fitting.selection.candidate_columns import DIFFUSE, lobe_of
from gonio.fitting.selection.lobe_kernels import lobe_values, loop_of, padded
from gonio.fitting.selection.term_spec import (
    DIELECTRIC,
    LAMBERT,
    METAL,
    TermSpec,
    families,
    kernel_arguments,
    steps,
)
from gonio.models.compiled.machine import machine
from gonio.models.geometry.directions import from_spherical

PLAIN = (LAMBERT, TermSpec("ggx"), TermSpec("ggx", DIELECTRIC), TermSpec("eon"), TermSpec("beckmann", METAL))
KINDS = sorted(
    {
        (lobe_of(term), kernel_arguments(term))
        for start in ((LAMBERT,), (LAMBERT, TermSpec("ggx")), PLAIN)
        for terms in (*steps(start, True, 3), *families(start))
        for term in terms
        if term.model not in DIFFUSE
    },
    key=str,
)
SHAPES = {"eta": 1.5, "k": 0.7, "n": 20.0, "gamma": 2.2, "l": 0.2, "b": 10.0, "b0": 0.5, "c": 0.8, "h": 0.1}


def directions(count):
    u = np.random.default_rng(3).random((4, count))
    return (padded(from_spherical(1.5 * t, 2 * np.pi * p, np)) for t, p in (u[:2], u[2:]))


@pytest.mark.skipif(machine() is None, reason="this processor has no compiled loops")
def test_all_but_the_dearest_lobe_are_computed_by_loops():
    """Candidates are many: a kind that fell back to XLA unnoticed would cost seconds of each selection."""
    assert {frame.name for frame, names in KINDS if loop_of(frame, names) is None} <= {"std"}
    assert {frame.name for frame, _ in KINDS} >= {"ggx", "beckmann", "eon", "rpv", "hapke", "phong", "harvey_shack"}


@pytest.mark.parametrize("kind", [k for k in KINDS if k[0].name in ("ggx", "harvey_shack", "white_standard")], ids=str)
def test_loops_and_xla_agree_and_slopes_are_differences(kind, monkeypatch):
    frame, names = kind
    wi, wo = directions(300)
    shapes = np.array([[SHAPES.get(n, 0.3) for n in names], [1.1 * SHAPES.get(n, 0.3) for n in names]])
    values = lobe_values(frame, names, shapes, wi, wo)
    assert values.shape == (2, 512, 1 + len(names))
    for j in range(len(names)):
        step = 1e-6 * np.eye(len(names))[j]
        high, low = (lobe_values(frame, names, shapes + s, wi, wo)[:, :, 0] for s in (step, -step))
        scale = np.abs(values[:, :, 1 + j]).max()
        np.testing.assert_allclose(values[:, :, 1 + j], (high - low) / 2e-6, atol=1e-6 * scale + 1e-8, rtol=1e-4)
    monkeypatch.setenv("GONIO_EVALUATE_WITH", "xla")
    by_xla = lobe_values(frame, names, shapes, wi, wo)
    np.testing.assert_allclose(values, by_xla, rtol=1e-11, atol=1e-13 * np.abs(by_xla).max())

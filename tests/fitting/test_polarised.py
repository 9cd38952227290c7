"""Fits of polarised channels: what models hold of them, and what is said."""

import numpy as np
import pytest

import gonio
from support import mueller


def test_mueller_elements_and_stokes_parameters_are_refused_beside_the_first():
    f = mueller.on_grid(0)
    with pytest.raises(gonio.GonioError, match=r"m01, m02, m03, m10, …, m33 are elements .* fit m00 alone"):
        gonio.fit(mueller.list_of(f, mueller.NAMES), "lambert")
    with pytest.raises(gonio.GonioError, match=r"S1, S2, S3 are elements .*--channel 'S0'"):
        gonio.fit(mueller.list_of(f[..., ::4], ["S0", "S1", "S2", "S3"]))


def test_a_fit_of_states_says_that_models_are_of_unpolarised_light():
    f = np.abs(mueller.on_grid(0)[..., :2]) + 0.01
    notes = gonio.fit(mueller.list_of(f, ["s", "p"]), "lambert").notes
    assert any("not the material's" in note for note in notes)
    assert not any("polarised" in note for note in gonio.fit(mueller.list_of(f[..., :1], ["m00"]), "lambert").notes)

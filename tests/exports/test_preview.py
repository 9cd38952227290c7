"""The picture of a sphere by Mitsuba, and the sentence where that is not installed."""

import importlib.util

import mitsuba as mi
import numpy as np
import pytest

import gonio
from gonio.exports import preview
from gonio.exports.targets import canonical


def test_a_white_sphere_is_as_bright_as_its_lights_and_the_callers_variant_stays(monkeypatch):
    monkeypatch.setattr(preview, "SIDE", 32)
    monkeypatch.setattr(preview, "SAMPLES", 64)
    mi.set_variant("scalar_spectral")
    linear, error = preview.rendered(gonio.material("lambert(rho=1)"))
    assert mi.variant() == "scalar_spectral" and error.exact
    assert linear.shape == (32, 32, 3)
    np.testing.assert_allclose(linear[0, 0], 0.15, atol=0.01)  # the sky, which alone lights what faces away
    assert 0.95 < linear.max() < 1.25 and np.median(linear[20:28, 24:30]) < 0.4


def test_without_mitsuba_a_report_says_what_to_do(monkeypatch, tmp_path):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(gonio.GonioError, match="needs Mitsuba 3, which is not installed"):
        gonio.report("lambert(rho=0.3)", tmp_path / "page.html", render=True)
    assert list(tmp_path.iterdir()) == []


def test_radiance_is_written_over_the_patches_of_klems():
    assert [canonical(name) for name in ("Radiance", "OpenPBR", "CSV", None)] == ["klems", "materialx", "csv", None]

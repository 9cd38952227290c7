"""Colours of spectra against colour-science's own, and what is said where there is none."""

import dataclasses
import importlib.util
import re
import warnings

import numpy as np
import pytest

import gonio
from gonio.data.channels import Channels
from gonio.fitting.residuals.colour_difference import ciede2000, to_lab
from gonio.metrology.standards.colour import Reference, Viewing, colours, flop, held_ends, no_colour, weights_of
from gonio.metrology.standards.evaluation import Integrals, evaluated
from gonio.metrology.standards.reflectance import multi_angle, reflectance

NM = np.arange(360.0, 781.0, 10.0)
CHANNELS = Channels.of_wavelengths(NM)
RED, BLUE = (0.2 + 0.5 / (1 + np.exp(sign * (NM - 580) / 25)) for sign in (-1, 1))


def lab_of(spectrum, entries, sigma=0.01):
    """The quantities of a surface whose integrals are all this spectrum, with this noise."""
    size = len({i for e in entries for i in e.integrals})
    known = Integrals(np.tile(spectrum, (size, 1)), np.zeros((size, NM.size)), {})
    rows, _, undecided = evaluated(entries, CHANNELS, known, lambda entry, by: np.sqrt(np.sum((sigma * by) ** 2)))
    assert not undecided
    return {q.place + " " + q.name: q for q in rows}


@pytest.fixture(scope="module")
def science():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    return colour


@pytest.mark.parametrize("observer", [10, 2])
def test_colours_are_those_of_colour_science(science, observer):
    name = {10: "CIE 1964 10 Degree Standard Observer", 2: "CIE 1931 2 Degree Standard Observer"}[observer]
    factor = reflectance(5.0)[:1]
    rows = lab_of(RED, colours(factor, weights_of(CHANNELS, Viewing(observer=observer)), None))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        spectrum = science.SpectralDistribution(dict(zip(NM, RED, strict=True)))
        for light in ("D65", "A"):
            place = f"45°a:0° {light}/{observer}°"
            functions, illuminant = science.MSDS_CMFS[name], science.SDS_ILLUMINANTS[light]
            xyz = science.sd_to_XYZ(spectrum, functions, illuminant, method="Integration")
            ours = [rows[f"{place} {n}"].value for n in "XYZ"]
            np.testing.assert_allclose(ours, xyz, rtol=1e-4)
            white = science.sd_to_XYZ(science.sd_ones(), functions, illuminant, method="Integration")
            lab = science.XYZ_to_Lab(xyz / 100, science.XYZ_to_xy(white))
            np.testing.assert_allclose([rows[f"{place} {n}"].value for n in ("L*", "a*", "b*")], lab, atol=0.02)


def test_differences_are_those_of_colour_science(science):
    factor, weights = reflectance(5.0)[:1], weights_of(CHANNELS, Viewing(("D65",)))
    lab = [[lab_of(s, colours(factor, weights, None))[f"45°a:0° D65/10° {n}"].value for n in ("L*", "a*", "b*")]
           for s in (RED, BLUE)]  # fmt: skip
    rows = lab_of(RED, colours(factor, weights, {"45°a:0° D65/10°": Reference(np.array(lab[1]), np.zeros(3))}))
    expected = science.delta_E(np.array(lab[0]), np.array(lab[1]), method="CIE 2000")
    assert rows["45°a:0° D65/10° ΔE00"].value == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("share", [1.0, 0.9])
def test_the_uncertainty_of_a_difference_is_that_of_both_subjects(share):
    """Of 4,000 noisy spectra of a surface against the same surface, where a difference is all noise, and another."""
    factor, (w,) = reflectance(5.0)[:1], weights_of(CHANNELS, Viewing(("D65",)))
    place, rng, sigma = "45°a:0° D65/10°", np.random.default_rng(4), 0.002
    rows = lab_of(share * RED, colours(factor, [w], None))
    lab = np.array([rows[f"{place} {n}"].value for n in ("L*", "a*", "b*")])
    noisy = [s * RED + sigma * rng.standard_normal((4000, NM.size)) for s in (1.0, share)]
    first, second = (to_lab(s @ w.fine.T, w.white) for s in noisy)
    of_one, of_both = (
        lab_of(RED, colours(factor, [w], {place: Reference(lab, u)}), sigma)[f"{place} ΔE00"]
        for u in (np.zeros(3), second.std(axis=0))
    )
    for q, other in ((of_one, np.broadcast_to(lab, first.shape)), (of_both, second)):
        spread = np.sqrt(np.mean((ciede2000(first, other) - q.value) ** 2))
        assert 0.8 < q.u / spread < 1.4
    assert of_one.u < of_both.u


def test_the_flop_index_of_a_surface_that_does_not_change_is_0():
    angles, weights = multi_angle(), weights_of(CHANNELS, Viewing(("D65",)))
    entry = flop([angles[0], angles[2], angles[4]], weights[0])
    assert entry.combine(np.tile(RED, (3, 1))) == 0
    # L* of Y = 18.4187 is 50, of 100 is 100, of 0 is 0: 2.69 · 100^1.11 / 50^0.86.
    spectra = np.array([1.0, 0.184187, 0.0])[:, None] * np.ones(NM.size)
    assert entry.combine(spectra) == pytest.approx(2.69 * 100**1.11 / 50**0.86, rel=1e-4)


def test_what_has_no_colour_says_why(monkeypatch):
    rgb = Channels.rgb()
    assert "say --linear-srgb" in no_colour(rgb, Viewing())
    assert no_colour(rgb, Viewing(linear_srgb=True)) is None
    assert "steps of at most" in no_colour(Channels.of_wavelengths([450.0, 550.0, 650.0]), Viewing())
    gap = np.append(np.arange(400.0, 501, 20), np.arange(580.0, 701, 20))
    assert "in steps of up to 80 nm" in no_colour(Channels.of_wavelengths(gap), Viewing())
    assert "one wavelength, 532 nm, is not" in no_colour(Channels.of_wavelengths([532.0]), Viewing())
    twice = Channels((*CHANNELS.names, "again"), (*CHANNELS.wavelengths_nm, 550.0))
    assert "several of its channels are of 550 nm" in no_colour(twice, Viewing())
    assert no_colour(CHANNELS, Viewing()) is None
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert "pip install 'gonio[colour]'" in no_colour(CHANNELS, Viewing())


def test_a_white_diffuser_in_linear_srgb_is_white():
    material = dataclasses.replace(gonio.material("lambert(rho=[1, 1, 1])"), channels=Channels.rgb())
    rows = {
        (q.name, q.place): q.value for q in gonio.quantities(material, only=["colour"], linear_srgb=True).quantities
    }
    place = "45°a:0° D65/2°, from linear sRGB"
    assert [rows[n, place] for n in ("L*", "a*", "b*")] == pytest.approx([100, 0, 0], abs=1e-3)


def test_what_lies_beyond_the_ends_of_a_spectrum_is_said_and_bounds_what_it_does(science):
    short, whole = (Channels.of_wavelengths(np.arange(first, last, 10.0)) for first, last in ((400, 701), (360, 781)))
    assert held_ends(whole, Viewing()) is None and held_ends(Channels.rgb(), Viewing(linear_srgb=True)) is None
    said = held_ends(short, Viewing())
    assert "400 to 700 nm" in said
    share = float(re.search(r"up to ([\d.]+) %", said)[1]) / 100
    for bright in (np.array(whole.wavelengths_nm) > 700, np.array(whole.wavelengths_nm) < 400):
        for w in weights_of(whole, Viewing()):
            beyond = (w.rough @ bright) / w.white
            assert (beyond <= 1.2 * share).all()
    assert share > 0.001

"""Polarised channels: light that enters paint in one state and leaves it in another, by Fresnel's transmittances."""

import itertools

import numpy as np
import pytest

import gonio

N = 1.5
THETA = np.radians(np.arange(0, 81, 10))
PHI = np.radians(np.arange(0, 360, 30))


def transmittance(theta, state):
    """Of a smooth interface for s or p [Fresnel]."""
    cos_i, cos_t = np.cos(theta), np.sqrt(1 - (np.sin(theta) / N) ** 2)
    r = (cos_i - N * cos_t) / (cos_i + N * cos_t) if state == "s" else (N * cos_i - cos_t) / (N * cos_i + cos_t)
    return 1 - r**2


def paint(theta_i, theta_o, light, detector, rho=0.6):
    """f of a base that depolarises under a smooth interface; reciprocal, and the same for all azimuths."""
    return rho / (2 * np.pi) * transmittance(theta_i, light) * transmittance(theta_o, detector)


def table(channels, factor=lambda theta_i, theta_o: 1.0, rho=0.6):
    """A list of readings; `channels` map names to functions of ``f(light, detector)``."""
    theta_i, theta_o, phi = (a.ravel() for a in np.meshgrid(THETA, THETA, PHI, indexing="ij"))
    f = {a + b: factor(theta_i, theta_o) * paint(theta_i, theta_o, a, b, rho) for a, b in itertools.product("sp", "sp")}
    values = np.stack([channel(f) for channel in channels.values()], axis=-1)
    return gonio.Table.from_arrays(theta_i, 0, theta_o, phi, values, channels=list(channels))


FOUR = {f"{a} to {b}": lambda f, k=a + b: f[k] for a, b in itertools.product("sp", "sp")}
MUELLER = {
    "m00": lambda f: (f["ss"] + f["sp"] + f["ps"] + f["pp"]) / 2,
    "m01": lambda f: (f["ss"] + f["sp"] - f["ps"] - f["pp"]) / 2,
    "m10": lambda f: (f["ss"] - f["sp"] + f["ps"] - f["pp"]) / 2,
    "m11": lambda f: (f["ss"] - f["sp"] - f["ps"] + f["pp"]) / 2,
}
COMPLETE = {
    "all four": FOUR,
    "beside a wavelength": {f"550 nm {name}": channel for name, channel in FOUR.items()},
    "light alone": {"s": lambda f: f["ss"] + f["sp"], "p": lambda f: f["ps"] + f["pp"]},
    "detector alone": {"u to s": lambda f: (f["ss"] + f["ps"]) / 2, "u to p": lambda f: (f["sp"] + f["pp"]) / 2},
    "Mueller's matrix": MUELLER,
    "Mueller's matrix from 1": {f"M{int(name[1:]) + 11}": channel for name, channel in MUELLER.items()},
}


@pytest.mark.parametrize("channels", COMPLETE.values(), ids=COMPLETE)
def test_exchanged_light_has_the_exchanged_polarisation(channels):
    honest = gonio.check(table(channels))
    assert honest["reciprocity"].verdict == "pass" and honest["reciprocity"].residual < 1e-9
    assert honest["positivity"].verdict == "pass"
    tilted = gonio.check(table(channels, lambda i, o: 1 + 0.3 * (np.sin(i) - np.sin(o))))
    assert tilted["reciprocity"].verdict == "fail"


@pytest.mark.parametrize("channels", COMPLETE.values(), ids=COMPLETE)
def test_the_albedo_of_a_state_is_of_all_that_is_detected(channels):
    """1.3 of the light in both states together, of which each holds less than 1."""
    by_state = [1.3 / max(_albedo(t, s) for t in THETA for s in "sp")]
    assert gonio.check(table(channels, rho=0.6 * by_state[0]))["energy"].verdict == "fail"
    energy = gonio.check(table(channels))["energy"]
    assert energy.verdict != "fail" and energy.facts["largest_albedo"] < max(_albedo(t, "p") for t in THETA) + 0.02


def _albedo(theta, light):
    nodes, weights = np.polynomial.legendre.leggauss(40)
    cos_o = (nodes + 1) / 2
    f = sum(paint(theta, np.arccos(cos_o), light, b) for b in "sp")
    return np.pi * np.sum(weights * cos_o * f)


def test_what_was_not_read_of_the_other_polarisation_is_not_decided():
    judged = gonio.check(table({"s to p": FOUR["s to p"]}))
    assert judged["reciprocity"].verdict == "not testable" and judged["energy"].verdict == "undecided"
    assert "the exchanged polarisations of s to p were not read" in judged["reciprocity"].detail
    assert "in the other polarisation was not read" in judged["energy"].detail
    both = gonio.check(table({name: FOUR[name] for name in ("s to s", "s to p")}))
    assert both["reciprocity"].verdict == "undecided" and "in the other" not in both["energy"].detail


def test_a_repair_of_polarised_channels_is_refused():
    with pytest.raises(gonio.GonioError, match="polarised"):
        gonio.repair(table(FOUR))

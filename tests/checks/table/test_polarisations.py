"""Polarised channels: light that enters paint in one state and leaves it in another, by Fresnel's transmittances."""

import itertools

import numpy as np
import pytest

import gonio
from gonio.checks.certify import judged_property
from gonio.checks.table.evidence import TableEvidence
from support import mueller

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


def verdict(name, table):
    return judged_property(name, "table", TableEvidence(table)).verdict


@pytest.mark.parametrize("signs", [(1, 1, -1, 1), (1, 1, 1, -1), (1, 1, 1, 1), (1, 1, -1, -1)], ids=str)
def test_all_elements_go_back_up_to_the_signs_of_the_frames(signs):
    """M(i → o) = Q M(o → i)ᵀ Q [Sekera 1966]; frames change the signs of 45° and of circular light."""
    f = mueller.on_grid(3) * np.outer((1, 1, 1, 1), np.multiply(signs, (1, 1, -1, 1))).ravel()
    for made in (mueller.grid_of, mueller.list_of):
        assert verdict("reciprocity", made(f, mueller.NAMES)) == "pass"
    theta = mueller.THETA
    tilt = 1.0 * (np.sin(theta)[:, None, None] - np.sin(theta)[None, :, None])
    for k in range(16):
        one = np.where(np.arange(16) == k, tilt[..., None] * f[..., :1], 0.0)
        assert verdict("reciprocity", mueller.grid_of(f + one, mueller.NAMES)) == "fail", mueller.NAMES[k]


def test_mirror_images_change_the_signs_of_45_degrees_and_circular_light():
    f = mueller.on_grid(4)
    assert verdict("symmetry", mueller.grid_of(f, mueller.NAMES)) == "pass"
    leaning = f + 0.2 * f[..., :1] * (np.arange(16) == 2)
    assert verdict("symmetry", mueller.grid_of(leaning, mueller.NAMES)) == "fail"


def at_normal_incidence():
    """An isotropic surface: s of the light is that of the azimuth 0, s of the detector that of its own."""
    theta_i, theta_o, phi = np.meshgrid(np.radians([0, 20, 40, 60]), np.radians([0, 20, 40, 60]), PHI, indexing="ij")
    turned = np.where(theta_i == 0, 2 * phi, 0.0) + np.where((theta_o == 0) & (theta_i > 0), -2 * phi, 0.0)
    m11 = 0.05 * np.cos(turned)
    return theta_i, theta_o, phi, np.stack([0.1 + 0 * m11, 0 * m11, 0 * m11, m11], axis=-1)


@pytest.mark.parametrize("states", [False, True], ids=["Mueller's matrix", "s and p"])
def test_frames_at_the_normal_are_those_of_the_written_azimuth(states):
    theta_i, theta_o, phi, m = (a.reshape(-1, *a.shape[3:]) for a in at_normal_incidence())
    names = list(FOUR) if states else ["m00", "m01", "m10", "m11"]
    f = m @ np.array([[1, 1, 1, 1], [1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]]) / 2 if states else m
    certificate = gonio.check(gonio.Table.from_arrays(theta_i, 0, theta_o, phi, f, channels=names))
    assert certificate["reciprocity"].verdict == "pass" and certificate["isotropy"].verdict == "not applicable"
    assert "merged" not in certificate["reciprocity"].facts["method"]


def test_stokes_parameters_are_no_radiances():
    f = mueller.on_grid(6)[..., ::4]
    for names in (["S0", "S1", "S2", "S3"], ["550 nm I", "550 nm Q", "550 nm U", "550 nm V"]):
        certificate = gonio.check(mueller.list_of(f, names))
        assert certificate["positivity"].verdict == "pass" and certificate.overall != "fail"
        assert "polarised light beside" in certificate["energy"].detail
    apart = gonio.check(mueller.list_of(-np.abs(f[..., :2]), ["S0", "S1"]))
    assert apart["positivity"].verdict == "fail"


@pytest.mark.parametrize("column", [1, 2, 3])
def test_energy_counts_the_light_that_is_reflected_most(column):
    """A perfect polariser over a base of 0.6 reflects 1.2 of one state; 0.6 of it and the half of a polariser 0.9."""
    theta_i, *_ = np.meshgrid(THETA, THETA, PHI, indexing="ij")
    names = ["m00", "m01", "m02", "m03"]
    for share, expected in ((1.0, "fail"), (0.5, "pass")):
        f = np.zeros((*theta_i.shape, 4))
        f[..., 0], f[..., column] = 0.6 / np.pi, -0.6 * share / np.pi
        energy = gonio.check(gonio.Table.from_arrays(
            *(a.ravel() for a in (theta_i, 0 * theta_i, *np.meshgrid(THETA, THETA, PHI, indexing="ij")[1:])),
            f.reshape(-1, 4), channels=names))["energy"]  # fmt: skip
        assert energy.verdict == expected
        assert energy.facts["largest_albedo"] == pytest.approx(0.6 * (1 + share), abs=0.02)

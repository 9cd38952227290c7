"""Rows of many azimuths of the light: all that is said is of the quantities that were given."""

import numpy as np
import pytest

import gonio
from gonio.metrology.azimuths import fewer_azimuths
from gonio.metrology.quantity import Quantity


def albedos(theta, by_azimuth, name="albedo"):
    return [
        Quantity(name, f"θi {theta}°, φi {p}°", c, v, 0.0, {"theta_i": theta, "phi_i": p})
        for p, values in by_azimuth.items()
        for c, v in zip("RGB", values, strict=False)
    ]


def test_alike_azimuths_are_one_row_and_others_are_the_least_and_the_most():
    alike = albedos(30.0, dict.fromkeys((0.0, 90.0, 180.0, 270.0), (0.5, 0.4)))
    turned = albedos(60.0, {0.0: (0.5, 0.2), 90.0: (0.4, 0.4), 180.0: (0.5, 0.1), 270.0: (0.1, 0.4)})
    other = [Quantity("8°:di", "", "R", 0.3, 0.0)]
    rows = fewer_azimuths([*alike, *other, *turned])
    assert [(q.place, q.channel, q.value) for q in rows] == [
        ("θi 30°, 4 φi alike", "R", 0.5), ("θi 30°, 4 φi alike", "G", 0.4), ("", "R", 0.3),
        ("θi 60°, φi 90° (most of 4)", "R", 0.4), ("θi 60°, φi 90° (most of 4)", "G", 0.4),
        ("θi 60°, φi 270° (least of 4)", "R", 0.1), ("θi 60°, φi 270° (least of 4)", "G", 0.4),
    ]  # fmt: skip


@pytest.mark.parametrize("azimuths", [(0.0,), (0.0, 90.0, 180.0)])
def test_few_azimuths_are_listed_each(azimuths):
    rows = albedos(30.0, dict.fromkeys(azimuths, (0.5,)))
    assert fewer_azimuths(rows) == rows


@pytest.mark.parametrize("phi", [0.0, 137.0])
def test_albedos_of_light_from_one_azimuth_are_told_without_it(phi):
    """The normal among the incidences has none, whatever is written there."""
    theta, turn = np.radians(np.arange(0, 81, 10)), np.radians(np.arange(0, 360, 30))
    theta_i, theta_o, delta = (a.ravel() for a in np.meshgrid(theta, theta, turn, indexing="ij"))
    light = np.radians(phi)
    table = gonio.Table.from_arrays(theta_i, light, theta_o, (delta + light) % (2 * np.pi), 0.1 + 0 * delta)
    albedos = [q for q in gonio.quantities(table).quantities if q.name == "albedo"]
    assert [q.place for q in albedos] == [f"θi {t}°" for t in range(0, 81, 10)]

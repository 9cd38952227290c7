"""Energy of lobes between the readings: what the readings allow is never less than what a lobe has."""

import numpy as np
import pytest

from gonio.checks.hidden_lobes import (
    ALPHAS,
    NearMirror,
    alpha_of,
    at_width,
    credible,
    hidden_energy,
    refracted,
    width_of,
)
from gonio.models.albedo import directional_transmittance
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import from_spherical

STEP = np.radians(5.0)


def nodes_of(theta_i, shift, turn, step=STEP):
    """Nodes that miss the mirror direction by a polar angle and an azimuth, with their weights."""
    polar, azimuth = np.arange(shift, np.pi / 2 - 1e-6, step), np.arange(turn, 2 * np.pi, step)
    theta, phi = (a.ravel() for a in np.meshgrid(polar, azimuth, indexing="ij"))
    return NearMirror.of((theta_i, 0.0), theta, phi, np.sin(theta) * np.cos(theta) * step**2), theta, phi


def lobe_at(alpha, theta_i, theta, phi):
    wi = from_spherical(np.full_like(theta, theta_i), np.zeros_like(theta), np)
    return np.asarray(evaluate(build(f"beckmann(alpha={alpha})"), wi, from_spherical(theta, phi, np))).reshape(-1, 1)


@pytest.mark.parametrize("seed", range(12))
def test_the_readings_of_a_lobe_allow_at_least_the_energy_that_it_has(seed):
    rng = np.random.default_rng(seed)
    alpha, theta_i = 10 ** rng.uniform(-2.5, -1.3), np.radians(rng.uniform(0, 60))
    near, theta, phi = nodes_of(theta_i, *np.radians(rng.uniform(0.5, 4.5, 2)))
    limit = credible(lobe_at(alpha, theta_i, theta[near.number], phi[near.number]), np.ones(1))
    hidden = at_width(hidden_energy(near, limit, isotropic=True), width_of(alpha))
    seen = np.sum(near.weight[:, None] * limit, axis=0)
    # Nearly all of the light: facets as narrow as this shadow little below 60°.
    nearest = near.theta_h.min() < alpha * np.sqrt(np.log(2))
    assert nearest or seen + hidden >= 0.99
    elongated = at_width(hidden_energy(near, limit, isotropic=False), width_of(alpha))
    assert elongated >= hidden - 1e-12


@pytest.mark.parametrize("seed", range(8))
def test_a_narrow_and_a_wide_lobe_together_have_no_more_than_the_readings_allow(seed):
    """Readings at and beside the mirror direction: the narrow one makes the first of them, the wide one the others."""
    rng = np.random.default_rng(seed)
    theta_i, (narrow, wide) = np.radians(rng.choice([0.0, 20.0, 40.0])), rng.uniform([0.002, 0.01], [0.008, 0.022])
    near, theta, phi = nodes_of(theta_i, np.radians(5), 0.0, 2 * STEP)
    beside = theta_i + np.radians([0.0, 0.7, 1.5, 3.0])
    further = NearMirror.of((theta_i, 0.0), beside, np.full(beside.size, np.pi), np.zeros(beside.size))
    theta, phi = (np.append(a[near.number], b) for a, b in ((theta, beside[further.number]), (phi, [np.pi] * 4)))
    share = rng.uniform(0.2, 0.8)
    limit = share * lobe_at(narrow, theta_i, theta, phi) + (1 - share) * lobe_at(wide, theta_i, theta, phi)
    seen = near.joined(further)
    hidden = hidden_energy(seen, credible(limit, np.ones(1)), isotropic=True).max()
    assert seen.weight @ limit[:, 0] + hidden >= 0.99


@pytest.mark.parametrize("seed", range(16))
def test_the_readings_of_refracted_light_allow_at_least_the_energy_that_it_has(seed):
    """From either side of an interface, and beyond the angle of total reflection."""
    rng = np.random.default_rng(seed)
    alpha, theta_i, eta = 10 ** rng.uniform(-2.3, -0.7), np.radians(rng.uniform(0, 65)), rng.choice([1.33, 1.5, 2.0])
    light = 1 if seed % 2 else -1
    bend = 1 / eta if light > 0 else eta
    polar, azimuth = np.radians(np.arange(rng.uniform(0.5, 4.5), 90, 5)), np.radians(np.arange(2.5, 360, 5))
    theta, phi = (a.ravel() for a in np.meshgrid(polar, azimuth, indexing="ij"))
    weight = np.sin(theta) * np.cos(theta) * STEP**2
    near = NearMirror.of((theta_i, 0.0), theta, phi, weight, bend)
    glass = build(f"rough_dielectric(alpha={alpha}, eta={eta}, distribution=beckmann)")
    wi, wo = (from_spherical(t, p, np) for t, p in ((np.full_like(theta, theta_i), np.zeros_like(theta)), (theta, phi)))
    wi, wo = wi._replace(z=light * wi.z), wo._replace(z=-light * wo.z)
    limit = np.asarray(evaluate(glass, wi, wo)).reshape(-1, 1)
    lobes = refracted(theta_i, bend)
    k = int(np.searchsorted(lobes.alpha, alpha * (1 + 1e-9))) - 1
    hidden = hidden_energy(near, credible(limit[near.number], np.ones(1)), isotropic=True, lobes=lobes)[k, 0]
    through = directional_transmittance(glass, theta_i if light > 0 else np.pi - theta_i, tolerance=1e-4).value
    shown = near.number.size and near.theta_h.min() < np.arctan(alpha * np.sqrt(np.log(2)))
    assert shown or weight @ limit[:, 0] + hidden >= 0.99 * through


def test_narrower_lobes_hide_more_and_a_reading_at_the_mirror_direction_bounds_them_all():
    near, *_ = nodes_of(np.radians(40), np.radians(2.5), 0.0)
    limit = np.full((near.number.size, 1), 0.1)
    hidden = hidden_energy(near, limit, isotropic=True)[:, 0]
    assert np.all(hidden[1:] <= hidden[:-1]) and hidden[0] > 1e6 and hidden[-1] == 0
    mirror = (1e-6, 0.0, np.cos(np.radians(40)) ** 2, 0.0, 999)
    seen = NearMirror(*(np.append(a, b) for a, b in zip(near, mirror, strict=True)))
    assert hidden_energy(seen, np.append(limit, [[0.1]], axis=0), isotropic=True).max() < 1e-3


def test_widths_are_full_widths_at_half_maximum():
    for alpha in (ALPHAS[0], 0.01, 0.2):
        assert alpha_of(width_of(alpha)) == pytest.approx(alpha)
    half = np.array([0.0, width_of(0.05) / 2])  # at normal incidence, a quarter of the width in the half vector
    peak, there = lobe_at(0.05, 1e-9, half, np.zeros(2))[:, 0]
    assert there / peak == pytest.approx(0.5, rel=0.02)

"""A sheet between two rough faces by Monte Carlo: rays that meet facets with Gaussian slopes, and bounce between them.

Written from the geometry alone [Walter 2007]: visible facets, Fresnel's equations without polarisation, masking by G1
of what leaves a facet; light that a facet sends to the wrong side is lost. Every ray is split into what a face reflects
and what it passes. Directions are those of travel, arrays of shape (3, rays), in front of the sheet z > 0.
"""

import math
from typing import NamedTuple

import numpy as np

BOUNCES = 40
STEEP = np.linspace(0, 6, 4001)
_ERF = np.array([math.erf(a) for a in STEEP])
_G1 = 1 / (0.5 + _ERF / 2 + np.exp(-(STEEP**2)) / (2 * np.sqrt(np.pi) * np.maximum(STEEP, 1e-12)))


def steepness(cosine, alpha):
    return cosine / (alpha * np.sqrt(np.maximum(1 - cosine**2, 1e-30)))


def masking(cosine, alpha):
    """Smith's G1 of Gaussian slopes."""
    return np.interp(steepness(cosine, alpha), STEEP, _G1)


def fresnel(cos_i, eta):
    """(reflectance, cosine on the other side) towards a medium of relative index eta."""
    cos2_t = 1 - (1 - cos_i**2) / eta**2
    cos_t = np.sqrt(np.maximum(cos2_t, 0))
    s, p = (cos_i - eta * cos_t) / (cos_i + eta * cos_t), (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    return np.where(cos2_t > 0, (s**2 + p**2) / 2, 1.0), cos_t


def visible_facets(back, alpha, rng):
    """Normals that are seen along `back` (z > 0), drawn by their projected area: by rejection, slopes below 4 α."""
    limit = np.minimum(steepness(back[2], alpha), 1e9)
    slope, left = np.empty(limit.size), np.arange(limit.size)
    while left.size:
        drawn = rng.normal(0, np.sqrt(0.5), left.size)
        kept = rng.random(left.size) * (limit[left] + 4) < limit[left] - drawn
        slope[left[kept]], left = drawn[kept], left[~kept]
    along, across = alpha * slope, alpha * rng.normal(0, np.sqrt(0.5), limit.size)
    sine = np.hypot(back[0], back[1])
    x, y = np.where(sine > 0, back[:2], [[1.0], [0.0]]) / np.where(sine > 0, sine, 1.0)
    m = np.stack([-along * x + across * y, -along * y - across * x, np.ones_like(x)])
    return m / np.linalg.norm(m, axis=0)


def met(ray, alpha, eta, rng):
    """(reflected, its weight, refracted, its weight) of rays that travel down onto a face with index eta below."""
    m = visible_facets(-ray, alpha, rng)
    cos_i = -np.sum(m * ray, axis=0)
    mirrored, cos_t = fresnel(cos_i, eta)
    up, down = ray + 2 * cos_i * m, ray / eta + (cos_i / eta - cos_t) * m
    weights = (np.where(z > 0, masking(np.abs(z), alpha), 0.0) for z in (up[2], -down[2]))
    return up, mirrored * next(weights), down, (1 - mirrored) * next(weights)


def facet_density(m, alpha):
    return np.exp((1 - 1 / m[2] ** 2) / alpha**2) / (np.pi * alpha**2 * m[2] ** 4)


def reflected_f(back, view, alpha, eta):
    h = back + view
    h = h / np.linalg.norm(h, axis=0)
    share = fresnel(np.sum(back * h, axis=0), eta)[0] * masking(back[2], alpha) * masking(view[2], alpha)
    return share * facet_density(h, alpha) / (4 * back[2] * view[2])


def leaving_f(ray, view, alpha, eta):
    """f_t of rays that travel up inside towards a view above: n_i = η, n_o = 1."""
    h = eta * ray - view[:, None]
    h = h / np.linalg.norm(h, axis=0) * np.where(h[2] < 0, -1.0, 1.0)
    inside, outside = np.sum(ray * h, axis=0), np.sum(view[:, None] * h, axis=0)
    ok = (inside > 0) & (outside > 0)
    inside, outside = np.where(ok, inside, 1.0), np.where(ok, outside, 1.0)
    passed = (1 - fresnel(inside, 1 / eta)[0]) * masking(np.abs(ray[2]), alpha) * masking(view[2], alpha)
    f = inside * outside * passed * facet_density(h, alpha) / (ray[2] * view[2] * (outside - eta * inside) ** 2)
    return np.where(ok, f, 0.0)


class Sheet(NamedTuple):
    alpha: float
    alpha_behind: float
    eta: float
    clear: float = 1.0


def sheet_light(sheet, theta, rays, seed, views=()):
    """(R, T, f of each view) of light from the front at the polar angle theta; views are unit vectors."""
    rng = np.random.default_rng(seed)
    ray = np.tile([[-np.sin(theta)], [0.0], [-np.cos(theta)]], rays)
    views, f, turn = [np.array(v) for v in views], np.zeros(len(views)), np.array([[1.0], [1.0], [-1.0]])
    _, mirrored, ray, weight = met(ray, sheet.alpha, sheet.eta, rng)
    sides = [mirrored.sum(), 0.0]
    for n, view in enumerate(views):
        if view[2] > 0:
            f[n] = reflected_f(np.array([np.sin(theta), 0.0, np.cos(theta)]), view, sheet.alpha, sheet.eta)
    for bounce in range(BOUNCES):
        kept = weight > 1e-7
        ray, weight = ray[:, kept], weight[kept] * sheet.clear ** (1 / np.abs(ray[2, kept]))
        back = bounce % 2 == 1  # towards the front face
        alpha, ray = (sheet.alpha if back else sheet.alpha_behind), (ray * turn if back else ray)
        for n, view in enumerate(views):
            if (view[2] > 0) == back:
                above = view * [1, 1, 1 if back else -1]
                f[n] += np.sum(weight * leaving_f(ray * turn, above, alpha, sheet.eta)) / rays
        up, mirrored, _, passed = met(ray, alpha, 1 / sheet.eta, rng)
        sides[0 if back else 1] += np.sum(weight * passed)
        ray, weight = (up * turn if back else up), weight * mirrored
    return sides[0] / rays, sides[1] / rays, f

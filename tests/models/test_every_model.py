"""What holds of every model: numbers where there should be, nothing below the horizon, reciprocity, honest maps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.catalog import MODELS
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.horizon import Hemispheres
from gonio.stability.run import QUICK
from support.cases import cases_of
from support.traced import as_for_users, by_numpy

MOST = 2
"""Forms of a model, each of its settings in all: what a trace holds, with options and numbers of channels."""
LONG = ("rough_slab",)
"""Models of thousands of steps: one setting of each, where not all settings are asked for."""


def models_of(name):
    """(case, model) of each setting of a model."""
    return [(k, build(v) if isinstance(v, str) else v()) for k, v in cases_of(name).items()]


def most_models_of(name):
    """(case, model) of the settings of a few forms; of all where programs are compiled as users have them."""
    forms = {}
    for case, brdf in models_of(name):
        form = (jax.tree.structure(brdf), *(np.shape(leaf) for leaf in jax.tree.leaves(brdf)))
        forms.setdefault(form, []).append((case, brdf))
    groups = list(forms.values())
    if len(groups) > MOST and not as_for_users():
        groups = [*groups[: MOST - 1], groups[-1]]
    if name in LONG and not as_for_users():
        return groups[0][-1:]
    return [case for group in groups for case in group]


def unit(theta, phi):
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def edges():
    """Pairs of unit vectors (n, 3) where formulas break: normal, retro, mirror, both grazing, the horizon itself."""
    wi, wo = [], []
    for theta in (0.0, 0.7, 1.3, np.pi / 2 - 1e-3, np.arccos(1e-8)):
        w = unit(theta, 0.4)
        for other in (w * [-1, -1, 1], w, unit(0, 0), unit(1.0, 2.0), unit(np.arccos(1e-8), 0.4), unit(1.5, 3.5)):
            wi.append(w)
            wo.append(other)
    exact = np.array([0.6, 0.8, 0.0])  # cos = 0, exactly
    for a, b in ((exact, -exact), (exact, exact), (exact, unit(0.5, 1.0)), (unit(0.5, 1.0), exact)):
        wi.append(a)
        wo.append(b)
    return np.array(wi), np.array(wo)


def scattered(count):
    """Pairs everywhere, and as many near the mirror direction and back."""
    rng = np.random.default_rng(1)
    theta, phi = np.arccos(rng.uniform(0, 1, (2, count))), rng.uniform(0, 2 * np.pi, (2, count))
    step = 10.0 ** rng.uniform(-4, -1, count)
    away = np.where(rng.random(count) < 0.7, np.pi, 0.0) + step * rng.normal(size=count)
    a, b = ([unit(t, p) for t, p in zip(*w, strict=True)] for w in zip(theta, phi, strict=True))
    near = [unit(t * (1 - s / 2), p + q) for t, p, s, q in zip(theta[0], phi[0], step, away, strict=True)]
    return np.stack([*a, *a]), np.stack([*b, *near])


DOWN = np.array([1.0, 1.0, -1.0])


def directions(w, dtype=float):
    return Direction(*(jnp.asarray(c, dtype) for c in np.asarray(w).T))


@by_numpy
def with_slopes(brdf, wi, wo):
    """f of every pair, and the gradient of the sum over channels by parameters and components."""

    def one(parts):
        f = parts[0].f(parts[1], parts[2])
        return jnp.sum(f), f

    return jax.vmap(jax.value_and_grad(one, has_aux=True), in_axes=((None, 0, 0),))((brdf, wi, wo))


def of_all(brdf, *pairs, dtype=float):
    """For each (wi, wo) of unit vectors (n, 3): f and the slopes, all computed at once."""
    wi, wo = (np.concatenate([np.asarray(p[k]) for p in pairs]) for k in (0, 1))
    (_, f), slopes = with_slopes(brdf, directions(wi, dtype), directions(wo, dtype))
    ends = np.cumsum([len(p[0]) for p in pairs])[:-1]
    parts = [np.split(np.asarray(a), ends) for a in (f, *jax.tree.leaves(slopes))]
    return [(leaves[0], leaves[1:]) for leaves in zip(*parts, strict=True)]


def finite(f, slopes):
    return all(np.isfinite(a).all() for a in (f, *slopes))


@pytest.mark.parametrize("name", MODELS)
def test_values_and_gradients_are_numbers_and_reciprocal(name):
    """Finite in both precisions over the closed hemisphere, 0 at and below the horizon, the same both ways.

    Unless the published formula breaks a law, and says so.
    """
    wi, wo = edges()
    elsewhere = scattered(len(wi) // 2)
    up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    below = ((wi * DOWN, wo), (wi, wo * DOWN), (wi * DOWN, wo * DOWN))
    cases = most_models_of(name)
    for case, brdf in cases:
        above, there, back, *dark = of_all(brdf, (wi, wo), elsewhere, elsewhere[::-1], *below)
        assert finite(*above), case
        assert (above[0][~up] == 0).all(), case
        if Hemispheres.TRANSMISSION in brdf.hemispheres:
            through_and_back(case, brdf, dark, elsewhere)
        else:
            assert not any(np.any(leaf) for f, slopes in dark for leaf in (f, *slopes)), case
        if "positivity" not in brdf.violates:
            assert (above[0] >= 0).all(), case
        if "reciprocity" not in brdf.violates:
            np.testing.assert_allclose(there[0], back[0], rtol=2e-11, atol=1e-290, err_msg=case)
    if name not in QUICK:  # the atlas looks at single precision in all of them
        return
    single = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), cases[0][1])
    near = up & (wi[:, 2] > 1e-4) & (wo[:, 2] > 1e-4)
    ((f, slopes),) = of_all(single, (wi[near], wo[near]), dtype=np.float32)
    assert f.dtype == np.float32 and finite(f, slopes)


def through_and_back(case, brdf, below, elsewhere):
    """Finite on all sides, 0 on those that the model does not declare, and f_t(i→o)/n_o² = f_t(o→i)/n_i²."""
    ways = (Hemispheres.TRANSMISSION, Hemispheres.TRANSMISSION, Hemispheres.BACK)
    flips = ((DOWN, 1), (1, DOWN), (DOWN, DOWN))
    pairs = [(elsewhere[0] * i, elsewhere[1] * o) for i, o in flips]
    values = of_all(brdf, *pairs, *(pair[::-1] for pair in pairs))
    for way, (down_i, _), (f, slopes), (there, _), (back, _) in zip(
        ways, flips, below, values[:3], values[3:], strict=True
    ):
        assert finite(f, slopes) and (f >= 0).all(), case
        assert way in brdf.hemispheres or not f.any(), case
        n2 = 1.0 if way == Hemispheres.BACK else np.asarray(brdf.index_behind) ** (2 if np.ndim(down_i) else -2)
        np.testing.assert_allclose(there * n2, back, rtol=2e-11, atol=1e-290, err_msg=case)


STEP = 1e-5
STENCIL = STEP * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])


@by_numpy
def drawn_and_mapped(brdf, wi, u):
    """At points (n, 2) of the unit square: the sampler's direction and its density, the lobe map's, its Jacobian."""

    def one(u):
        drawn, _ = brdf.sample(wi, u[0], u[1])
        mapped, jacobian = brdf.lobe_map(wi, u[0], u[1])
        return jnp.stack(tuple(drawn)), brdf.pdf(wi, drawn), jnp.stack(tuple(mapped)), jacobian

    return jax.vmap(one)(u)


def area(w):
    """|∂w/∂u1 × ∂w/∂u2| by central differences of directions (n, 5, 3) at the points of the stencil."""
    along = (w[:, 1::2] - w[:, 2::2]) / (2 * STEP)
    return np.linalg.norm(np.cross(along[:, 0], along[:, 1]), axis=-1)


def maps(brdf, wi, u):
    """At points of the unit square: |∂wo/∂u1 × ∂wo/∂u2| pdf of the sampler; the map's area, its Jacobian, |wo.z|."""
    around = (u[:, None] + STENCIL).reshape(-1, 2)
    made = (np.asarray(a) for a in drawn_and_mapped(brdf, wi, jnp.asarray(around)))
    drawn, density, mapped, jacobian = (a.reshape(u.shape[0], len(STENCIL), *a.shape[1:]) for a in made)
    return area(drawn) * density[:, 0], area(mapped), jacobian[:, 0], np.abs(mapped[:, 0, 2])


MIXTURES = ("principled", "kelemen", "coat", "thin_sheet", "rough_dielectric", "rough_slab")
"""Models that draw from several lobes: their density is not that of one map. Their samplers have the χ² test."""


@pytest.mark.parametrize("name", MODELS)
def test_densities_and_jacobians_are_those_of_the_maps(name):
    """pdf(sample(u)) |∂sample/∂u| = 1, and the lobe map's Jacobian is its own area, by differences of directions."""
    u = np.random.default_rng(2).uniform(0.02, 0.98, (64, 2))
    (case, brdf), *_ = models_of(name)
    for part in brdf.terms() if name in MIXTURES else (brdf,):
        for theta in (0.0, 1.5):
            wi = Direction(*(jnp.asarray(c) for c in unit(theta, 0.3)))
            density, spread, jacobian, up = maps(part, wi, u)
            shown = (up > 1e-3) & (jacobian > 0)
            np.testing.assert_allclose(spread[shown] / jacobian[shown], 1, rtol=1e-5, err_msg=case)
            if name not in MIXTURES:
                np.testing.assert_allclose(density, 1, rtol=1e-5, err_msg=f"{case} at {theta}")

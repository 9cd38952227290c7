"""Models over many directions: in blocks."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models import evaluation as module
from gonio.models.diffuse.lambert import Lambert
from gonio.models.diffuse.minnaert import Minnaert
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction, from_spherical


def test_blocks_cover_every_pair_once(monkeypatch):
    """23 pairs in blocks of 7, whose last begins inside the one before it, and all at once."""
    monkeypatch.setenv("GONIO_NO_CACHE", "1")  # where another process has kept this program with larger blocks
    monkeypatch.setattr(module, "BLOCK", 7)
    monkeypatch.setattr(module, "directed_values", lambda *_: None)  # what XLA evaluates
    theta, rho = np.linspace(0.0, 1.5, 23), jnp.array([0.2, 0.5, 0.9])
    wi, wo = from_spherical(theta, 0.0), from_spherical(theta[::-1], 2.0)
    coloured = module.evaluate(Lambert(rho) + rho * Minnaert(rho=jnp.array(0.5), k=jnp.array(0.7)), wi, wo)
    grey = module.evaluate(Minnaert(rho=jnp.array(0.5), k=jnp.array(0.7)), wi, wo)
    assert coloured.shape == (23, 3)
    np.testing.assert_allclose(coloured, np.asarray(rho) * (1 / np.pi + np.asarray(grey)[:, None]), rtol=1e-14)
    assert len(set(np.asarray(grey).round(12))) > 10


def test_single_precision_stays_single():
    pair = [jnp.asarray(c, jnp.float32) for c in (0.6, 0.0, 0.8)]
    coat = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), build("coat(base=lambert(rho=0.5), alpha=0.1, eta=1.5)"))
    wi = Direction(*(jnp.full(3, c) for c in pair))
    assert module._values(coat, wi, wi).dtype == jnp.float32


def test_directions_never_mix_with_channels():
    coloured, grey = Lambert(rho=jnp.array([0.1, 0.2, 0.3])), Lambert(rho=0.3)
    three = from_spherical(jnp.array([0.1, 0.2, 0.3]), 0.0)
    with pytest.raises(GonioError, match=r"3 channels.*evaluate"):
        coloured.f(three, three)
    assert module.evaluate(coloured, three, three).shape == (3, 3)
    assert grey.f(three, three).shape == (3,)
    with pytest.raises(GonioError, match="Direction"):
        module.evaluate(coloured, np.eye(3), three)
    with pytest.raises(GonioError, match="broadcast"):
        module.evaluate(coloured, three, from_spherical(jnp.array([0.1, 0.2]), 0.0))
    with pytest.raises(TypeError, match="formula"):
        type("Own", (Lambert,), {"f": lambda self, wi, wo: 0.0})

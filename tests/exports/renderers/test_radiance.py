"""What `--to radiance` writes, asked of Radiance's own library."""

import numpy as np
import pytest

import gonio
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction
from support import radiance


@pytest.mark.skipif(not radiance.installed(), reason="Radiance's own reader is not installed")
def test_radiance_reads_values_and_shares_of_what_is_written_for_it(tmp_path):
    """f to the ±0.03 % by which Radiance's program marks the place of a value; its front is the file's back."""
    path, rho = tmp_path / "out.xml", 0.3
    gonio.convert(f"lambert(rho={rho}) + 0.5 * ggx(alpha=0.3)", path, to="radiance", basis="quarter")
    rng = np.random.default_rng(4)
    theta, phi = rng.uniform(0.02, 1.4, (2, 40)), rng.uniform(0, 2 * np.pi, (2, 40))
    wi, wo = (
        Direction(np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)) for t, p in zip(theta, phi, strict=True)
    )
    degrees = np.degrees(np.stack([np.pi - theta[0], phi[0], np.pi - theta[1], phi[1]], axis=-1))
    theirs = radiance.ask(path, [(180.0 - 18.0, 0.0, "reflection")], degrees)
    ours = gonio.open(path).interpolant()
    np.testing.assert_allclose(np.ravel(evaluate(ours, wi, wo)), theirs.values, rtol=4e-4, atol=1e-7)
    # The light that leaves is the model's
    material = gonio.material(f"lambert(rho={rho}) + 0.5 * ggx(alpha=0.3)")
    np.testing.assert_allclose(theirs.shares[0], material.albedo([np.radians(18.0)]).value[0, 0], rtol=0.02)

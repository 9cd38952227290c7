"""Fits of many channels: as good as those of few, and linear in time and size."""

import numpy as np
import pytest

from gonio.cli.verbs.fit_verb import summary
from gonio.data import layouts
from gonio.data.table import Channels, whole_table_of_values
from gonio.fitting.fit_table import fit
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

COUNT = 60
GEOMETRIES = np.radians([(45, 20, p) for p in range(0, 181, 30)] + [(15, 0, 0), (45, 30, 180), (65, 15, 180)])


@pytest.fixture(scope="module")
def spectrum():
    """A paint of 60 wavelengths read at ten pairs of directions, its albedo and the strength of its highlight."""
    x = np.linspace(0, 1, COUNT)
    rho, scale = 0.05 + 0.4 * x**2, 0.5 - 0.3 * x
    theta_i, theta_o, phi = GEOMETRIES.T
    layout = layouts.scattered(theta_i, np.zeros_like(phi), theta_o, phi)
    paint = build(f"lambert(rho={rho.tolist()}) + {scale.tolist()} * ggx(alpha=0.25)")
    f = np.asarray(evaluate(paint, *layout.directions())).reshape(-1, COUNT)
    f = f * (1 + 0.01 * np.random.default_rng(0).standard_normal(f.shape))
    channels = Channels.of_wavelengths(np.linspace(400, 700, COUNT).tolist())
    return whole_table_of_values(layout, f, channels, u_f=0.01 * f, name="paint"), rho, scale


@pytest.fixture(scope="module")
def joint(spectrum):
    # A start so wide that the linear numbers alone are projected, and the projection refused.
    return fit(spectrum[0], "lambert + ggx(alpha~0.7513)", starts=0)


def of(result, name):
    return np.array([[p.value, p.standard_uncertainty] for p in result.parameters if p.name == name]).T


def test_numbers_of_all_channels_are_the_truth_within_their_uncertainties(spectrum, joint):
    _, rho, scale = spectrum
    assert joint.converged and len(joint.free_names) == 1 + 2 * COUNT
    for name, truth in (("lambert.rho", rho), ("ggx.scale", scale), ("ggx.alpha", 0.25)):
        value, u = of(joint, name)
        z = (value - truth) / u
        assert np.sqrt(np.mean(z**2)) < 2 and np.max(np.abs(z)) < 5


def test_a_channel_alone_gives_the_same_numbers(spectrum, joint):
    """With the joint shape held, a channel's numbers do not depend on the other channels."""
    (alpha,), _ = of(joint, "ggx.alpha")
    for c in (0, 31):
        alone = fit(spectrum[0].only([joint.channels.names[c]]), f"lambert + ggx(alpha={float(alpha)!r})", starts=0)
        for name in ("lambert.rho", "ggx.scale"):
            value, u = of(joint, name)
            assert of(alone, name)[0, 0] == pytest.approx(value[c], abs=1e-6 * u[c])


def test_uncertainties_are_those_of_the_whole_covariance(joint):
    """What is kept channel by channel, and the covariance in full with what channels share."""
    u = [p.standard_uncertainty for p in joint.parameters if p.status != "fixed"]
    np.testing.assert_allclose(np.sqrt(np.diagonal(joint.covariance)), u, rtol=1e-9)
    assert np.linalg.eigvalsh(joint.correlation).min() > -1e-9
    content = joint.to_dict()
    assert "covariance" not in content and len(content["covariance_by_channel"]) == COUNT
    for view in content["covariance_by_channel"][::20]:
        np.testing.assert_allclose(view["covariance"], joint.covariance[np.ix_(*[view["numbers"]] * 2)], rtol=1e-9)


def test_a_summary_of_many_channels_is_short(joint):
    lines = "\n".join(summary(joint)).splitlines()
    assert len(lines) < 30 and any(f"lambert.rho ({COUNT} channels)" in line for line in lines)


def test_every_channel_may_have_its_shape(spectrum):
    """Nothing is shared: the arrow has no corner, and the joint fit is those of all channels."""
    together = fit(spectrum[0], "lambert + ggx(alpha=each)")
    assert together.converged
    for c in (3, 44):
        alone = fit(spectrum[0].only([together.channels.names[c]]), "lambert + ggx")
        for name in ("lambert.rho", "ggx.scale", "ggx.alpha"):
            value, u = of(together, name)
            assert of(alone, name)[0, 0] == pytest.approx(value[c], abs=1e-3 * u[c])

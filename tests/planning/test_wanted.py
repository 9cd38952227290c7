"""Slopes of albedos by a model's numbers, against what the albedo is a known function of."""

import numpy as np

from gonio.planning.prior import prior_of
from gonio.planning.wanted import INCIDENCES, quantities

RHO = (0.2, 0.3, 0.4)


def test_a_channels_albedo_follows_its_own_numbers_alone():
    # A diffuser's albedo is ρ; a lobe's is in proportion to its scale.
    prior = prior_of(f"lambert(rho={list(RHO)}) + [0.5, 0.6, 0.7] * ggx(alpha=0.3)", None)
    made = quantities(prior, prior.p, ["albedo"])
    slopes = made.slopes.reshape(len(INCIDENCES), 3, prior.p.size)
    by_rho, by_scale = (
        slopes[:, :, [k for k, n in enumerate(prior.names) if n.startswith(name)]]
        for name in ("lambert.rho", "ggx.scale")
    )
    np.testing.assert_allclose(by_rho, np.broadcast_to(np.eye(3), by_rho.shape), atol=1e-9)
    of_lobe = made.values.reshape(len(INCIDENCES), 3) - RHO
    scales = prior.p[[n.startswith("ggx.scale") for n in prior.names]]
    np.testing.assert_allclose(by_scale, np.eye(3) * (of_lobe / scales)[:, :, None], atol=1e-6)

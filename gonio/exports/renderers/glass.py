"""A rough interface that reflects and refracts, as several renderers say it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.exports.forms import Form, Number, Values
from gonio.exports.pairs import Pairs
from gonio.exports.renderers.lobes import Smith, column, dielectric, ggx_facets, interface_shares, refracted

NUMBERS = (Number("alpha", 1e-4, 1.0, 0.2, log=True, width=True), Number("eta", 0.3, 4.0, 1.5, log=True))


def glass(
    describe: Callable[[Values], Any],
    smith: Smith = "correlated",
    fresnel: Callable[[Any, Any], Any] = dielectric,
    whole: bool = False,
) -> Form:
    """F D G/(4 cosθi cosθo) in front, and with 1 − F of the light through it.

    Args:
        describe: the renderer's words for α and η.
        smith: how its maskings combine.
        fresnel: reflectance by cosine and index.
        whole: whether what bounces more than once is given back, by the shares of the light from the view.
    """

    def f(v: Values, pairs: Pairs) -> np.ndarray:
        alpha, eta, front = v["alpha"], float(v["eta"]), bool(np.all(pairs.wo.z > 0))
        if front:
            values = fresnel(pairs.cos_d, eta) * ggx_facets(pairs, alpha, alpha, smith)
        else:
            passed, cos_d = refracted(pairs, alpha, alpha, eta, smith)
            values = (1.0 - fresnel(cos_d, eta)) * passed
        if not whole:
            return values
        nodes = np.linspace(0, 1, 32)
        shares = sum(interface_shares(nodes**2, float(alpha), eta if front else 1.0 / eta))
        return values / column(np.interp(np.sqrt(np.abs(pairs.wo.z)), nodes, np.maximum(shares, 1e-6)))

    return Form("a rough interface", NUMBERS, f, describe, transmits=True)

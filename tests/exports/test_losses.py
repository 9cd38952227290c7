"""What is told to be lost is where a difference was made."""

import numpy as np

from gonio.data.subject import load_material
from gonio.exports.forms import appearance_of
from gonio.exports.losses import losses
from gonio.exports.pairs import polar_pairs
from gonio.exports.renderers.lobes import ggx_facets


def test_the_sentence_names_the_directions_of_the_difference():
    sought, pairs = appearance_of(load_material("lambert(rho=0.3)")), polar_pairs(8, 32, 12)
    body = np.full((pairs.flux.size, 1), 0.1)
    lobe = ggx_facets(pairs, 0.1, 0.1)
    cosine = sum(a * b for a, b in zip(pairs.wi, pairs.wo, strict=True))
    back = np.where(cosine[:, None] > np.cos(0.3), 0.2, 0.0)
    (sentence,) = losses(sought, {}, pairs, body + back, -back)
    assert "retro-reflection" in sentence and "too dark" in sentence
    (sentence,) = losses(sought, {}, pairs, body + lobe, 0.5 * lobe)
    assert "in highlights, too bright by" in sentence
    assert losses(sought, {}, pairs, body, 0 * body) == ()


def test_grain_and_diffraction_are_named():
    pairs = polar_pairs(4, 16, 8, turns=2)
    sought, f = appearance_of(load_material("ggx(alpha_x=0.1, alpha_y=0.4)")), ggx_facets(pairs, 0.1, 0.4)
    same, grained = {"alpha_x": np.asarray(0.2), "alpha_y": np.asarray(0.2)}, {"anisotropy": np.asarray(0.5)}
    assert any("grain is lost" in s for s in losses(sought, same, pairs, f, f))
    assert not any("grain is lost" in s for s in losses(sought, grained, pairs, f, f))
    assert any(
        "orders of diffraction" in s for s in losses(appearance_of(load_material("compact_disc")), {}, pairs, f, f)
    )

"""Textbook forms of what transmits, light and detector on any sides."""

from collections.abc import Callable
from typing import Any

from gonio.stability.textbook.frame import Options, Pair, Params, TextbookForm, Vector, angle, mp, mpf, unit
from gonio.stability.textbook.fresnel import exact
from gonio.stability.textbook.microfacet import (
    beckmann_d,
    beckmann_g1_walter2007,
    beckmann_lambda,
    ggx_d,
    ggx_lambda,
    smith_g,
)


class SheetForm(TextbookForm):
    """A formula for light and detector on any sides; 0 where a direction is on the horizon."""

    def __call__(self, params: Params, options: Options, wi: Vector, wo: Vector, **inside: Any) -> mpf:
        if wi[2] == 0 or wo[2] == 0:
            return mpf(0)
        with mp.workdps(mp.dps + 20):
            value = self.formula(params, options, Pair(wi, wo), **inside)
        return +value


def _opposite(pair: Pair) -> bool:
    return pair.mu_i * pair.mu_o < 0


def _minus(v: Vector) -> Vector:
    return -v[0], -v[1], -v[2]


def _upright(v: Vector) -> Vector:
    return v[0], v[1], abs(v[2])


def _dot(a: Vector, b: Vector) -> mpf:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@SheetForm
def lambert_transmission(params: Params, options: Options, pair: Pair) -> mpf:
    """τ/π to the other side."""
    return params["tau"] / mp.pi if _opposite(pair) else mpf(0)


@SheetForm
def thin_sheet(params: Params, options: Options, pair: Pair) -> mpf:
    """ρ/π on either side, τ/π through."""
    if _opposite(pair):
        return params["tau"] / mp.pi
    return (params["rho"] if pair.mu_i > 0 else params.get("rho_behind", params["rho"])) / mp.pi


@SheetForm
def cosine_power_transmission(params: Params, options: Options, pair: Pair) -> mpf:
    """τ (n + 2)/(2π) cosⁿα to the other side, α the angle from straight through."""
    cosine = mp.cos(angle(_minus(pair.wi), pair.wo))
    if not _opposite(pair) or cosine <= 0:
        return mpf(0)
    return params["tau"] * (params["n"] + 2) / (2 * mp.pi) * cosine ** params["n"]


@SheetForm
def transmitted(params: Params, options: Options, pair: Pair, base: Callable[[Vector, Vector], mpf]) -> mpf:
    """What the base reflects into the mirror image, at the sheet, of the direction of the detector."""
    return base(_upright(pair.wi), _upright(pair.wo)) if _opposite(pair) else mpf(0)


@SheetForm
def rough_dielectric(params: Params, options: Options, pair: Pair) -> mpf:
    """F D G/(4 |i·n||o·n|), and |i·m||o·m| n_o² (1 − F) D G/(|i·n||o·n| (n_i i·m + n_o o·m)²) [Walter 2007].

    G of Smith's Λ, correlated by 1/(1 + Λi + Λo), and by B(1 + Λi, 1 + Λo) where light passes.
    """
    eta = params["eta"]
    n_i, n_o = (mpf(1) if w[2] > 0 else eta for w in (pair.wi, pair.wo))
    if not _opposite(pair):
        turned = Pair(_upright(pair.wi), _upright(pair.wo))
        index = eta if pair.mu_i > 0 else 1 / eta
        reflected = mpf(1) if turned.cos_d**2 < 1 - index**2 else exact(turned.cos_d, index)
        d, g = _facets(params, options, turned.half, turned.wi, turned.wo, False)
        return reflected * d * g / (4 * turned.mu_i * turned.mu_o)
    sums = tuple(n_i * a + n_o * b for a, b in zip(pair.wi, pair.wo, strict=True))
    if not any(sums) or eta == 1:
        return mpf(0)
    h = unit(sums)
    h = h if eta < 1 else _minus(h)
    i_m, o_m = _dot(pair.wi, h), _dot(pair.wo, h)
    if h[2] <= 0 or i_m * pair.mu_i <= 0 or o_m * pair.mu_o <= 0:
        return mpf(0)
    d, g = _facets(params, options, h, _upright(pair.wi), _upright(pair.wo), True)
    passed = 1 - exact(abs(i_m), n_o / n_i)
    level = abs(i_m * o_m) * n_o**2 * passed / (n_i * i_m + n_o * o_m) ** 2
    return level * d * g / abs(pair.mu_i * pair.mu_o)


def _facets(params: Params, options: Options, h: Vector, wi: Vector, wo: Vector, through: bool) -> tuple[mpf, mpf]:
    """(D, G₂)."""
    gaussian, smith = options.get("distribution") == "beckmann", options.get("smith", "correlated")
    d = (beckmann_d if gaussian else ggx_d)(params, h)
    if smith == "walter":
        return d, beckmann_g1_walter2007(params, wi) * beckmann_g1_walter2007(params, wo)
    l_i, l_o = ((beckmann_lambda if gaussian else ggx_lambda)(params, w) for w in (wi, wo))
    return d, mp.beta(1 + l_i, 1 + l_o) if through and smith == "correlated" else smith_g(smith, l_i, l_o)

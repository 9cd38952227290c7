"""Problems with exact answers, one tagged list a kind: the atlas, the tests and the benchmarks take theirs from it.

After quadax's list of test integrals: a problem is data, an answer is a number that no code of gonio produced.
"""

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import TypeVar

import numpy as np

from gonio.models.expression.builder import frame, number_label
from gonio.models.expression.parser import numbers, parse, with_defaults

ANY = 0.777
"""A true number that nothing determines, such as the width of a lobe without strength: any answer is right."""

MERL, GRID, COARSE, COARSEST = "60 × 30 × 36, MERL's spacing", "5° grid", "10° grid", "15° grid"
SMALL, NARROW, PLANE, BRUSHED = "5° grid to 35°", "5° grid to 20°", "in plane", "turned sample"
"""Where readings are taken; `tests/support/scans.py` has the layouts."""


@dataclasses.dataclass(frozen=True)
class AlbedoProblem:
    """A model with a directional albedo in closed form, `exact(μ)` of μ = cos θi; `average` is ∫ E 2μ dμ."""

    name: str
    expression: str
    exact: Callable[[np.ndarray], np.ndarray]
    average: float | None = None
    tags: frozenset[str] = frozenset()


@dataclasses.dataclass(frozen=True)
class RecoveryProblem:
    """Readings of a known surface, and the model that shall find it again.

    Where several sums of lobes are one surface, each of `truths` is right; with none, no number of the model is.
    `noise` is a share of f, or, below 0, an amount in 1/sr; `known`: the table stores it. `spikes`: share of readings
    that are 100 times too large; `missing`: share of cells without one; `theta_max`, degrees; `samples`: no more
    readings than that. `left_open`: numbers that the readings do not determine.
    """

    name: str
    truths: tuple[str, ...]
    model: str
    tags: frozenset[str] = frozenset()
    scan: str = GRID
    noise: float = 0.01
    known: bool = True
    spikes: float = 0.0
    missing: float = 0.0
    theta_max: float = 90.0
    samples: int | None = None
    surface: str = ""
    robust: bool = False
    left_open: frozenset[str] = frozenset()

    @property
    def measured(self) -> str:
        """The expression that makes the readings."""
        return self.surface or self.truths[0]


Problem = TypeVar("Problem", AlbedoProblem, RecoveryProblem)


def tagged(problems: Iterable[Problem], *tags: str) -> list[Problem]:
    """The problems that bear all of these tags."""
    return [p for p in problems if p.tags.issuperset(tags)]


def true_numbers(truth: str, channels: tuple[str, ...] = ("grey",)) -> dict[str, float]:
    """The numbers of an expression by the labels that a fit gives them: 'ggx.alpha', or 'lambert.rho[R]'."""
    terms = with_defaults(parse(truth))
    frames = tuple(frame(t) for t in terms)
    answers = {}
    for index, term in enumerate(terms):
        for n in numbers(term):
            values, name = np.ravel(np.asarray(n.value.number, float)), number_label(frames, index, n.path)
            labels = [name] if values.size == 1 else [f"{name}[{c}]" for c in channels]
            answers |= dict(zip(labels, map(float, values), strict=True))
    return answers


def _fujii(mu: np.ndarray) -> np.ndarray:
    r = 0.7
    s = np.sqrt(1 - mu**2)
    g = s * (np.arccos(mu) - s * mu) + 2 / 3 * (s / mu * (1 - s**3) - s)
    return (1 + r * g / np.pi) / (1 + (0.5 - 2 / (3 * np.pi)) * r)


def _once(mu: np.ndarray) -> np.ndarray:
    return 1 - mu * np.log1p(1 / mu)


def _constant(value: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda mu: np.full(np.shape(mu), value)


_WHITE = frozenset({"reflects all"})
ALBEDOS = (
    AlbedoProblem("Lambert: ρ", "lambert(rho=0.7)", _constant(0.7), 0.7),
    AlbedoProblem("Minnaert: ρ μ^(k−1)", "minnaert(rho=0.5, k=1.7)", lambda mu: 0.5 * mu**0.7, 1 / 2.7),
    AlbedoProblem("Lommel–Seeliger: (w/2)(1 − μ ln(1 + 1/μ))", "lommel_seeliger(w=0.8)", lambda mu: 0.4 * _once(mu),
                  0.4 * 4 / 3 * (1 - math.log(2))),
    AlbedoProblem("Chandrasekhar, w = 1: 1", "chandrasekhar(w=1)", _constant(1.0), 1.0, _WHITE),
    AlbedoProblem("EON, ρ = 1: 1", "eon(rho=1, r=1)", _constant(1.0), 1.0, _WHITE),
    AlbedoProblem("white standard: 1", "white_standard()", _constant(1.0), 1.0, _WHITE),
    AlbedoProblem("Fujii: A + (rA/π)G", "fujii(rho=1, r=0.7)", _fujii,
                  (1 + (2 / 3 - 28 / (15 * math.pi)) * 0.7) / (1 + (0.5 - 2 / (3 * math.pi)) * 0.7)),
    AlbedoProblem("GGX α = 1, correlated: 1 − μ ln(1 + 1/μ)", "ggx(alpha=1)", _once, 4 / 3 * (1 - math.log(2))),
    AlbedoProblem("GGX α = 1, separable: 2(1 − ln 2)/(1 + μ)", "ggx(alpha=1, smith=separable)",
                  lambda mu: 2 * (1 - math.log(2)) / (1 + mu), 4 * (1 - math.log(2)) ** 2),
    AlbedoProblem("GGX Kulla–Conty, F = 1: 1", "ggx(alpha=0.3, energy=kulla_conty)", _constant(1.0), 1.0,
                  _WHITE | {"tabled"}),
    AlbedoProblem("Beckmann Kulla–Conty, F = 1: 1", "beckmann(alpha=0.3, energy=kulla_conty)", _constant(1.0), 1.0,
                  _WHITE | {"tabled"}),
    AlbedoProblem("Kelemen, ρ = 1: 1", "kelemen(rho=1, alpha=0.3, f0=0.04)", _constant(1.0), 1.0, _WHITE | {"tabled"}),
)  # fmt: skip
"""Closed forms of directional albedos: Heitz 2014 and Chandrasekhar 1960; those of EON by Portsmouth et al. 2024."""

_PLASTIC, _MODEL = "lambert(rho=0.2) + 0.5*ggx(alpha={})", "lambert + ggx"
_USUAL = (_PLASTIC.format(0.3),)
_HIDDEN = ("lambert(rho=0.2) + 0.5 * ggx(alpha=0.3, f0=0.04)",)
_TWINS = ("0.3 * ggx(alpha=0.2) + 0.3 * ggx(alpha=0.2)", f"0.6*ggx(alpha=.2) + 0*ggx(alpha={ANY})",
          f"0*ggx(alpha={ANY}) + 0.6*ggx(alpha=.2)")  # fmt: skip
_EXTRA = (f"lambert(rho=0.2) + 0.5*ggx(alpha=.3) + 0*ggx(alpha={ANY})",
          f"lambert(rho=0.2) + 0*ggx(alpha={ANY}) + 0.5*ggx(alpha=.3)",
          "lambert(rho=0.2)+0.2*ggx(alpha=.3)+0.3*ggx(alpha=.3)")  # fmt: skip
_OPEN, _ATLAS, _QUICK, _TEST = (frozenset({t}) for t in ("left open", "atlas", "quick atlas", "test"))


def _extremes() -> list[RecoveryProblem]:
    """Widths and Fresnel reflectances at the ends of their domains."""
    of = RecoveryProblem
    widths = [
        of(f"α = {a:g}, {where}", (_PLASTIC.format(a),), _MODEL, frozenset(tags), scan)
        for a in (0.002, 0.005, 0.02, 0.1, 0.5, 1.0)
        for where, scan, tags in (("MERL's spacing", MERL, _TEST if a == 0.002 else ()),
                                  ("5° grid", GRID, _TEST if a == 1.0 else ()))
    ]  # fmt: skip
    schlick = [
        of(f"F₀ = {f:g}", (f"lambert(rho=0.2) + 1*ggx(alpha=0.2, f0={f})",), "lambert + 1*ggx(f0=?)",
           _TEST if f == 0 else frozenset())
        for f in (0.0, 0.001, 0.5, 1.0)
    ]  # fmt: skip
    return widths + schlick


def _hard() -> list[RecoveryProblem]:
    of = RecoveryProblem
    beckmann = "lambert(rho=0.2)+0.5*beckmann(alpha=.3)"
    hard = frozenset({"hard"})
    problems = [
        *_extremes(),
        of("1 % outliers × 100, σ known", _USUAL, _MODEL, spikes=0.01),
        of("1 % outliers × 100", _USUAL, _MODEL, spikes=0.01, known=False),
        of("1 % outliers × 100, σ known, robust", _USUAL, _MODEL, spikes=0.01, robust=True),
        of("1 % outliers × 100, robust", _USUAL, _MODEL, _TEST, spikes=0.01, known=False, robust=True),
        of("20 % outliers × 100, robust", _USUAL, _MODEL, _TEST, spikes=0.2, known=False, robust=True),
        of("60 % of cells missing", _USUAL, _MODEL, _TEST, missing=0.6),
        of("F₀ free, angles to 45°", _HIDDEN, "lambert + ggx(f0=?)", theta_max=46.0),
        of("F₀ free, angles to 25°", _HIDDEN, "lambert + ggx(f0=?)", _TEST, theta_max=26.0),
        of("two equal lobes", _TWINS, "ggx + ggx"),
        of("two equal lobes, no noise", _TWINS, "ggx + ggx", _TEST, noise=0.0),
        of("two nearly equal lobes", ("0.3*ggx(alpha=.2)+0.3*ggx(alpha=.22)",), "ggx + ggx"),
        of("a lobe too many", _EXTRA, "lambert + ggx + ggx"),
        of("a lobe too many, σ unknown", _EXTRA, "lambert + ggx + ggx", known=False),
        of("outside the family: Beckmann", (), _MODEL, surface=beckmann),
        of("outside the family: Beckmann, σ unknown", (), _MODEL, _TEST, surface=beckmann, known=False),
        of("outside the family: cloth", (), _MODEL, surface="lambert(rho=0.2)+0.5*charlie(alpha=.4)", known=False),
        of("outside the family: two lobes", (), _MODEL, known=False,
           surface="lambert(rho=0.2)+0.3*ggx(alpha=.1)+0.3*ggx(alpha=.4)"),
        of("all zero", ("lambert(rho=0) + 0*ggx(alpha=.3)",), _MODEL, _TEST, noise=0.0),
        of("all zero, noise of 0.001", ("lambert(rho=0) + 0*ggx(alpha=.3)",), _MODEL, noise=-0.001),
        of("constant", ("lambert(rho=0.5) + 0*ggx(alpha=.3)",), _MODEL, _TEST, noise=0.0),
        of("constant, noise", ("lambert(rho=0.5) + 0*ggx(alpha=.3)",), _MODEL),
        of("12 samples", _USUAL, _MODEL, _TEST, samples=12),
        of("12 samples, σ unknown", _USUAL, _MODEL, samples=12, known=False),
        of("3 samples", _USUAL, _MODEL, _TEST, samples=3),
        of("2 samples", _USUAL, _MODEL, _TEST, samples=2),
        of("30 % noise", _USUAL, _MODEL, noise=0.3),
        of("30 % noise, σ unknown", _USUAL, _MODEL, noise=0.3, known=False),
        of("no noise", _USUAL, _MODEL, noise=0.0),
    ]  # fmt: skip
    return [dataclasses.replace(p, tags=p.tags | hard) for p in problems]


def _scattered() -> list[RecoveryProblem]:
    of, quick = RecoveryProblem, _ATLAS | _QUICK
    return [
        of("angles up to 45°", _HIDDEN, "lambert + ggx(f0=?)", _ATLAS, theta_max=45.0),
        of("angles up to 85°", _HIDDEN, "lambert + ggx(f0=?)", _ATLAS, theta_max=85.0),
        of("two equal lobes", _TWINS, "ggx + ggx", quick, theta_max=85.0),
        of("two lobes", ("0.3 * ggx(alpha=0.08) + 0.3 * ggx(alpha=0.5)",), "ggx + ggx", quick, theta_max=85.0),
        of("width on its bound", (_PLASTIC.format(1),), _MODEL, quick, theta_max=85.0),
        of("1 % spikes of 100 times", _USUAL, _MODEL, _ATLAS, theta_max=85.0, spikes=0.01),
        of("narrow lobe", (_PLASTIC.format(0.01),), _MODEL, quick, theta_max=85.0),
        of("index near 1", ("lambert(rho=0.2) + 1 * ggx(alpha=0.3, eta=1.01)",), "lambert + 1 * ggx(eta=?)", _ATLAS,
           theta_max=85.0),
        of("black", ("lambert(rho=0) + 0 * ggx(alpha=0.3)",), _MODEL, quick, theta_max=85.0),
    ]  # fmt: skip


def _covered() -> list[RecoveryProblem]:
    of, tag = RecoveryProblem, frozenset({"coverage"})
    return [
        of("matte", ("eon(rho=0.6, r=0.5)",), "eon", tag, COARSE),
        of("plastic", ("lambert(rho=[.1,.2,.4]) + [.5,.5,.5]*ggx(alpha=.2, f0=.04)",), "lambert + ggx(f0=0.04)", tag,
           COARSE),
        of("metal", ("[.9,.6,.3]*ggx(alpha=.15)",), "ggx", tag, COARSE),
        of("varnish", ("lambert(rho=.3) + 0.8*beckmann(alpha=.3, f0=.1)",), "lambert + beckmann(f0=?)", tag, COARSE),
        of("brushed", ("lambert(rho=.1) + 0.7*ggx(alpha_x=.12, alpha_y=.35)",), "lambert + ggx(alpha_x=?, alpha_y=?)",
           tag, BRUSHED),
    ]  # fmt: skip


def _inside() -> list[RecoveryProblem]:
    of, tag = RecoveryProblem, frozenset({"exact"})
    return [
        of("coat over a sum", ("coat(base=lambert(rho=0.6) + 0.3 * ggx(alpha=0.3), alpha=0.1, eta=1.5)",),
           "coat(base=lambert + ggx, eta=1.5)", tag, COARSEST, noise=0.0),
        of("hapke", ("hapke(w=0.6, b=0.3, c=0.4, b0=0.8, h=0.06)",), "hapke", tag, COARSEST, noise=0.0),
        of("he_torrance", ("0.5 * he_torrance(sigma=0.2, tau=3, wavelength=0.55, form=westin)",),
           "he_torrance(wavelength=0.55, form=westin)", tag, COARSEST, noise=0.0),
    ]  # fmt: skip


def _left_open() -> list[RecoveryProblem]:
    of = RecoveryProblem
    return [
        of("F₀ and scale, ≤ 35°", ("lambert(rho=.2) + 0.6*ggx(alpha=.3, f0=.1)",), "lambert + ggx(f0=?)", _OPEN, SMALL,
           left_open=frozenset({"ggx.f0", "ggx.scale"})),
        of("η and k, ≤ 20°", ("1*ggx(alpha=.3, eta=1.2, k=3)",), "1 * ggx(eta=?, k=?)", _OPEN, NARROW,
           left_open=frozenset({"ggx.eta"})),
        of("twin lobes", ("lambert(rho=.1) + .3*ggx(alpha=.2) + .3*ggx(alpha=.2)",),
           "lambert + ggx(alpha=.2) + ggx(alpha=.2)", _OPEN, COARSE, left_open=frozenset({"ggx1.scale", "ggx2.scale"})),
        of("width of nothing", ("lambert(rho=.5)",), "lambert + 0 * ggx(alpha=?)", _OPEN, COARSE,
           left_open=frozenset({"ggx.alpha"})),
        of("two diffusers", ("lambert(rho=.2) + lambert(rho=.3)",), "lambert + lambert", _OPEN, COARSE,
           left_open=frozenset({"lambert1.rho", "lambert2.rho"})),
        of("width across the plane", ("0.6*ggx(alpha_x=.2, alpha_y=.3)",), "ggx(alpha_x=?, alpha_y=?)", _OPEN, PLANE,
           left_open=frozenset({"ggx.alpha_y", "ggx.scale"})),
    ]  # fmt: skip


RECOVERIES = (*_hard(), *_scattered(), *_covered(), *_inside(), *_left_open())
"""Fits that are hard, by name and tag; those tagged "atlas" are read at scattered directions."""

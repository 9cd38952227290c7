"""Light below the surface in the atlas: R and its slopes against textbook forms, totals against integrals, fits."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from mpmath import mpf

from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.profile import Profile
from gonio.fitting.subsurface.profile_fit import fit_profile
from gonio.models.subsurface.base import AbstractBSSRDF
from gonio.models.subsurface.catalog import BSSRDFS
from gonio.stability.outcome import RIGHT, SAYS_SO, SILENT, Cell
from gonio.stability.precision import PRECISIONS
from gonio.stability.textbook.frame import mp
from gonio.stability.textbook.subsurface import PROFILES, Medium

DIGITS = 30
ALBEDOS, INDICES = (1e-6, 0.5, 0.9, 0.999999, 1.0), (1.0, 1.3, 3.0)
"""Towards no scattering and no absorption, at a start of both; a matched index, and the largest."""
DISTANCES = (1e-6, 0.01, 1.0, 10.0, 100.0)
"""Mean free paths."""
ULPS, CONDITION = 64, 16
SLOPE_ULPS = 4096
"""Of slopes, by differences of the textbook form at 30 digits."""
INTEGRAL = 1e-10
FITTED = {"wide": np.geomspace(0.1, 30, 40), "near": np.linspace(0.01, 0.02, 20)}
"""Offsets, mean free paths, that determine both coefficients, and that hardly do."""
NOISE = 0.01


def settings(name: str) -> list[str]:
    """Expressions of one model."""
    changes = [(a, 1.3) for a in ALBEDOS] + [(0.9, n) for n in INDICES if n != 1.3]
    return [f"{name}(albedo={a:g}, mfp=1, eta={n:g})" if a < 0.99 else f"{name}(albedo={a!r}, mfp=1, eta={n:g})"
            for a, n in changes]  # fmt: skip


def cells(method: str, name: str, setting: str, precision: str) -> list[Cell]:
    """The cells of one setting: a column for each distance, or for each integral."""
    made = _model(name, setting, PRECISIONS[precision])
    with mp.workdps(DIGITS):
        if method == "integral":
            return _integrals(name, setting, precision, *made)
        judge = _value if method == "value" else _slopes
        return [judge(name, setting, precision, *made, PRECISIONS[precision](r)) for r in DISTANCES]


def _model(name: str, setting: str, dtype: Any) -> tuple[AbstractBSSRDF, Medium]:
    """The model in a precision, and the medium that its rounded numbers are."""
    pairs = (p.split("=") for p in setting.split("(")[1].rstrip(")").split(", "))
    values = {key: dtype(float(value)) for key, value in pairs}
    medium = Medium(*(mpf(float(values[key])) for key in Medium._fields))
    return BSSRDFS[name](**{key: jnp.asarray(v) for key, v in values.items()}), medium


def _spread(name: str, medium: Medium, r: mpf, eps: float) -> mpf:
    """What a rounding of each input makes of R."""
    form, here = PROFILES[name], PROFILES[name](medium, r)
    changed = [abs(form(medium, r * (1 + eps)) - here)]
    for key, value in medium._asdict().items():
        # 1 − α' has the digits that α' leaves it; inside of the domain.
        to = value * (1 - eps) if key == "albedo" else value * (1 + eps)
        changed.append(abs(form(medium._replace(**{key: to}), r) - here))
    return sum(changed, mpf(0))


def _value(name: str, setting: str, precision: str, model: AbstractBSSRDF, medium: Medium, r: Any) -> Cell:
    value, exact = float(model.profile(jnp.asarray(r))), PROFILES[name](medium, mpf(float(r)))
    eps, tiny = float(np.finfo(r.dtype).eps), float(np.finfo(r.dtype).tiny)
    allowed = ULPS * eps * abs(exact) + tiny * 1e3
    error = abs(mpf(value) - exact) if np.isfinite(value) else mpf("inf")
    if error > allowed:
        allowed += CONDITION * _spread(name, medium, mpf(float(r)), eps)
    detail = f"R {value:.9g} beside {mp.nstr(exact, 9)} 1/mm² at {float(r):g} mm"
    return _cell(("value", name, setting, f"r = {float(r):g}", precision), error / exact, allowed / exact, detail)


def _slopes(name: str, setting: str, precision: str, model: AbstractBSSRDF, medium: Medium, r: Any) -> Cell:
    """All slopes are finite; those by the distance and, where it is no end of its domain, the albedo are right."""
    by_model, by_r = jax.grad(lambda args: args[0].profile(args[1]))((model, jnp.asarray(r)))
    form, distance = PROFILES[name], mpf(float(r))
    slopes = {"distance": (float(by_r), mp.diff(lambda x: form(medium, x), distance, h=distance * mpf(10) ** -9))}
    if 1e-5 < medium.albedo < 0.9999:
        slope = mp.diff(lambda a: form(medium._replace(albedo=a), distance), medium.albedo, h=mpf(10) ** -9)
        slopes["albedo"] = float(by_model.albedo), slope
    finite = all(np.isfinite(np.asarray(g)).all() for g in jax.tree.leaves((by_model, by_r)))
    eps, here = float(np.finfo(r.dtype).eps), abs(form(medium, distance))
    worst, allowed, detail = mpf(0), mpf(SLOPE_ULPS) * eps, "finite by all numbers"
    for by, (value, exact) in slopes.items():
        # Relative to the slope, or to R over the number where the slope vanishes.
        size = (
            max(abs(exact), here / (distance if by == "distance" else medium.albedo))
            + float(np.finfo(r.dtype).tiny) * 1e3
        )
        error = abs(mpf(value) - exact) / size if np.isfinite(value) else mpf("inf")
        if error >= worst:
            worst, detail = error, f"slope by {by} {value:.9g} beside {mp.nstr(exact, 9)} at {float(r):g} mm"
    worst = worst if finite else mpf("inf")
    # e^(−σd) and the like: its exponent is rounded too.
    allowed *= 1 + abs(mp.log(max(here, mpf(10) ** -300)))
    return _cell(("gradient", name, setting, f"r = {float(r):g}", precision), worst, allowed, detail)


def _integrals(name: str, setting: str, precision: str, model: AbstractBSSRDF, medium: Medium) -> list[Cell]:
    """∫ R 2πr dr up to a distance, and over all, in u = ln r; the rest beyond by the form's own decay."""

    def within(low: float, high: float) -> mpf:
        edges = [mpf(low) + (mpf(high) - low) * k / 16 for k in range(17)]
        return mp.quad(lambda u: PROFILES[name](medium, mp.exp(u)) * 2 * mp.pi * mp.exp(2 * u), edges, maxdegree=6)

    inner, made = within(-40.0, 0.0), []
    shares = {"within 1 mm": (float(model.cumulative(jnp.ones(()))), inner)}
    shares["total"] = float(model.total()), inner + within(0.0, 40.0)
    for column, (value, exact) in shares.items():
        error = abs(mpf(value) - exact)
        detail = f"{column} {value:.12g} beside {mp.nstr(exact, 12)}"
        made.append(_cell(("integral", name, setting, column, precision), error, mpf(INTEGRAL), detail))
    return made


def fit_cells(name: str) -> list[Cell]:
    """A fit to a noisy profile of the model: what made it lies within five uncertainties, or the fit leaves it open."""
    made = []
    truth = {"sigma_a": 0.05, "sigma_s": 1.0}
    model = BSSRDFS[name](**{key: jnp.asarray(v) for key, v in truth.items()})
    for column, offsets in FITTED.items():
        clean = np.asarray(jax.vmap(model.profile)(jnp.asarray(offsets))).reshape(-1, 1)
        u = NOISE * clean
        value = clean + u * np.random.default_rng(0).standard_normal(clean.shape)
        profile = Profile(offsets, value, u, np.full(clean.shape, np.uint8(Flag.VALID)), Channels.grey())
        fit = fit_profile(profile, f"{name}(eta=1)")
        numbers = {p.label.split(".")[-1].split("[")[0]: p for p in fit.parameters if p.status != "fixed"}
        off = max(
            abs(p.value - truth[k]) / max(p.standard_uncertainty, 1e-300) for k, p in numbers.items() if k in truth
        )
        loose = max(p.standard_uncertainty / truth[k] for k, p in numbers.items() if k in truth)
        undecided = bool(fit.undetermined) or not fit.converged or not np.isfinite(off)
        verdict = RIGHT if off <= 5 and not undecided else SAYS_SO if undecided else SILENT
        words = "; ".join(fit.undetermined) or f"determined to {loose:.2g}"
        detail = f"σa, σs' within {off:.2g} of their uncertainties; {words}"
        made.append(Cell("fit", name, f"{name}(eta=1)", f"{column}, 1 % noise", "float64", verdict, off, 5.0, detail))
    return made


def _cell(regime: tuple[str, str, str, str, str], error: mpf, allowed: mpf, detail: str) -> Cell:
    """`regime`: method, model, setting, column and precision."""
    method, name, setting, column, precision = regime
    verdict = RIGHT if error <= allowed else SAYS_SO if "nan beside" in detail else SILENT
    return Cell(method, name, setting, column, precision, verdict, float(error), float(allowed), detail)

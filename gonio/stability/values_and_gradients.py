"""Values and gradients against textbook forms at forty digits: right to rounding and the conditioning of the inputs."""

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np

from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction
from gonio.models.parameters import parameters_of
from gonio.stability.directions import COLUMNS, pairs
from gonio.stability.outcome import RIGHT, SAYS_SO, SILENT, Cell, worst
from gonio.stability.precision import PRECISIONS, cast
from gonio.stability.reference import DIGITS, Reference

ULPS = 32
SLOPE_ULPS, SLOPE_CONDITION = 128, 8  # slopes are sums of more terms, each as ill-conditioned as f
CONDITION = 16
NEGLIGIBLE = 1e-6
TABLED_SLOPE = 1e-6  # what the wide steps of such a reference are good for
SLOPE_ACCURACY = 1e3
"""How much less a claim of a table's accuracy says of its slope."""


@eqx.filter_jit
def _f(brdf, wi, wo):
    return jax.vmap(brdf.f)(wi, wo)


@eqx.filter_jit
def _slopes(brdf, wi, wo):
    # ∂f/∂(every parameter, every component): a tree like the model, and six components.
    return jax.vmap(jax.grad(lambda parts: parts[0].f(parts[1], parts[2])), in_axes=((None, 0, 0),))((brdf, wi, wo))


def _directions(w: np.ndarray, dtype) -> Direction:
    return Direction(*(jnp.asarray(c, dtype) for c in w.T))


def _judged(found: float, reference, spread: Callable, floor: float, dtype) -> tuple[str, float, float]:
    """(verdict, error, allowed), relative to the reference where that is not 0.

    `spread()`, what the rounding of the inputs makes of the reference, is asked where rounding alone is not enough.
    """
    info = np.finfo(dtype)
    if not np.isfinite(found):
        return (RIGHT if abs(reference) > float(info.max) else SAYS_SO), float("inf"), 0.0
    allowed = ULPS * float(info.eps) * abs(reference) + floor
    error = abs(mp.mpf(float(found)) - reference)
    if error > allowed:
        allowed += CONDITION * spread()
    size = abs(reference) if reference else mp.mpf(1)
    return (RIGHT if error <= allowed else SILENT), float(error / size), float(allowed / size)


def _value_spread(reference: Reference, wi, wo, exact):
    return max(abs(reference.value(*moved) - exact) for moved in reference.perturbed(wi, wo))


def _slope_spread(reference: Reference, parameter: str, wi, wo, exact):
    if reference.infinite(parameter, wi, wo):
        return mp.inf
    near = [reference.slope(parameter, *moved) for moved in reference.perturbed(wi, wo)]
    return SLOPE_CONDITION * max(abs((exact if s is None else s) - exact) for s in near)


def value_cells(name: str, expression: str, precision: str, columns: tuple[str, ...] | None = None) -> list[Cell]:
    """One cell for each incidence: the worst of its pairs."""
    dtype = PRECISIONS[precision]
    brdf, reference = cast(build(expression), dtype), Reference(expression, dtype)
    cells = []
    for column in columns or reference.columns(tuple(COLUMNS)):
        wi, wo = (w.astype(dtype) for w in pairs(column))
        found = np.asarray(_f(brdf, _directions(wi, dtype), _directions(wo, dtype)))
        judged = []
        # What no product of single numbers can carry, and what is nothing beside the largest value there, is 0.
        info = np.finfo(dtype)
        floor = float(info.tiny) * 1e11 + float(info.eps) ** 3 * float(np.max(np.abs(np.nan_to_num(found))))
        with mp.workdps(DIGITS):
            for i, o, f in zip(wi.astype(float), wo.astype(float), found, strict=True):
                exact = reference.value(i, o)
                spread = functools.partial(_value_spread, reference, i, o, exact)
                allowed = floor + brdf.accuracy * (1 + float(abs(exact)))
                judged.append((*_judged(f, exact, spread, allowed, dtype), i, o, f, exact))
        cells.append(_cell("value", name, expression, column, precision, judged))
    return cells


def gradient_cells(name: str, expression: str, precision: str, columns: tuple[str, ...] | None = None) -> list[Cell]:
    """One cell for each incidence: ∂f/∂parameter against differences, and all of the gradient finite."""
    dtype = PRECISIONS[precision]
    brdf, reference = cast(build(expression), dtype), Reference(expression, dtype)
    cells = []
    for column in columns or reference.columns(tuple(COLUMNS)):
        wi, wo = (w[::2].astype(dtype) for w in pairs(column))
        slopes = _slopes(brdf, _directions(wi, dtype), _directions(wo, dtype))
        parameters, directions = slopes[0], np.stack([np.asarray(c) for d in slopes[1:] for c in d], -1)
        judged = []
        least = _least(parameters, dtype)
        with mp.workdps(DIGITS):
            for k, (i, o) in enumerate(zip(wi.astype(float), wo.astype(float), strict=True)):
                scale = abs(reference.value(i, o))
                # Near the horizon f changes within its cosine: that slope may be beyond the largest number.
                steep = scale / min(i[2], o[2]) > float(np.finfo(dtype).max) * 1e-6
                lost = not np.isfinite(directions[k]).all() and not steep
                found = (SAYS_SO, float("inf"), 0.0) if lost else (RIGHT, 0.0, 0.0)
                judged.append((*found, i, o, float("nan") if lost else 0.0, mp.mpf(0)))
                if not mp.isfinite(scale) or scale > float(np.finfo(dtype).max):  # f is no number, and has no slope
                    continue
                for parameter, at in reference.params.items():
                    found = float(np.asarray(getattr(parameters, parameter))[k])
                    exact = reference.slope(parameter, i, o)
                    if exact is None:  # any number stands for an infinite slope, a great one or none at all
                        judged.append((RIGHT if np.isfinite(found) else SAYS_SO, 0.0, 0.0, i, o, found, mp.inf))
                        continue
                    spread = functools.partial(_slope_spread, reference, parameter, i, o, exact)
                    # What a whole step of the parameter would change f by is the scale of its rounding.
                    unit = scale / max(abs(at), mp.mpf("1e-3"))
                    floor = SLOPE_ULPS * float(np.finfo(dtype).eps) * unit + float(np.finfo(dtype).tiny) * 1e6
                    floor += TABLED_SLOPE * float(abs(exact)) * reference.tabled
                    floor += brdf.accuracy * (1 + float(scale)) * SLOPE_ACCURACY + least[parameter]
                    judged.append((*_judged(found, exact, spread, floor, dtype), i, o, found, exact))
        cells.append(_cell("gradient", name, expression, column, precision, judged))
    return cells


def _least(parameters, dtype) -> dict[str, float]:
    # Slopes that a fit cannot feel: the rounding of a millionth of the largest slope at the same incidence.
    found = {}
    for name in parameters_of(type(parameters)):
        slopes = getattr(parameters, name)
        largest = 0.0 if slopes is None else float(np.max(np.abs(np.nan_to_num(np.asarray(slopes)))))
        found[name] = NEGLIGIBLE * float(np.finfo(dtype).eps) * largest
    return found


def _cell(method, name, expression, column, precision, judged) -> Cell:
    verdict = worst([j[0] for j in judged])
    at = max((j for j in judged if j[0] == verdict), key=lambda j: j[1] / max(j[2], 1e-300))
    wi, wo, found, exact = at[3:]
    what = "f" if method == "value" else "slope"
    detail = f"{what} {float(found):.9g} beside {mp.nstr(exact, 9)} at wi {_text(wi)}, wo {_text(wo)}"
    return Cell(method, name, expression, column, precision, verdict, at[1], at[2], detail)


def _text(w) -> str:
    return "(" + " ".join(f"{c:.17g}" for c in w) + ")"

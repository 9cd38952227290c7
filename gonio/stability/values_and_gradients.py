"""Values and gradients against textbook forms at forty digits: right to rounding and the conditioning of the inputs."""

import functools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from mpmath import mpf

from gonio.models.brdf import AbstractBRDF
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.sides import Hemispheres
from gonio.models.parameters import parameters_of
from gonio.stability.directions import COLUMNS, pairs
from gonio.stability.outcome import RIGHT, SAYS_SO, SILENT, Cell, worst
from gonio.stability.precision import PRECISIONS, cast, cast_directions
from gonio.stability.reference import DIGITS, Inputs, Reference
from gonio.stability.textbook.frame import mp

ULPS = 32
SLOPE_ULPS, SLOPE_CONDITION = 128, 8  # slopes are sums of more terms, each as ill-conditioned as f
CONDITION = 16
NEGLIGIBLE = 1e-6
TABLED_SLOPE = 1e-6  # what the wide steps of such a reference are good for
SLOPE_ACCURACY = 1e3
"""Factor between the accuracy that a table claims and that of its slope."""


def transmits(brdf: AbstractBRDF) -> bool:
    """Whether light goes through the surface."""
    return Hemispheres.TRANSMISSION in brdf.hemispheres


@eqx.filter_jit
def values_of(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> jax.Array:
    """f of pairs, (n,)."""
    return jax.vmap(brdf.f)(wi, wo)


@eqx.filter_jit
def _gradients(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> Any:
    # ∂f/∂(every parameter, every component): a tree like the model, and six components.
    return jax.vmap(jax.grad(lambda args: args[0].f(args[1], args[2])), in_axes=((None, 0, 0),))((brdf, wi, wo))


def slopes_of(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> list[np.ndarray]:
    """All derivatives of f, by the parameters and by the six components, (n,) each."""
    return [np.asarray(a) for a in jax.tree.leaves(_gradients(brdf, wi, wo))]


class Judgement(NamedTuple):
    """A verdict on one number; error and allowance relative to the exact value, where that is not 0."""

    verdict: str
    error: float
    allowed: float
    inputs: Inputs
    value: float
    exact: mpf


class _Case(NamedTuple):
    """A model in one precision, and its reference."""

    brdf: AbstractBRDF
    reference: Reference
    dtype: Any

    @property
    def eps(self) -> float:
        return float(np.finfo(self.dtype).eps)

    @property
    def tiny(self) -> float:
        return float(np.finfo(self.dtype).tiny)

    @property
    def largest(self) -> float:
        return float(np.finfo(self.dtype).max)

    def judge(self, value: float, exact: mpf, inputs: Inputs, floor: float, spread: Callable[[], mpf]) -> Judgement:
        """Right within some roundings, the floor and, where these are not enough, the spread.

        `spread()` is what the rounding of the inputs makes of the exact value.
        """
        if not np.isfinite(value):
            return Judgement(RIGHT if abs(exact) > self.largest else SAYS_SO, np.inf, 0.0, inputs, value, exact)
        allowed = ULPS * self.eps * abs(exact) + floor
        error = abs(mpf(value) - exact)
        if error > allowed:
            allowed += CONDITION * spread()
        size = abs(exact) if exact else mpf(1)
        verdict = RIGHT if error <= allowed else SILENT
        return Judgement(verdict, float(error / size), float(allowed / size), inputs, value, exact)


def value_cells(name: str, expression: str, precision: str, columns: tuple[str, ...] | None = None) -> list[Cell]:
    """One cell for each incidence: the worst of its pairs."""
    return _cells("value", name, expression, precision, columns, _value_judgements)


def gradient_cells(name: str, expression: str, precision: str, columns: tuple[str, ...] | None = None) -> list[Cell]:
    """One cell for each incidence: ∂f/∂parameter against differences, and all of the gradient finite."""
    return _cells("gradient", name, expression, precision, columns, _gradient_judgements)


def _cells(
    method: str, name: str, expression: str, precision: str, columns: tuple[str, ...] | None,
    judgements: Callable[[_Case, str], list[Judgement]],
) -> list[Cell]:  # fmt: skip
    dtype = PRECISIONS[precision]
    case = _Case(cast(build(expression), dtype), Reference(expression, dtype), dtype)
    cells = []
    for column in columns or case.reference.columns(tuple(COLUMNS)):
        with mp.workdps(DIGITS):
            judged = judgements(case, column)
        verdict = worst([j.verdict for j in judged])
        j = max((j for j in judged if j.verdict == verdict), key=lambda j: j.error / max(j.allowed, 1e-300))
        what = "f" if method == "value" else "slope"
        where = f"at wi {_text(j.inputs.wi)}, wo {_text(j.inputs.wo)}"
        detail = f"{what} {j.value:.9g} beside {mp.nstr(j.exact, 9)} {where}"
        cells.append(Cell(method, name, expression, column, precision, verdict, j.error, j.allowed, detail))
    return cells


def _value_judgements(case: _Case, column: str) -> list[Judgement]:
    wi, wo = (w.astype(case.dtype) for w in pairs(column, transmits(case.brdf)))
    values = np.asarray(values_of(case.brdf, *(cast_directions(w, case.dtype) for w in (wi, wo))))
    # What no product of single numbers can carry, and what is nothing beside the largest value there, is 0.
    floor = case.tiny * 1e11 + case.eps**3 * float(np.max(np.abs(np.nan_to_num(values))))
    judged = []
    for i, o, f in zip(wi.astype(float), wo.astype(float), values, strict=True):
        inputs = case.reference.inputs(i, o)
        exact = case.reference.value(inputs)
        spread = functools.partial(_value_spread, case.reference, inputs, exact)
        allowed = floor + case.brdf.accuracy * (1 + float(abs(exact)))
        judged.append(case.judge(float(f), exact, inputs, allowed, spread))
    return judged


def _value_spread(reference: Reference, inputs: Inputs, exact: mpf) -> mpf:
    return max(abs(reference.value(moved) - exact) for moved in reference.perturbed(inputs))


def _gradient_judgements(case: _Case, column: str) -> list[Judgement]:
    wi, wo = (w[::2].astype(case.dtype) for w in pairs(column, transmits(case.brdf)))
    gradients = _gradients(case.brdf, *(cast_directions(w, case.dtype) for w in (wi, wo)))
    by_parameter = {n: getattr(gradients[0], n) for n in parameters_of(type(gradients[0]))}
    slopes = {n: np.asarray(s) for n, s in by_parameter.items() if s is not None}
    directions = np.stack([np.asarray(c) for d in gradients[1:] for c in d], -1)
    judged = []
    for k, (i, o) in enumerate(zip(wi.astype(float), wo.astype(float), strict=True)):
        inputs = case.reference.inputs(i, o)
        scale = abs(case.reference.value(inputs))
        # Near the horizon f changes within its cosine: that slope may be beyond the largest number.
        steep = scale / min(abs(i[2]), abs(o[2])) > case.largest * 1e-6
        lost = not np.isfinite(directions[k]).all() and not steep
        error, value = (float("inf"), float("nan")) if lost else (0.0, 0.0)
        judged.append(Judgement(SAYS_SO if lost else RIGHT, error, 0.0, inputs, value, mpf(0)))
        if mp.isfinite(scale) and scale <= case.largest:  # else f is no number, and has no slope
            judged += _slope_judgements(case, inputs, scale, slopes, k)
    return judged


def _slope_judgements(
    case: _Case, inputs: Inputs, scale: mpf, slopes: dict[str, np.ndarray], k: int
) -> Iterator[Judgement]:
    reference = case.reference
    for parameter, number in inputs.params.items():
        value = float(slopes[parameter][k])
        exact = reference.slope(parameter, inputs)
        if exact is None:  # any number stands for an infinite slope, a great one or none at all
            yield Judgement(RIGHT if np.isfinite(value) else SAYS_SO, 0.0, 0.0, inputs, value, mp.inf)
            continue
        # What a whole step of the parameter would change f by is the scale of its rounding.
        unit = scale / max(abs(number), mpf("1e-3"))
        floor = SLOPE_ULPS * case.eps * unit + case.tiny * 1e6
        floor += TABLED_SLOPE * float(abs(exact)) * reference.tabled
        floor += case.brdf.accuracy * (1 + float(scale)) * SLOPE_ACCURACY
        # Slopes that a fit cannot feel: the rounding of a millionth of the largest slope at the same incidence.
        floor += NEGLIGIBLE * case.eps * float(np.max(np.abs(np.nan_to_num(slopes[parameter]))))
        spread = functools.partial(_slope_spread, reference, parameter, inputs, exact)
        judged = case.judge(value, exact, inputs, floor, spread)
        beside = reference.slope_beside(parameter, inputs) if judged.verdict == SILENT else exact
        if beside is not None and abs(beside - exact) > abs(exact) / 2:  # the step of `exact` fell across a jump of f
            judged = case.judge(value, beside, inputs, floor, spread)
        yield judged


def _slope_spread(reference: Reference, parameter: str, inputs: Inputs, exact: mpf) -> mpf:
    if reference.infinite(parameter, inputs):
        return mp.inf
    near = [reference.slope(parameter, moved) for moved in reference.perturbed(inputs)]
    return SLOPE_CONDITION * max(abs((exact if s is None else s) - exact) for s in near)


def _text(w: Any) -> str:
    return "(" + " ".join(f"{float(c):.17g}" for c in w) + ")"

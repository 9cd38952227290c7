"""The reference of values and gradients: textbook forms at forty digits, and the effect of rounding their inputs."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from mpmath import mpf

from gonio.models.catalog import MODELS
from gonio.models.expression.parser import Call, Term, parse
from gonio.models.parameters import parameters_of
from gonio.stability.textbook import TEXTBOOK
from gonio.stability.textbook.frame import Params, Vector

DIGITS = 40
PERTURBED = 4
STEP, TABLED_STEP = mpf(10) ** -14, mpf(10) ** -4
LEAST_STEP = mpf(10) ** -36
FINER = 10**12
"""Factor between the two steps whose quotients differ where a slope is infinite."""
JUMP = 10**8
"""Factor between the usual step and the one beside a jump: less than directions in double precision are apart."""


class Inputs(NamedTuple):
    """Two directions of three numbers each, and the parameters."""

    wi: Vector
    wo: Vector
    params: Params


class Reference:
    """A model of one channel by its textbook form, at inputs rounded to a precision.

    Use it with `mp.workdps(DIGITS)`.
    """

    def __init__(self, expression: str, dtype: Any):
        (term,) = parse(expression)
        self.dtype = np.dtype(dtype)
        self.call = term.call
        self.form = TEXTBOOK[term.call.name]
        self.domains = parameters_of(MODELS[term.call.name])
        self.params = self._params(term.call)
        # A form that integrates albedos anew for every width gets as few of them as will do, and wide steps.
        self.tabled = self.call.name in ("coat", "kelemen") or self.call.options.get("energy", "single") != "single"
        self.costly = self.tabled or "exact" in self.call.options.values() or self.call.name == "chandrasekhar"
        self.inside = {field: self._inside(terms) for field, terms in term.call.models.items()}

    def _params(self, call: Call) -> dict[str, mpf]:
        with np.errstate(over="ignore"):  # numbers that single precision does not hold
            return {n: mpf(float(self.dtype.type(v.number))) for n, v in call.values.items()}

    def _inside(self, terms: tuple[Term, ...]) -> Callable[[Vector, Vector], mpf]:
        # A model inside another, as the textbook form of the outer one takes it: a function of two directions.
        (term,) = terms
        params = self._params(term.call)
        return lambda wi, wo: TEXTBOOK[term.call.name](params, term.call.options, wi, wo)

    def inputs(self, wi: np.ndarray, wo: np.ndarray) -> Inputs:
        """Directions of three floats each, with the model's parameters."""
        return Inputs(_vector(wi), _vector(wo), self.params)

    def value(self, inputs: Inputs) -> mpf:
        """f, 1/sr."""
        return self.form(inputs.params, self.call.options, inputs.wi, inputs.wo, **self.inside)

    def slope(self, name: str, inputs: Inputs) -> mpf | None:
        """∂f/∂parameter by differences at forty digits, central inside of the domain and towards it on its edge.

        None where it is infinite: where the quotient grows as the step shrinks.
        """
        first = self._quotient(name, inputs, 1)
        if inputs.params[name] in (self.domains[name].low, self.domains[name].high) and not self.costly:
            # One-sided quotients are good to the step only: the slope is where they go as it shrinks.
            second = self._quotient(name, inputs, FINER)
            return None if abs(second) > 10 * abs(first) else second
        return first

    def infinite(self, name: str, inputs: Inputs) -> bool:
        """Whether ∂f/∂parameter is infinite, in however small a term of f: quotients grow as the step shrinks."""
        if self.tabled:
            return False
        coarse, fine = (self._quotient(name, inputs, finer) for finer in (1, FINER**2))
        return bool(abs(fine) > 10 * abs(coarse))

    def slope_beside(self, name: str, inputs: Inputs) -> mpf | None:
        """∂f/∂parameter by a step that a jump of f, which lies nearer than the usual one, does not fall into."""
        if self.tabled:
            return self.slope(name, inputs)
        return self._quotient(name, inputs, JUMP)

    def _quotient(self, name: str, inputs: Inputs, finer: int) -> mpf:
        center, info = inputs.params[name], self.domains[name]
        size = abs(center - 1) if name == "eta" else abs(center)  # an index acts by its distance from 1
        step = (TABLED_STEP if self.tabled else STEP) * (size if size else 1) / finer
        # Beside an index of nearly 1 the finest step is less than forty digits tell apart.
        step = max(step, LEAST_STEP * abs(center))
        # In single precision a bound may lie a rounding inside of the number that stands for it.
        low, high = min(mpf(info.low), center), max(mpf(info.high), center)
        up, down = min(center + step, high), max(center - step, low)
        if up <= down:
            up, down = center + step, center - step

        def value(x: mpf) -> mpf:
            return self.value(inputs._replace(params={**inputs.params, name: x}))

        if self.tabled and center in (up, down):
            # Wide steps towards one side: by three points, good to the square of the step.
            far = up + down - center
            return (4 * value(far) - 3 * value(center) - value(2 * far - center)) / (2 * (far - center))
        return (value(up) - value(down)) / (up - down)

    def perturbed(self, inputs: Inputs) -> Iterator[Inputs]:
        """Some inputs with every number moved by at most one unit in its last place, always the same."""
        eps, rng = mpf(float(np.finfo(self.dtype).eps)), np.random.default_rng(0)

        def moved(x: mpf) -> mpf:
            return x * (1 + eps * int(rng.integers(-1, 2)))

        for _ in range(1 if self.costly else PERTURBED):
            params: Mapping[str, mpf] = self.params if self.tabled else {n: moved(v) for n, v in self.params.items()}
            yield Inputs(_vector(map(moved, inputs.wi)), _vector(map(moved, inputs.wo)), params)

    def columns(self, every: tuple[str, ...]) -> tuple[str, ...]:
        """The incidences to compare at: a few where each evaluation takes long."""
        return every[1::3] if self.costly else every


def _vector(components: Any) -> Vector:
    x, y, z = map(mpf, components)
    return x, y, z

"""The second opinion: textbook forms at forty digits, and what the rounding of their inputs makes of them."""

import mpmath as mp
import numpy as np

from gonio.models.catalog import MODELS
from gonio.models.expression.parser import Term, parse
from gonio.models.parameters import parameters_of
from gonio.stability.textbook import TEXTBOOK

DIGITS = 40
PERTURBED = 4
STEP, TABLED_STEP = mp.mpf(10) ** -14, mp.mpf(10) ** -4
LEAST_STEP = mp.mpf(10) ** -36
FINER = 10**12
"""How much smaller the step is by which a slope is seen to be infinite."""


class Reference:
    """A spelled one-channel model by its textbook form, at inputs exactly as a precision holds them."""

    def __init__(self, expression: str, dtype: np.dtype):
        (term,) = parse(expression)
        self.dtype = np.dtype(dtype)
        self.call = term.call
        self.form = TEXTBOOK[term.call.name]
        self.domains = parameters_of(MODELS[term.call.name])
        self.params = {n: self._held(v.number) for n, v in term.call.values.items()}
        # A form that integrates albedos anew for every width gets as few of them as will do, and wide steps.
        self.tabled = self.call.name in ("coat", "kelemen") or self.call.options.get("energy", "single") != "single"
        self.costly = self.tabled or "exact" in self.call.options.values() or self.call.name == "chandrasekhar"
        self.draws = 1 if self.costly else PERTURBED
        self.inside = {field: self._inside(parts) for field, parts in term.call.models.items()}

    def _held(self, number: float):
        with np.errstate(over="ignore"):  # numbers that single precision does not hold
            return mp.mpf(float(self.dtype.type(number)))

    def _inside(self, parts: tuple[Term, ...]):
        # A model inside another, as the textbook form of the outer one takes it: a function of two directions.
        (term,) = parts
        params = {n: self._held(v.number) for n, v in term.call.values.items()}
        return lambda wi, wo: TEXTBOOK[term.call.name](params, term.call.options, wi, wo)

    def value(self, wi, wo, params=None):
        """f, 1/sr, as an mpf; wi and wo of three floats or mpfs."""
        said = self.params if params is None else params
        return self.form(said, self.call.options, tuple(map(mp.mpf, wi)), tuple(map(mp.mpf, wo)), **self.inside)

    def slope(self, name: str, wi, wo, params=None):
        """∂f/∂parameter by differences at forty digits, central inside of the domain and towards it on its edge.

        None where it is infinite: where the quotient grows as the step shrinks.
        """
        params = self.params if params is None else params
        at, info = params[name], self.domains[name]
        first = self._quotient(name, wi, wo, params, 1)
        if at in (info.low, info.high) and not self.costly:
            # One-sided quotients are good to the step only: the slope is where they go as it shrinks.
            second = self._quotient(name, wi, wo, params, FINER)
            return None if abs(second) > 10 * abs(first) else second
        return first

    def infinite(self, name: str, wi, wo) -> bool:
        """Whether ∂f/∂parameter is infinite, in however small a part of f: quotients grow as the step shrinks."""
        if self.tabled:
            return False
        most = FINER if self.costly else FINER**2
        coarse, fine = (self._quotient(name, wi, wo, self.params, finer) for finer in (1, most))
        return bool(abs(fine) > 10 * abs(coarse))

    def _quotient(self, name: str, wi, wo, params, finer):
        at, info = params[name], self.domains[name]
        size = abs(at - 1) if name == "eta" else abs(at)  # what an index does, it does by its distance from 1
        step = (TABLED_STEP if self.tabled else STEP) * (size if size else 1) / finer
        # Beside an index of nearly 1 the finest step is less than forty digits tell apart.
        step = max(step, LEAST_STEP * abs(at))
        up, down = min(at + step, mp.mpf(info.high)), max(at - step, mp.mpf(info.low))
        if up <= down:
            up, down = at + step, at - step
        if self.tabled and at in (up, down):
            # Wide steps towards one side: by three points, good to the square of the step.
            far = up + down - at
            at_0, at_1, at_2 = (self.value(wi, wo, {**params, name: v}) for v in (at, far, 2 * far - at))
            return (4 * at_1 - 3 * at_0 - at_2) / (2 * (far - at))
        ends = [self.value(wi, wo, {**params, name: v}) for v in (up, down)]
        return (ends[0] - ends[1]) / (up - down)

    def perturbed(self, wi, wo):
        """Some (wi, wo, params) with every number moved by at most one unit in its last place, always the same."""
        eps, rng = mp.mpf(float(np.finfo(self.dtype).eps)), np.random.default_rng(0)

        def moved(x):
            return mp.mpf(x) * (1 + eps * int(rng.integers(-1, 2)))

        for _ in range(self.draws):
            params = self.params if self.tabled else {n: moved(v) for n, v in self.params.items()}
            yield [moved(c) for c in wi], [moved(c) for c in wo], params

    def columns(self, every: tuple[str, ...]) -> tuple[str, ...]:
        """The incidences to look at: a few where each evaluation is dear."""
        return every[1::3] if self.costly else every

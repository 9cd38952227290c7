"""The second opinion: textbook forms at forty digits, and what the rounding of their inputs makes of them."""

import mpmath as mp
import numpy as np

from gonio.atlas.textbook import TEXTBOOK
from gonio.models.spelling import Term, parse

DIGITS = 40
PERTURBED = 4
STEP = mp.mpf(10) ** -14


class Reference:
    """A spelled one-channel model by its textbook form, at inputs exactly as a precision holds them."""

    def __init__(self, spelling: str, dtype: np.dtype):
        (term,) = parse(spelling)
        self.dtype = np.dtype(dtype)
        self.call = term.call
        self.form = TEXTBOOK[term.call.name]
        self.params = {n: self._held(v.number) for n, v in term.call.values.items()}
        self.inside = {field: self._inside(parts) for field, parts in term.call.models.items()}

    def _held(self, number: float):
        return mp.mpf(float(self.dtype.type(number)))

    def _inside(self, parts: tuple[Term, ...]):
        # A model inside another, as the textbook form of the outer one takes it: (function, parameters, options).
        (term,) = parts
        params = {n: self._held(v.number) for n, v in term.call.values.items()}
        return TEXTBOOK[term.call.name], params, term.call.options

    def value(self, wi, wo, params=None):
        """f, 1/sr, as an mpf; wi and wo of three floats or mpfs."""
        said = {**(self.params if params is None else params), **self.inside}
        return self.form(said, self.call.options, tuple(map(mp.mpf, wi)), tuple(map(mp.mpf, wo)))

    def slope(self, name: str, wi, wo):
        """∂f/∂parameter by central differences at forty digits; one-sided on the edge of a domain."""
        at = self.params[name]
        step = STEP * (abs(at) if at else 1)
        up, down = ({**self.params, name: at + s} for s in (step, -step))
        return (self.value(wi, wo, up) - self.value(wi, wo, down)) / (2 * step)

    def perturbed(self, rng: np.random.Generator, wi, wo):
        """(wi, wo, params) with every number moved by at most one unit in its last place."""
        eps = mp.mpf(float(np.finfo(self.dtype).eps))

        def moved(x):
            return mp.mpf(x) * (1 + eps * int(rng.integers(-1, 2)))

        return [moved(c) for c in wi], [moved(c) for c in wo], {n: moved(v) for n, v in self.params.items()}

"""Elementary functions as branch-free arithmetic, for vectors: at most 2 units in the last place off (4 in float32).

Reductions are those of Cody and Waite; polynomials are minimax, found with Remez' exchange. Numbers below the least
normal one count as 0, as XLA has it.
"""

import math

from gonio.models.compiled.elementary.coefficients import COEFFICIENTS, SHIFTS, SPLIT
from gonio.models.compiled.graph import BITS, Graph

MANTISSA = {"f32": 23, "f64": 52}
BIAS = {"f32": 127, "f64": 1023}
EXP_RANGE = {"f32": (-86.6, 89.0), "f64": (-707.7, 710.0)}
"""Below, exp counts as 0; above, it is infinite."""
STIRLING = (1 / 12, -1 / 360, 1 / 1260, -1 / 1680, 1 / 1188, -691 / 360360, 1 / 156)
HALF_LOG_TWO_PI = 0.5 * math.log(2 * math.pi) - 0.5
"""(y - ½)·log y - y + ½ log 2π is (y - ½)·(log y - 1) and this."""
TRIGONOMETRIC_RANGE = {"f32": 1e4, "f64": 1e6}
"""Sine and cosine are accurate to here; XLA evaluates what goes beyond."""


class Elementary:
    """The functions of numbers of one precision, as nodes of a graph."""

    def __init__(self, graph: Graph, dtype: str) -> None:
        self.g, self.dtype = graph, dtype

    def number(self, value: float) -> int:
        return self.g.constant(value, self.dtype)

    def integer(self, value: int) -> int:
        return self.g.constant(value, BITS[self.dtype])

    def fma(self, a: int, b: int, c: int) -> int:
        return self.g.apply("fma", a, b, c)

    def add(self, a: int, b: int) -> int:
        return self.g.apply("add_exact", a, b)

    def sub(self, a: int, b: int) -> int:
        return self.g.apply("sub_exact", a, b)

    def mul(self, a: int, b: int) -> int:
        return self.g.apply("mul_exact", a, b)

    def select(self, condition: int, a: int, b: int) -> int:
        return self.g.apply("select", condition, a, b)

    def compare(self, name: str, a: int, value: float) -> int:
        return self.g.apply(name, a, self.number(value))

    def polynomial(self, x: int, name: str, start: int = 0) -> int:
        """The polynomial of a table, or of its coefficients from one on: even and odd powers side by side."""
        terms = [self.number(c) for c in COEFFICIENTS[name, self.dtype][start:]]
        if len(terms) > 4:
            pairs = range(0, len(terms), 2)
            terms = [self.fma(x, terms[k + 1], terms[k]) if k + 1 < len(terms) else terms[k] for k in pairs]
            x = self.mul(x, x)
        value = terms[-1]
        for term in terms[-2::-1]:
            value = self.fma(value, x, term)
        return value

    def rounded(self, x: int) -> tuple[int, int]:
        """(the nearest whole number, the same as an integer), for |x| < 2^22 (2^51)."""
        shift = self.number(SHIFTS[self.dtype])
        shifted = self.add(x, shift)
        return self.sub(shifted, shift), self.g.bits(shifted, BITS[self.dtype])

    def power_of_two(self, exponent: int) -> int:
        """2^n for an integer in the low bits, in the range of normal numbers."""
        width = self.integer(MANTISSA[self.dtype])
        one = self.integer(BIAS[self.dtype] << MANTISSA[self.dtype])
        return self.g.bits(self.g.apply("add", self.g.apply("shl", exponent, width), one), self.dtype)

    def exp(self, x: int, low: int | None = None) -> int:
        """e^(x + low), low a correction of x of the size of its rounding."""
        whole, bits = self.rounded(self.mul(self._in_exp_range(x), self.number(1 / math.log(2))))
        return self._finished_exp(x, self._reduced(x, whole, low), bits)

    def _in_exp_range(self, x: int) -> int:
        """x where it is in the range of exp: the integer of what is beyond means nothing, and NaN stays."""
        least, most = (self.number(v) for v in EXP_RANGE[self.dtype])
        return self.g.maximum(least, self.g.minimum(most, x))

    def _reduced(self, x: int, whole: int, low: int | None) -> int:
        high, rest = (self.number(-v) for v in SPLIT["log 2", self.dtype])
        r = self.fma(whole, rest, self.fma(whole, high, x))
        return r if low is None else self.add(r, low)

    def _finished_exp(self, x: int, r: int, bits: int) -> int:
        value = self.fma(self.mul(r, r), self.polynomial(r, "exp"), r)
        value = self.add(value, self.number(1.0))
        halved = self.power_of_two(self.g.apply("sub", bits, self.integer(1)))  # 2^n alone overflows before the result
        value = self.mul(self.mul(value, halved), self.number(2.0))
        least, most = EXP_RANGE[self.dtype]
        value = self.select(self.compare("lt", x, least), self.number(0.0), value)
        return self.select(self.compare("gt", x, most), self.number(math.inf), value)

    def exp2(self, x: int) -> int:
        scale, rest = SPLIT["log 2 nearest", self.dtype]
        product = self.mul(x, self.number(scale))
        low = self.fma(x, self.number(scale), self.g.apply("neg", product))
        finite = self.compare("lt", self.g.apply("abs", product), 1e6)
        return self.exp(product, self.select(finite, self.fma(x, self.number(rest), low), self.number(0.0)))

    def expm1(self, x: int) -> int:
        whole, bits = self.rounded(self.mul(self._in_exp_range(x), self.number(1 / math.log(2))))
        r = self._reduced(x, whole, None)
        small = self.fma(self.mul(r, r), self.polynomial(r, "exp"), r)
        power = self.power_of_two(bits)
        value = self.fma(power, small, self.sub(power, self.number(1.0)))
        value = self.select(self.compare("gt", x, 700.0 if self.dtype == "f64" else 87.0), self.exp(x), value)
        value = self.select(self.compare("lt", x, -40.0), self.number(-1.0), value)
        return self.select(self.g.apply("eq", x, self.number(0.0)), x, value)

    def split(self, x: int) -> tuple[int, int]:
        """(m, n as a number) with x = m·2^n, m in [√½, √2), of a normal number."""
        kind, width = BITS[self.dtype], self.integer(MANTISSA[self.dtype])
        bits = self.g.bits(x, kind)
        origin = self.g.bits(self.number(math.sqrt(0.5)), kind)
        exponent = self.g.apply("ashr", self.g.apply("sub", bits, origin), width)
        m = self.g.bits(self.g.apply("sub", bits, self.g.apply("shl", exponent, width)), self.dtype)
        shift = self.number(SHIFTS[self.dtype])
        n = self.g.bits(self.g.apply("add", exponent, self.g.bits(shift, kind)), self.dtype)
        return m, self.sub(n, shift)

    def log(self, x: int) -> int:
        return self._with_log_limits(x, self._log(*self.split(x)))

    def _log(self, m: int, n: int, low: int | None = None) -> int:
        """log(m·2^n·(1 + low)): 2 artanh of f/(2 + f), f = m - 1, in the order that loses nothing."""
        f = self.sub(m, self.number(1.0))
        s = self.g.apply("div", f, self.add(f, self.number(2.0)))
        z = self.mul(s, s)
        half_square = self.mul(self.mul(f, f), self.number(0.5))
        r = self.mul(z, self.polynomial(z, "log"))
        high, rest = (self.number(v) for v in SPLIT["log 2", self.dtype])
        small = self.mul(n, rest) if low is None else self.fma(n, rest, low)
        inner = self.fma(s, self.add(half_square, r), small)
        return self.fma(n, high, self.sub(f, self.sub(half_square, inner)))

    def _with_log_limits(self, x: int, value: int) -> int:
        least = 2.0 ** (1 - BIAS[self.dtype])
        value = self.select(self.compare("lt", x, least), self.number(-math.inf), value)
        value = self.select(self.compare("lt", x, -least), self.number(math.nan), value)
        value = self.select(self.compare("eq", x, math.inf), x, value)
        return self.select(self.g.apply("ne", x, x), x, value)

    def log1p(self, x: int) -> int:
        one = self.number(1.0)
        u = self.add(x, one)
        swapped = self.compare("ge", x, 1.0)
        big, small = self.select(swapped, x, one), self.select(swapped, one, x)
        low = self.g.apply("div", self.sub(small, self.sub(u, big)), u)
        return self._with_log_limits(u, self._log(*self.split(u), low))

    def tanh(self, x: int) -> int:
        magnitude = self.g.minimum(self.number(30.0), self.g.apply("abs", x))
        e = self.expm1(self.mul(magnitude, self.number(2.0)))
        value = self.g.apply("div", e, self.add(e, self.number(2.0)))
        return self.with_sign(value, x)

    def with_sign(self, magnitude: int, of: int) -> int:
        """The magnitude with the sign bit of another number."""
        kind = BITS[self.dtype]
        sign = self.g.apply("and", self.g.bits(of, kind), self.g.bits(self.number(-0.0), kind))
        return self.g.bits(self.g.apply("or", self.g.bits(magnitude, kind), sign), self.dtype)

    def _quadrant(self, x: int) -> tuple[int, int, int]:
        """(sine, cosine) of x less its nearest multiple of π/2, and the multiple as an integer."""
        beyond = self.compare("gt", self.g.apply("abs", x), TRIGONOMETRIC_RANGE[self.dtype])
        self.g.require(self.g.apply("xor", beyond, self.g.constant(True, "i1")))
        whole, bits = self.rounded(self.mul(x, self.number(2 / math.pi)))
        r = x
        for part in SPLIT["π/2", self.dtype]:
            r = self.fma(whole, self.number(-part), r)
        z = self.mul(r, r)
        sine = self.fma(self.mul(r, z), self.polynomial(z, "sin"), r)
        half = self.fma(z, self.number(-0.5), self.number(1.0))
        lost = self.fma(z, self.number(-0.5), self.sub(self.number(1.0), half))
        cosine = self.add(half, self.fma(self.mul(z, z), self.polynomial(z, "cos"), lost))
        return sine, cosine, bits

    def sin(self, x: int) -> int:
        sine, cosine, bits = self._quadrant(x)
        return self._turned(self.select(self._odd(bits), cosine, sine), bits)

    def cos(self, x: int) -> int:
        sine, cosine, bits = self._quadrant(x)
        value = self.select(self._odd(bits), sine, cosine)
        return self._turned(value, self.g.apply("add", bits, self.integer(1)))

    def tan(self, x: int) -> int:
        sine, cosine, bits = self._quadrant(x)
        odd = self._odd(bits)
        above, below = self.select(odd, self.g.apply("neg", cosine), sine), self.select(odd, sine, cosine)
        return self.g.apply("div", above, below)

    def _odd(self, bits: int) -> int:
        return self.g.apply("ne", self.g.apply("and", bits, self.integer(1)), self.integer(0))

    def _turned(self, value: int, bits: int) -> int:
        """The negative in the quadrants 2 and 3."""
        negative = self.g.apply("ne", self.g.apply("and", bits, self.integer(2)), self.integer(0))
        return self.select(negative, self.g.apply("neg", value), value)

    def atan2(self, y: int, x: int) -> int:
        """The angle of (x, y): one division, and a polynomial within π/8 of a multiple of π/4."""
        ax, ay = self.g.apply("abs", x), self.g.apply("abs", y)
        steep = self.g.apply("gt", ay, ax)
        small, large = self.select(steep, ax, ay), self.select(steep, ay, ax)
        middle = self.g.apply("gt", small, self.mul(large, self.number(math.tan(math.pi / 8))))
        above = self.select(middle, self.sub(small, large), small)
        below = self.select(middle, self.add(small, large), large)
        zero = self.compare("eq", below, 0.0)
        t = self.g.apply("div", above, self.select(zero, self.number(1.0), below))
        infinite = self.compare("eq", large, math.inf)
        both = self.g.apply("and", infinite, self.compare("eq", small, math.inf))
        t = self.select(infinite, self.number(0.0), t)
        middle = self.g.apply("or", self.g.apply("and", middle, self.g.apply("xor", infinite, self.true)), both)
        z = self.mul(t, t)
        angle = self.fma(self.mul(t, z), self.polynomial(z, "atan"), t)
        value = self._unfolded(angle, x, y, steep, middle)
        return self.select(self.g.apply("ne", small, small), small, value)

    @property
    def true(self) -> int:
        return self.g.constant(True, "i1")

    def _unfolded(self, angle: int, x: int, y: int, steep: int, middle: int) -> int:
        """The angle of the octant (0..π/4, less π/4 in its upper half) as an angle of (-π, π]."""
        high, low = SPLIT["π/2", self.dtype][:2]
        backward = self.compare("lt", self.with_sign(self.number(1.0), x), 0.0)
        flip = self.g.apply("xor", steep, backward)
        base = self.select(middle, self.number(0.5), self.number(0.0))
        base = self.select(steep, self.sub(self.number(1.0), base), base)
        base = self.select(backward, self.sub(self.number(2.0), base), base)
        angle = self.select(flip, self.g.apply("neg", angle), angle)
        value = self.fma(base, self.number(high), self.fma(base, self.number(low), angle))
        return self.with_sign(value, y)

    def atan(self, x: int) -> int:
        return self.atan2(x, self.number(1.0))

    def acos(self, x: int) -> int:
        below, above = self.sub(self.number(1.0), x), self.add(self.number(1.0), x)
        return self.atan2(self.g.apply("sqrt", self.mul(below, above)), x)

    def asin(self, x: int) -> int:
        below, above = self.sub(self.number(1.0), x), self.add(self.number(1.0), x)
        return self.atan2(x, self.g.apply("sqrt", self.mul(below, above)))

    def erfc(self, x: int) -> int:
        """e^(-x²)·p(t)/(1 + 2x): what p, the division and the square lose goes into the exponent."""
        a = self.g.minimum(self.number(30.0), self.g.apply("abs", x))
        two, one = self.number(2.0), self.number(1.0)
        t = self.g.apply("div", self.sub(a, two), self.add(a, two))
        first, rest = self.number(COEFFICIENTS["erfc", self.dtype][0]), self.polynomial(t, "erfc", 1)
        p = self.fma(t, rest, first)
        p_low = self.fma(t, rest, self.sub(first, p))
        divisor = self.fma(a, two, one)
        factor = self.g.apply("div", p, divisor)
        minus = self.g.apply("neg", factor)
        lost = self.fma(minus, self.fma(a, two, self.sub(one, divisor)), self.fma(minus, divisor, p))
        square = self.g.apply("neg", self.mul(a, a))
        low = self.sub(self.g.apply("div", self.add(lost, p_low), p), self.fma(a, a, square))
        value = self.mul(self.exp(square, low), factor)
        return self.select(self.compare("lt", x, 0.0), self.sub(two, value), value)

    def erf(self, x: int) -> int:
        z = self.mul(x, x)
        large = self.with_sign(self.sub(self.number(1.0), self.erfc(self.g.apply("abs", x))), x)
        small = self.mul(x, self.polynomial(z, "erf"))
        return self.select(self.compare("lt", self.g.apply("abs", x), 1.0), small, large)

    def lgamma(self, x: int) -> int:
        """log Γ(x), x > 0, to 8e-15 + 2e-15·log Γ: Stirling's series of x + 8; XLA evaluates the rest."""
        if self.dtype == "f32":
            return self.g.convert(Elementary(self.g, "f64").lgamma(self.g.convert(x, "f64")), "f32")
        below = self.compare("lt", x, 8.0)
        self.g.require(self.compare("gt", x, 0.0))
        product = x
        for k in range(1, 8):
            product = self.mul(product, self.add(x, self.number(float(k))))
        y = self.select(below, self.add(x, self.number(8.0)), x)
        inverse = self.g.apply("div", self.number(1.0), y)
        square, series = self.mul(inverse, inverse), self.number(STIRLING[-1])
        for term in STIRLING[-2::-1]:
            series = self.fma(series, square, self.number(term))
        main = self.fma(
            self.sub(y, self.number(0.5)), self.sub(self.log(y), self.number(1.0)), self.number(HALF_LOG_TWO_PI)
        )
        value = self.fma(series, inverse, main)
        return self.sub(value, self.select(below, self.log(product), self.number(0.0)))

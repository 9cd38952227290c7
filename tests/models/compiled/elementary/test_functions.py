"""Elementary functions of compiled loops against arbitrary precision, and their limits against IEEE 754."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from gonio.models.compiled.program import Program

POINTS = 400
RANGES = {
    "exp": (-700, 700), "expm1": (-3, 3), "exp2": (-50, 50), "log": (0, 3), "log1p": (-0.9, 9), "sin": (-50, 50),
    "cos": (-50, 50), "tan": (-50, 50), "tanh": (-3, 3), "atan": (-9, 9), "acos": (-1, 1), "asin": (-1, 1),
    "erf": (-3, 3), "erfc": (-3, 20), "pow": (0, 9), "atan2": (-1, 1), "sinh": (-3, 3), "cosh": (-9, 9),
    "asinh": (-9, 9), "cbrt": (-9, 9),
}  # fmt: skip
EXACT = {
    "exp2": lambda x: mpmath.mpf(2) ** x,
    "pow": mpmath.power,
    "cbrt": lambda x: mpmath.sign(x) * mpmath.cbrt(abs(x)),
}
EXACT |= {n: getattr(mpmath, n) for n in RANGES if n not in EXACT}
LIMITS = {
    "exp": {800.0: np.inf, -800.0: 0.0, np.inf: np.inf, -np.inf: 0.0},
    "expm1": {0.0: 0.0, 1e-300: 1e-300, -800.0: -1.0, np.inf: np.inf},
    "log": {0.0: -np.inf, -1.0: np.nan, 1.0: 0.0, np.inf: np.inf},
    "log1p": {0.0: 0.0, 1e-20: 1e-20, -1.0: -np.inf, -2.0: np.nan, np.inf: np.inf},
    "tanh": {np.inf: 1.0, -np.inf: -1.0, 0.0: 0.0},
    "erfc": {np.inf: 0.0, -np.inf: 2.0},
    "acos": {1.0: 0.0, -1.0: np.pi, 1.5: np.nan},
    "sinh": {0.0: 0.0, 1e-300: 1e-300},
    "cosh": {0.0: 1.0, 1e-300: 1.0},
    "asinh": {0.0: 0.0, 1e-300: 1e-300, np.inf: np.inf, -np.inf: -np.inf, 2.0**60: np.log(2.0**61)},
    "cbrt": {0.0: 0.0, 8.0: 2.0, -27.0: -3.0, 1e-300: 1e-100, 1e300: 1e100, np.inf: np.inf, -np.inf: -np.inf},
    "ceil": {0.5: 1.0, -0.5: 0.0, -1.0: -1.0, 1e300: 1e300, np.inf: np.inf},
}


def compiled(name, dtype, operands=1):
    """A function of arrays."""
    program = Program(lambda _, *x: getattr(jax.lax, name)(*x), [], [(0,)] * operands, dtype).bound([])
    return lambda *arrays: program([np.asarray(a, dtype) for a in arrays], (len(arrays[0]),))


@pytest.mark.parametrize("name", RANGES)
def test_functions_are_right_to_their_last_places(name):
    """2.5 units in the last place in double precision, 4 in single: where most functions stay below 1.5."""
    rng, low_high = np.random.default_rng(3), RANGES[name]
    for dtype, most in ((np.float64, 2.5), (np.float32, 4.0)):
        low, high = low_high if dtype == np.float64 else (max(low_high[0], -80), min(low_high[1], 8.5))
        arrays = [rng.uniform(low, high, POINTS).astype(dtype)]
        if name in ("pow", "atan2"):
            arrays.append(rng.uniform(-9, 9, POINTS).astype(dtype))
        values = compiled(name, dtype, len(arrays))(*arrays)
        for k, value in enumerate(values):
            true = EXACT[name](*(mpmath.mpf(float(a[k])) for a in arrays))
            unit = float(np.spacing(np.abs(dtype(float(true)))))
            assert abs(float(mpmath.mpf(float(value)) - true)) <= most * unit, (dtype, [a[k] for a in arrays])


def test_limits_are_those_of_the_standard():
    for name, limits in LIMITS.items():
        values = compiled(name, np.float64)(np.array([*limits, np.nan] * 4))[: len(limits) + 1]
        np.testing.assert_array_equal(values, [*limits.values(), np.nan], err_msg=name)
    x = np.array([0.0, 0.0, 2.0, -2.0, -2.0, -2.0, 1.0, np.inf, np.inf, np.nan, np.nan, -8.0])
    y = np.array([2.0, -2.0, 0.0, 3.0, 2.0, 0.5, np.nan, 2.0, -2.0, 1.0, 0.0, 1 / 3])
    with np.errstate(all="ignore"):
        np.testing.assert_array_equal(compiled("pow", np.float64, 2)(x, y), x**y)
    a = np.array([0.0, -0.0, 0.0, -0.0, np.inf, np.inf, 1.0, 1.0, np.nan, 1.0, 0.0, -1.0])
    b = np.array([1.0, 1.0, -1.0, -1.0, np.inf, -np.inf, np.inf, -np.inf, 1.0, np.nan, 0.0, 0.0])
    np.testing.assert_array_equal(compiled("atan2", np.float64, 2)(a, b), np.arctan2(a, b))


def test_what_is_not_accurate_is_not_returned():
    """Sine and cosine of huge angles, log Γ left of zero, what nearly overflows: None, and XLA computes them."""
    assert compiled("sin", np.float64)(np.array([1.0, 1e9])) is None
    assert compiled("cos", np.float32)(np.full(99, 1e5, np.float32)) is None
    assert compiled("lgamma", np.float64)(np.array([0.5, -0.5])) is None
    assert compiled("sinh", np.float64)(np.array([0.5, 709.0])) is None
    assert compiled("cosh", np.float32)(np.full(99, -np.inf, np.float32)) is None
    x = np.linspace(0.01, 60, 1000)
    true = [float(mpmath.loggamma(v)) for v in x]
    np.testing.assert_allclose(compiled("lgamma", np.float64)(x), true, rtol=2e-15, atol=8e-15)


def test_extremes_pass_what_is_no_number_on():
    """As JAX does: the larger of NaN and 1 is NaN, on either side."""
    x = np.array([np.nan, 1.0, 2.0, np.nan])
    for name in ("max", "min"):
        np.testing.assert_array_equal(
            compiled(name, np.float64, 2)(x, x[::-1]), getattr(jnp, f"{name}imum")(x, x[::-1])
        )

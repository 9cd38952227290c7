"""Sums of products of rows by compiled loops, and those that are kept under a name."""

import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.machine import machine
from gonio.models.compiled.sums import Rows, SumsProgram

pytestmark = pytest.mark.skipif(machine() is None, reason="this processor has no compiled loops")
X = np.linspace(-2.0, 3.0, 64)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("GONIO_PROGRAMS_DIR", str(tmp_path))
    monkeypatch.delenv("GONIO_NO_CACHE", raising=False)
    return tmp_path


def sums_of(rows, **options):
    """Σ of the first row squared, and of the first times the second, and the second row, with a scalar of 0.5."""
    program = SumsProgram(Rows(rows, [], 1, (1,), **options), [(0, 0), (0, 1)], [1])
    scalar, stored = np.array([0.5]), np.zeros_like(X)
    addresses = np.array([[a.ctypes.data for a in (scalar, X, stored)]], np.uintp)
    sums = program(np.zeros(0), addresses, X.size)
    assert sums is not None
    return sums[0], stored


def lines(_, scale, x):
    return jnp.stack([scale * x, x * x + 1.0])


def never(_, scale, x):
    raise AssertionError("traced again")


@pytest.mark.parametrize("name", ["", "lines"])
def test_sums_are_those_of_numpy(name):
    sums, stored = sums_of(lines, name=name)
    np.testing.assert_allclose(sums, [np.sum(0.25 * X**2), np.sum(0.5 * X * (X**2 + 1))], rtol=1e-13)
    np.testing.assert_allclose(stored, X**2 + 1, rtol=1e-15)


def test_a_kept_program_with_a_name_needs_no_trace(folder):
    expected = sums_of(lines, name="lines")
    again = sums_of(never, name="lines")
    for a, b in zip(expected, again, strict=True):
        np.testing.assert_array_equal(a, b)
    with pytest.raises(AssertionError, match="traced again"):
        sums_of(never, name="other lines")
    with pytest.raises(AssertionError, match="traced again"):
        sums_of(never)


def test_what_has_no_program_is_known_to_the_next_process():
    def unsupported(_, scale, x):
        return jnp.stack([jnp.sort(jnp.stack([scale, x]))[0], x])

    for rows in (unsupported, never):
        with pytest.raises(Unsupported):
            sums_of(rows, name="sorted")


def test_a_damaged_program_is_made_again(folder):
    expected, _ = sums_of(lines, name="lines")
    for path in folder.iterdir():
        path.write_bytes(path.read_bytes()[:-7] + b"damaged")
    np.testing.assert_array_equal(sums_of(lines, name="lines")[0], expected)

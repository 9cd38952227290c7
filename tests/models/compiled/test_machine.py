"""Machine code in memory."""

import subprocess
import sys

import pytest

SCATTERED = """
import ctypes
import jax, numpy as np
import jax.numpy as jnp
jax.config.update("jax_enable_x64", True)
from gonio.models.compiled.program import Program
libc = ctypes.CDLL(None)
libc.mmap.restype = ctypes.c_void_p
libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long]
libc.munmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t]
rng, kept = np.random.default_rng(0), []
x = np.linspace(0, 1, 64)
for _ in range(80):
    program = Program(lambda leaves, x: jnp.exp(x), [], ((0,),), np.float64)
    np.testing.assert_allclose(program.bound([])([x], (64,)), np.exp(x), rtol=1e-15)
    kept.append(program)
    # Address space without memory: small pieces, more than code reaches, and two small holes.
    pieces = [libc.mmap(None, 4096 * int(n), 0, 0x4022, -1, 0) for n in rng.integers(1, 6, 200)]
    libc.mmap(None, 3 << 30, 0, 0x4022, -1, 0)
    for piece in rng.permutation(pieces)[:2]:
        libc.munmap(int(piece), 4096)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="lays out Linux's address space")
def test_code_reaches_its_constants_where_free_memory_is_scattered():
    """LLVM ends the process where it does not."""
    done = subprocess.run([sys.executable, "-c", SCATTERED], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]

"""All tests run in double precision, rank promotion is an error; processes of one run share compiled programs."""

import atexit
import gc
import os
import shutil
import tempfile
from importlib.metadata import version
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # as the command line does

WORKER = "PYTEST_XDIST_WORKER" in os.environ
PROGRAMS = Path(tempfile.gettempdir()) / f"gonio-tests-{os.getppid() if WORKER else os.getpid()}"

# Programs of other processes that tests start come from here too, from the same length of compilation as theirs.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(PROGRAMS))
os.environ.setdefault("GONIO_PROGRAMS_DIR", str(PROGRAMS / "loops"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.05")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "0")

FLAGS = (
    ["--xla_cpu_use_fusion_emitters=false", "--xla_cpu_parallel_codegen_split_count=1"]
    if version("jaxlib").startswith("0.10.")
    else []
)
"""Older loops, which compile in half the time, and each program whole; an unknown flag would end the process."""
if WORKER:
    # One thread a worker: there are as many workers as processors.
    FLAGS.append("--xla_cpu_multi_thread_eigen=false")
os.environ["XLA_FLAGS"] = " ".join([os.environ.get("XLA_FLAGS", ""), *FLAGS])

import jax  # noqa: E402 -- reads the environment
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

# Untimed: a first call compiles, and machines are shared.
settings.register_profile("quick", deadline=None, max_examples=40)
settings.register_profile("thorough", deadline=None)
settings.load_profile("quick")

# Compiled programs are many objects that live as long as the run: to look through them often takes long.
gc.set_threshold(50_000, 20, 100)

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")


HERE = Path(__file__).parent
AS_FOR_USERS = (
    "test_ground", "test_wheel", "cli/test_fit", "reports/test_build", "checks/test_certify",
    "fitting/test_fit_table", "fitting/problem/test_problem", "fitting/solver/test_levenberg_marquardt",
    # These compute for longer than they compile:
    "exports/test_nearest", "instrument/test_aperture", "instrument/test_measurement", "instrument/test_noise",
    "stability/", "data/test_material", "metrology/test_quantities", "metrology/standards/test_tables",
    "fitting/subsurface/test_free_index",
)  # fmt: skip
"""Tests whose programs are compiled as users have them. Laws and oracles are asked of programs with few optimisations,
which take a third of the time to compile; those of fits, checks and pages,
and of programs in processes of their own, of optimised ones."""


def thorough(config):
    """Whether more is run than `make test` runs."""
    return config.option.markexpr != "not thorough"


def pytest_configure(config):
    """Properties are tried on more examples by `make thorough`."""
    settings.load_profile("thorough" if thorough(config) else "quick")


LONGEST = ("test_documentation", "test_wheel", "reports/test_chapter", "cli/test_demo")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Says how the programs of a test are compiled; `make thorough` has all of them as users have them."""
    marked = item.get_closest_marker("quick_compilation") is not None
    optimised = item.path.relative_to(HERE).as_posix().startswith(AS_FOR_USERS) and not marked
    optimised |= thorough(item.config)
    jax.config.update("jax_disable_most_optimizations", not optimised)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """The longest tests come first, so that no worker is left alone with one of them at the end."""
    items.sort(key=lambda item: not item.path.relative_to(HERE).as_posix().startswith(LONGEST))


def pytest_sessionfinish():
    """The compiled programs go with the run that made them; all that a worker made goes at once, with its process."""
    gc.freeze()  # else all of it is looked through once more, and then given back one by one: tens of seconds
    if WORKER:
        atexit.register(os._exit, 0)  # before those that are registered by now
    else:
        shutil.rmtree(PROGRAMS, ignore_errors=True)

"""All tests run in double precision, with implicit rank promotion an error; workers of one run share compiled programs."""

import os
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")
sys.path.insert(0, str(Path(__file__).parent))

RUN = os.environ.get("PYTEST_XDIST_TESTRUNUID")
if RUN:
    # One thread a worker: there are as many workers as processors.
    os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_cpu_multi_thread_eigen=false"

import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
if RUN:
    jax.config.update("jax_compilation_cache_dir", str(Path(tempfile.gettempdir()) / f"gonio-tests-{RUN}"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)


def pytest_sessionfinish(session):
    """The run's compiled programs go with the run."""
    if RUN is None and hasattr(session.config, "workerinput") is False:
        import shutil

        uid = getattr(session.config.option, "testrunuid", None)
        if uid:
            shutil.rmtree(Path(tempfile.gettempdir()) / f"gonio-tests-{uid}", ignore_errors=True)

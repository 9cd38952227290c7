"""The environment that JAX reads when it is imported: of the command line, and of the processes of a campaign."""

import os


def jax_environment() -> dict[str, str]:
    """Variables for JAX: double precision, and compiled programs that are kept for the next process.

    GONIO_NO_CACHE keeps none. What the environment says already goes before all of them.
    """
    # XLA takes two of its own tuning hints for features that this processor lacks, and writes pages about each kept
    # program that it loads (openxla/xla#44565). What really fails is raised as an exception.
    values = {"JAX_ENABLE_X64": "true", "TF_CPP_MIN_LOG_LEVEL": "3"}
    if os.environ.get("GONIO_NO_CACHE"):
        return values
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return values | {
        "JAX_COMPILATION_CACHE_DIR": os.path.join(home, "gonio", "jax"),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.05",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "0",
    }


def prepare_jax() -> None:
    """Sets these variables where the environment does not say otherwise; before JAX is imported."""
    for name, value in jax_environment().items():
        os.environ.setdefault(name, value)


def one_thread() -> dict[str, str]:
    """Variables by which XLA and linear algebra keep to one thread, for processes that are as many as processors."""
    names = ("NPROC", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
    return dict.fromkeys(names, "1")

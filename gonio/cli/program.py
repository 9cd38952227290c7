"""``gonio VERB ...``: parse, call the verb, turn a user's error into one line and exit status 2."""

import argparse
import contextlib
import gc
import importlib
import os
import sys
import threading
from typing import NoReturn

from gonio.cli.arguments import JSON, OUTPUT, add_options, refuse_json
from gonio.models.errors import GonioError, one_line
from gonio.text import printing, versions

AHEAD = "gonio-ahead"
"""The name of the threads that `gonio.fitting.fit_model` begins; that module would bring JAX with it."""

VERBS = {
    "demo": "the whole job on bundled materials, ending in a report to look at",
    "materials": "the reference materials there are",
    "models": "the models there are, with parameters, domains and sources",
    "eval": "values of a material at any directions",
    "measure": "scan a material with the simulated instrument",
    "plan": "directions, counting times and order of readings that tell most in the time there is",
    "info": "what a file holds, in any format that can be read",
    "fit": "fit a model to a table; the result is a material file",
    "check": "reciprocity, energy conservation, positivity and symmetry",
    "quantities": "albedos and reflectance factors, and where their uncertainty comes from",
    "chart": "speed against accuracy, measured here and now",
    "stress": "where each method fails, and that it says so",
    "reduce": "the coarsest table that a scene's tolerance allows",
    "report": "tables, fits, checks and pictures in one self-contained page",
    "convert": "from one format to another, with the round-trip error",
}

WITHOUT_JSON = ("demo",)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        # One line, like every other error of a user's.
        sys.stderr.write(f"gonio: {one_line(message)}; see '{self.prog} --help'.\n")
        raise SystemExit(2)


def parser(called: str | None = None) -> argparse.ArgumentParser:
    """The parser of the whole command line; only the verb that is called gets its arguments."""
    top = _Parser(
        prog="gonio",
        description="A virtual gonioreflectometer and BRDF fitting tool.",
        epilog="MATERIAL is a reference material's name, any readable file, or an expression such as "
        "'lambert(rho=0.3) + ggx(alpha=0.2, f0=0.04)'.",
    )
    top.add_argument("--version", action="store_true", help="the versions of gonio and of what it computes with")
    verbs = top.add_subparsers(dest="verb", metavar="VERB", parser_class=_Parser)
    for verb, summary in VERBS.items():
        sub = verbs.add_parser(verb, help=summary, description=summary[0].upper() + summary[1:] + ".")
        if verb == called:
            importlib.import_module(f"gonio.cli.{verb}_verb").add_arguments(sub)
            add_options(sub.add_argument, OUTPUT if verb in WITHOUT_JSON else JSON | OUTPUT)
    return top


def main(argv: list[str] | None = None) -> int:
    """Run one command; the exit status is 0 for success, 2 for bad input, else what the verb says."""
    # Imports and traces make many objects that stay: to look for cycles among them takes a tenth of a command's start.
    gc.set_threshold(100_000, 50, 100)
    words = sys.argv[1:] if argv is None else argv
    args = parser(next((w for w in words if w in VERBS), None)).parse_args(words)
    if args.version or args.verb is None:
        print(_versions() if args.version else parser().format_help())
        return 0
    verb = importlib.import_module(f"gonio.cli.{args.verb}_verb")

    try:
        _prepare_jax()
        target = getattr(args, "json", None)
        if target not in (None, "-"):
            refuse_json(args)
        with printing(args.quiet, args.verbose, target == "-"):
            return verb.run(args)
    except BrokenPipeError:
        # The reader of the output (head, less) has gone: no error, and nobody to tell.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        sys.stderr.write("gonio: interrupted.\n")
        return 130
    except GonioError as error:
        message = str(error)
    except OSError as error:
        what = error.filename or "what this command reads or prints"
        message = f"{what}: {error.strerror or error}"
    except MemoryError:
        message = "not enough memory for this; use a smaller table or fewer samples"
    message = one_line(message)
    sys.stderr.write(f"gonio: {message}{'' if message.endswith(('.', '?')) else '.'}\n")
    return 2


def _versions() -> str:
    of = versions("jax", "jaxlib", "equinox", "optimistix", "lineax", "numpy", "scipy", "h5py")
    gonio, python = of.pop("gonio"), of.pop("python")
    return f"gonio {gonio}\nPython {python}, {', '.join(f'{name} {version}' for name, version in of.items())}"


INTERNAL_ERROR = 70
"""Exit status of a fault of the program itself (EX_SOFTWARE of sysexits.h)."""


def command() -> None:
    """The program: `main`, and its exit status without waiting for what is still being compiled ahead.

    Waiting would make every refusal as slow as a fit, and an interpreter that ends while XLA compiles aborts.
    """
    try:
        status = main()
    except Exception as error:
        # A fault of gonio's own: its status must not be taken for a verdict (1: fail), nor for a refused input (2).
        if os.environ.get("GONIO_DEBUG"):
            raise
        why = one_line((str(error).splitlines() or [""])[0], 200)
        sys.stderr.write(
            f"gonio: this is a fault of gonio ({type(error).__name__}: {why}); please report it with the"
            " command and its files. GONIO_DEBUG=1 shows where it is.\n"
        )
        status = INTERNAL_ERROR
    if any(t.name == AHEAD for t in threading.enumerate()):
        with contextlib.suppress(OSError):
            sys.stdout.flush()
        os._exit(status)
    raise SystemExit(status)


def _prepare_jax() -> None:
    # Read by JAX when it is imported, which the verbs do only if they need it. Double precision is the default of the
    # command line; the compilation cache saves a user's second run from compiling again.
    os.environ.setdefault("JAX_ENABLE_X64", "true")
    # XLA takes two of its own tuning hints for features that this processor lacks, and writes pages about each kept
    # program that it loads (openxla/xla#44565). What really fails is raised as an exception.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    if os.environ.get("GONIO_NO_CACHE"):
        return
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", os.path.join(home, "gonio", "jax"))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.05")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "0")

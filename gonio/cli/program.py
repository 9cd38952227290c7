"""``gonio VERB ...``: parse, call the verb, turn a user's error into one line and exit status 2."""

import argparse
import contextlib
import gc
import importlib
import os
import re
import shutil
import signal
import sys
import textwrap
from collections.abc import Callable, Sequence
from types import FrameType, ModuleType
from typing import NoReturn

from gonio.cli.arguments import JSON, OUTPUT, add_options, refuse_json
from gonio.cli.encoding import print_what_can_be_encoded
from gonio.cli.examples import EXAMPLES
from gonio.cli.streams import refuse_stream, standard_streams
from gonio.environment import prepare_jax
from gonio.models.errors import GonioError, nearest, one_line
from gonio.text import printing, versions

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
    "campaign": "many subjects measured, fitted, checked and reported, on many processors",
    "chart": "speed against accuracy, measured here and now",
    "stress": "where each method fails, and that it says so",
    "reduce": "the coarsest table that a scene's tolerance allows",
    "report": "tables, fits, checks and pictures in one self-contained page",
    "convert": "from one format to another, or for a renderer, with the error",
    "completion": "the script by which bash, zsh or fish complete verbs, options and names on TAB",
}
WITHOUT_JSON = ("demo", "completion")
WIDTH = 80
"""Columns of a help text, at most."""
FIRST_STEPS = """\
usage: gonio VERB ...    'gonio --help' lists the verbs, 'gonio VERB --help' tells all of one

Three commands to try first:
  gonio demo                                               # the whole job, ending in a page to look at
  gonio eval 'ggx(alpha=0.2)' --theta-i 30 --theta-o 0:80:10
  gonio check gold
"""

CUT_OFF = 141
"""Exit status where the reader of the output went away: 128 and the number of SIGPIPE, as a shell has it."""


class Terminated(KeyboardInterrupt):
    """SIGTERM came."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        # One line, like every other error of a user's.
        message = one_line(message)
        sys.stderr.write(f"gonio: {message}{'' if message.endswith(('.', '?')) else ';'} see '{self.prog} --help'.\n")
        raise SystemExit(2)

    def require_known(self, words: Sequence[str]) -> None:
        """Ends with the nearest option where there is no such one: a missing argument is often a misspelled one."""
        known = set(re.findall(r"^ +(?:-\w[^-]*, )?(--[a-z][\w-]*)", self.format_help(), re.MULTILINE))
        for word in words:
            option = word.partition("=")[0]
            if word == "--":
                return
            if re.fullmatch(r"--[a-zA-Z][\w-]*", option) and not any(k.startswith(option) for k in known):
                self.error(f"unknown option '{option}'; {nearest(option, known)}")


class _Help(argparse.RawDescriptionHelpFormatter):
    """Of one style for all verbs, no wider than `WIDTH`."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=min(shutil.get_terminal_size().columns, WIDTH) - 2)


def parser(called: str | None = None) -> argparse.ArgumentParser:
    """The parser of the whole command line; only the verb that is called gets its arguments."""
    return _parsers(called)[0]


def _parsers(called: str | None) -> tuple[_Parser, _Parser]:
    """The whole command line's, and that of the verb that is called."""
    material = "MATERIAL is a reference material's name, any readable file, or an expression such as "
    top = _Parser(
        prog="gonio",
        description="A virtual gonioreflectometer and BRDF fitting tool.",
        epilog=textwrap.fill(f"{material}'lambert(rho=0.3) + ggx(alpha=0.2, f0=0.04)'.", WIDTH - 2),
        formatter_class=_Help,
    )
    top.add_argument("--version", action="store_true", help="the versions of gonio and of what it computes with")
    verbs = top.add_subparsers(dest="verb", metavar="VERB", parser_class=_Parser)
    of_verb = top
    for verb, summary in VERBS.items():
        description = summary[0].upper() + summary[1:] + "."
        sub = verbs.add_parser(verb, help=summary, description=description, formatter_class=_Help)
        if verb == called:
            importlib.import_module(f"gonio.cli.verbs.{verb}_verb").add_arguments(sub)
            add_options(sub.add_argument, OUTPUT if verb in WITHOUT_JSON else JSON | OUTPUT)
            sub.description = textwrap.fill(sub.description or description, WIDTH - 2)
            sub.epilog = "\n".join(["examples:", *(f"  {line}" for line in EXAMPLES[verb])])
            of_verb = sub
    return top, of_verb


def main(argv: list[str] | None = None) -> int:
    """Run one command; the exit status is 0 for success, 2 for bad input, else what the verb says."""
    # Imports and traces make many objects that stay: to look for cycles among them takes a tenth of a command's start.
    gc.set_threshold(400_000, 50, 100)
    words = sys.argv[1:] if argv is None else argv
    if not words:
        sys.stdout.write(FIRST_STEPS)
        return 0
    args = parsed(words)
    if args.version or args.verb is None:
        print(_versions() if args.version else parser().format_help())
        return 0
    try:
        return _run(args)
    except BrokenPipeError:
        # The reader of the output (head, less) has gone: nobody to tell, and no verdict that a script could go by.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CUT_OFF
    except KeyboardInterrupt as interruption:
        kept: Callable[[argparse.Namespace], str] = getattr(_module(args), "kept", lambda args: "nothing was written")
        return _interrupted(interruption, kept(args))
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


def run_words(words: Sequence[str]) -> int:
    """The exit status of a command that another one runs; what goes wrong is left to that one's `main`."""
    return _run(parsed(words))


def _module(args: argparse.Namespace) -> ModuleType:
    return importlib.import_module(f"gonio.cli.verbs.{args.verb}_verb")


def _run(args: argparse.Namespace) -> int:
    verb = _module(args)
    prepare_jax()
    target = getattr(args, "json", None)
    if target not in (None, "-"):
        refuse_json(args)
    ending = getattr(verb, "streamed", None if args.verb == "eval" else refuse_stream)
    with printing(args.quiet, args.verbose, target == "-"), standard_streams(args, ending):
        return verb.run(args)


def parsed(words: Sequence[str]) -> argparse.Namespace:
    """The arguments of a command line; ends with one line and status 2 where it is none."""
    words = _with_negative_ranges(words)
    called = next((w for w in words if w in VERBS), None)
    top, of_verb = _parsers(called)
    first = next((w for w in words if not w.startswith("-")), None)
    if first is not None and first not in VERBS:
        top.error(f"unknown verb '{first}'; {nearest(first, VERBS)}")
    if any(w.startswith("--") for w in words):
        of_verb.require_known(words)
    return top.parse_args(words)


def _with_negative_ranges(words: Sequence[str]) -> list[str]:
    """Words of which -80:80:10 after an option is its value, where argparse would take it for another option."""
    joined: list[str] = []
    for word in words:
        if joined and re.fullmatch(r"--[a-z][\w-]*", joined[-1]) and re.match(r"-\.?\d", word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def _interrupted(interruption: KeyboardInterrupt, kept: str) -> int:
    """Says in a line what is left of the work; the exit status of a process that the signal ends."""
    by, status = ("terminated", 143) if isinstance(interruption, Terminated) else ("interrupted", 130)
    with contextlib.suppress(OSError):
        sys.stderr.write(f"gonio: {by}; {kept}.\n")
    return status


def _versions() -> str:
    of = versions("jax", "jaxlib", "equinox", "optimistix", "lineax", "numpy", "scipy", "h5py")
    gonio, python = of.pop("gonio"), of.pop("python")
    return f"gonio {gonio}\nPython {python}, {', '.join(f'{name} {version}' for name, version in of.items())}"


INTERNAL_ERROR = 70
"""Exit status of a fault of the program itself (EX_SOFTWARE of sysexits.h)."""


def command() -> NoReturn:
    """The program: `main`, and its exit status."""
    if "_ARGCOMPLETE" in os.environ:
        from gonio.cli.completing import complete

        complete(VERBS, parser)
    signal.signal(signal.SIGTERM, _terminate)
    print_what_can_be_encoded()
    try:
        status = main()
    except KeyboardInterrupt as interruption:
        status = _interrupted(interruption, "nothing was written")
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
    _end(status)


def _end(status: int) -> NoReturn:
    """Ends the process at once, when what it printed is on its way.

    Python would take half a second to take JAX's modules down, and wait for what is still being compiled ahead: an
    interpreter that ends while XLA compiles aborts. With GONIO_DEBUG it ends as Python does, for a profiler's sake.
    """
    if os.environ.get("GONIO_DEBUG"):
        raise SystemExit(status)
    try:
        if sys.stdout is not None:  # as it is where the caller closed it
            sys.stdout.flush()
    except BrokenPipeError:
        status = CUT_OFF
    except OSError as error:
        with contextlib.suppress(OSError):
            sys.stderr.write(f"gonio: standard output: {error.strerror or error}.\n")
        status = 2
    with contextlib.suppress(OSError, AttributeError):
        sys.stderr.flush()
    os._exit(status)


def _terminate(number: int, frame: FrameType | None) -> None:
    raise Terminated

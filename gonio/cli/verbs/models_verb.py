"""``gonio models``: the models that an expression may name, with parameters, domains and sources."""

import argparse
import inspect
from typing import Any

from gonio.cli.arguments import FORCE, add_options, write_json
from gonio.models.errors import GonioError, nearest
from gonio.text import columns, show


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", help="show one model whole")
    picture = "write a small picture of the model's lobe, at its usual values (png, svg, pdf)"
    add_options(parser.add_argument, {"--picture FILE": picture} | FORCE)


def run(args: argparse.Namespace) -> int:
    from gonio.models.catalog import MODELS
    from gonio.models.subsurface.catalog import BSSRDFS

    known: list[str] = [*MODELS, *BSSRDFS]
    if args.name and args.name not in known:
        raise GonioError(f"Unknown model '{args.name}'; {nearest(args.name, known)}")
    if args.picture and not args.name:
        raise GonioError("--picture shows one model; name it, as in 'gonio models ggx --picture ggx.png'")
    if args.picture:  # before anything is printed, so that a refusal stands alone
        from gonio.figures.plots import write_lobe
        from gonio.models.expression.builder import example

        write_lobe(example(args.name).strip("'"), args.picture, args.force)
    names: list[str] = [args.name] if args.name else known
    facts = {name: _facts(name) for name in names}
    show("\n".join(line for name in facts for line in _lines(name, facts[name], whole=bool(args.name))))
    if args.name:
        written = [f"    written: {args.picture}"] if args.picture else []
        show("\n".join([*_laws(args.name, facts[args.name]), *written]))
    else:
        show("\nThe last three are light below the surface (BSSRDF); see 'gonio measure --help'.")
        show("Sums and factors: 'lambert(rho=0.3) + 0.5 * ggx(alpha=0.2, f0=0.04)'; a list means channels.")
        show("No Fresnel parameter means F = 1, f0 Schlick's, eta (with k) the exact one.")
        show("'gonio models NAME' shows one whole.")
    return write_json(args, {"models": facts})


def _lines(name: str, facts: dict[str, Any], whole: bool) -> list[str]:
    """A model's sentence, the rest of its docstring if it is shown whole, and its parameters and options."""
    first, _, rest = facts["doc"].partition("\n")
    rows = [[f"    {p}", v["domain"], v["unit"], v["doc"]] for p, v in facts["parameters"].items()]
    rows += [[f"    {o}", " | ".join(c), "", "option"] for o, c in facts["options"].items()]
    text = inspect.cleandoc(rest).strip() if whole else ""
    return [f"{name}: {first}", *([text] if text else []), *([columns(rows)] if rows else [])]


def _laws(name: str, facts: dict[str, Any]) -> list[str]:
    from gonio.models.expression.builder import example

    lines = [f"    breaks {law}: {how}" for law, how in facts["breaks"].items()]
    lines += [f"    loses: {facts['loses']}"] if facts["loses"] else []
    lines += [f"    limits: {facts['limits']}"] if "limits" in facts else []
    return [*lines, f"    example: {example(name)}"]


def _facts(name: str) -> dict[str, Any]:
    from gonio.models.catalog import MODELS
    from gonio.models.expression.builder import build, example
    from gonio.models.expression.parser import options_of
    from gonio.models.parameters import parameters_of
    from gonio.models.subsurface.catalog import BSSRDFS

    below = name in BSSRDFS
    kind = BSSRDFS[name] if below else MODELS[name]
    # Which laws a model violates may depend on its options: those of its example stand for it.
    usual = build(example(name).strip("'"))
    return {
        "breaks": dict(usual.violates),
        "loses": usual.loses_energy,
        "doc": inspect.getdoc(kind) or "",
        "parameters": {
            p: {"domain": f"[{i.low:g}, {i.high:g}]", "low": i.low, "high": i.high, "unit": i.unit, "doc": i.doc}
            for p, i in parameters_of(kind).items()
        },
        "options": {o: list(c) for o, c in options_of(kind).items()},
    } | ({"limits": BSSRDFS[name].limits} if below else {})

"""``gonio models``: what can be spelled, with parameters, domains and sources."""

import argparse
import inspect


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", help="show one model whole")
    parser.add_argument("--json", action="store_true", help="machine-readable")
    parser.add_argument(
        "--picture",
        metavar="FILE",
        help="write a small picture of the model's lobe, at its usual values (png, svg, pdf)",
    )
    parser.add_argument("--force", action="store_true", help="replace an existing picture")


def run(args: argparse.Namespace) -> int:
    from gonio.models.catalog import MODELS
    from gonio.models.errors import GonioError, nearest
    from gonio.models.expression.builder import example
    from gonio.text import columns, say

    if args.name and args.name not in MODELS:
        raise GonioError(f"Unknown model '{args.name}'; {nearest(args.name, MODELS)}")
    if args.picture and not args.name:
        raise GonioError("--picture shows one model; name it, as in 'gonio models ggx --picture ggx.png'")
    written = _picture(args.name, args.picture, args.force) if args.picture else None
    names = [args.name] if args.name else list(MODELS)
    if args.json:
        import json

        say(json.dumps({n: _facts(n) for n in names}, indent=2, ensure_ascii=False))
        return 0
    for name in names:
        facts = _facts(name)
        say(f"{name}: {facts['doc'].splitlines()[0]}")
        rest = inspect.cleandoc("\n".join(facts["doc"].splitlines()[1:])).strip()
        if args.name and rest:
            say(rest)
        rows = [[f"    {p}", v["domain"], v["unit"], v["doc"]] for p, v in facts["parameters"].items()]
        rows += [[f"    {o}", " | ".join(c), "", "option"] for o, c in facts["options"].items()]
        if rows:
            say(columns(rows))
        if args.name:
            for law, how in facts["breaks"].items():
                say(f"    breaks {law}: {how}")
            if facts["loses"]:
                say(f"    loses: {facts['loses']}")
            say(f"    example: {example(name)}")
        if written:
            say(f"    written: {written}")
    if not args.name:
        say("\nSums and factors: 'lambert(rho=0.3) + 0.5 * ggx(alpha=0.2, f0=0.04)'; a list means channels.")
        say("No Fresnel parameter means F = 1, f0 Schlick's, eta (with k) the exact one.")
        say("'gonio models NAME' shows one whole.")
    return 0


def _picture(name: str, path: str, force: bool):
    # Before anything is said, so that a refusal stands alone.
    from gonio.models.expression.builder import build, example
    from gonio.reports.lobe_picture import lobe_picture

    said = example(name).strip("'")
    return lobe_picture(build(said), said, path, force)


def _facts(name: str) -> dict:
    from gonio.models.catalog import MODELS
    from gonio.models.expression.builder import build, example
    from gonio.models.expression.parser import options_of
    from gonio.models.parameters import parameters_of

    # What a model breaks may depend on its options: those of its example speak for it.
    usual = build(example(name).strip("'"))
    return {
        "breaks": dict(usual.violates),
        "loses": usual.loses_energy,
        "doc": inspect.getdoc(MODELS[name]) or "",
        "parameters": {
            p: {"domain": f"[{i.low:g}, {i.high:g}]", "low": i.low, "high": i.high, "unit": i.unit, "doc": i.doc}
            for p, i in parameters_of(MODELS[name]).items()
        },
        "options": {o: list(c) for o, c in options_of(MODELS[name]).items()},
    }

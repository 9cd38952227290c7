"""``gonio materials``: the reference materials, each with its model and where its numbers come from."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", help="show one material whole, as its file")
    parser.add_argument("--json", action="store_true", help="machine-readable")


def run(args: argparse.Namespace) -> int:
    from gonio.data.material import material_text, reference_materials
    from gonio.data.subject import load_material
    from gonio.models.errors import GonioError, nearest
    from gonio.text import columns, say

    known = reference_materials()
    if args.name and args.name not in known:
        raise GonioError(f"Unknown reference material '{args.name}'; {nearest(args.name, known)}")
    if args.name and not args.json:
        say(material_text(load_material(args.name)).rstrip())
        return 0
    found = [load_material(n) for n in ([args.name] if args.name else known)]
    if args.json:
        import json

        facts = [
            {
                "name": m.name,
                "description": m.description,
                "model": m.expression,
                "channels": m.channels.names,
                "source": m.source,
            }
            for m in found
        ]
        say(json.dumps(facts, indent=2, ensure_ascii=False))
        return 0
    say(columns([[m.name, _channels(m), m.description] for m in found], ["material", "channels", "what it is"]))
    say("\n'gonio materials NAME' shows one whole, with its model and its source.")
    return 0


def _channels(m) -> str:
    if m.channels.wavelengths_nm is not None:
        w = m.channels.wavelengths_nm
        return f"{len(w)}: {w[0]:g}–{w[-1]:g} nm" if len(w) > 1 else f"{w[0]:g} nm"
    return ",".join(m.channels.names)

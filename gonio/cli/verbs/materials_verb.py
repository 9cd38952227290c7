"""``gonio materials``: the reference materials, each with its model and where its numbers come from."""

import argparse
from typing import TYPE_CHECKING

from gonio.cli.arguments import FORCE, add_options, write_json
from gonio.models.errors import GonioError, nearest
from gonio.text import columns, show

if TYPE_CHECKING:
    from gonio.data.table import Channels


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", help="show one material whole, as its file")
    add_options(parser.add_argument, FORCE)


def run(args: argparse.Namespace) -> int:
    from gonio.data.formats.material_file import material_text
    from gonio.data.subject import load_material, reference_materials

    known = reference_materials()
    if args.name and args.name not in known:
        raise GonioError(f"Unknown reference material '{args.name}'; {nearest(args.name, known)}")
    materials = [load_material(n) for n in ([args.name] if args.name else known)]
    if args.name:
        show(material_text(materials[0]).rstrip())
    else:
        rows = [[m.name, _channels(m.channels), m.description] for m in materials]
        show(columns(rows, ["material", "channels", "what it is"]))
        show("\n'gonio materials NAME' shows one whole, with its model and its source.")
    names = {"name": "name", "description": "description", "model": "expression", "source": "source"}
    facts = [{k: getattr(m, v) for k, v in names.items()} | {"channels": m.channels.names} for m in materials]
    return write_json(args, {"materials": facts})


def _channels(channels: "Channels") -> str:
    w = channels.wavelengths_nm
    if not w:
        return ",".join(channels.names)
    return f"{len(w)}: {w[0]:g}–{w[-1]:g} nm" if w[1:] else f"{w[0]:g} nm"

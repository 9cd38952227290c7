"""``gonio info``: what a file holds, in any format that can be read."""

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any, cast

from gonio.cli.arguments import FORCE, READING, add_options, reading_options, write_json
from gonio.models.display import listed
from gonio.models.errors import GonioError
from gonio.text import columns, show

if TYPE_CHECKING:
    from gonio.data.material import Material
    from gonio.data.profile import Profile
    from gonio.data.table import Table

SENTENCES = ("comments", "understood", "warnings", "assumptions", "totals")
"""Lists of the provenance that hold sentences."""
MOST_CHANNELS = 12
"""Names of channels that are printed; of more, the first ones and the last."""
FIT_FACTS = ("converged", "reason", "loss", "samples", "starts_agreed", "starts")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    file = "a table (gonio's HDF5, CSV, and the formats of the README), a material file, or published fits"
    parser.add_argument("files", metavar="FILE", nargs="+", help=f"{file}; of several each gets a line")
    add_options(parser.add_argument, READING | FORCE)


def run(args: argparse.Namespace) -> int:
    if len(args.files) == 1:
        facts = _facts(args.files[0], args)
        show(columns([[k, line] for k, v in facts.items() for line in _lines(k, v)]))
        return write_json(args, facts)
    every: list[dict[str, Any]] = []
    for file in args.files:
        try:
            every.append({"file": file, **_facts(file, args)})
        except GonioError as error:
            every.append({"file": file, "refused": str(error)})
    show(columns([[f["file"], *_summary(f)] for f in every], ["file", "holds", "size", "channels"]))
    for f in every:
        if "refused" in f:
            sys.stderr.write(f"gonio: {f['refused']}\n")
    return write_json(args, {"files": every}, 2 if any("refused" in f for f in every) else 0)


def _summary(facts: dict[str, Any]) -> list[str]:
    """A file in a line: what it holds, how much, and of which channels."""
    if "refused" in facts:
        return ["refused", "", ""]
    kind = " ".join([str(facts["kind"]).partition(",")[0], str(facts.get("layout", ""))]).strip()
    size = f"{facts['cells']:,} cells" if "cells" in facts else facts.get("model") or facts.get("names")
    channels = facts.get("channels", "")
    return [kind, str(size or "")[:50], channels if isinstance(channels, str) else listed(channels)]


def _facts(name: str, args: argparse.Namespace) -> dict[str, Any]:
    from gonio.data.formats.registry import load, sniff, split_entry
    from gonio.data.profile_files import holds_profile, open_profile
    from gonio.data.table import Table

    file, entry = split_entry(name)
    if holds_profile(file):
        return _profile(open_profile(file))
    entries = sniff(file).entries
    if entry is None and entries is not None:
        names = entries(file)
        return {"kind": sniff(file).name, "file": file, "materials": len(names), "names": ", ".join(names)}
    content = load(name, **reading_options(args))
    return _table(content) if isinstance(content, Table) else _material(content)


def _lines(name: str, value: Any) -> list[str]:
    """A fact in words; of sentences one each."""
    if isinstance(value, list) and name.startswith("provenance"):
        words = [str(v) for v in cast("list[object]", value)]
        return words if name.endswith(SENTENCES) else [", ".join(words)] if words else []
    if name == "channels" and isinstance(value, list) and len(names := cast("list[object]", value)) > MOST_CHANNELS:
        return [f"{len(names)}: {listed(names)}"]
    return [value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)]


def _profile(p: "Profile") -> dict[str, Any]:
    facts = {"kind": "profile of light below a surface, R by the distance"} | p.facts()
    return facts | {f"provenance: {k}": v for k, v in p.provenance.items()}


def _material(m: "Material") -> dict[str, Any]:
    from gonio.models.expression.builder import to_expression

    facts = {"kind": "material", "name": m.name, "description": m.description}
    facts |= {"model": m.expression or to_expression(m.brdf), "channels": list(m.channels.names), "source": m.source}
    fit = m.meta.get("fit", {})
    if not fit:
        return facts
    from gonio.fitting.judgement import judge_fit

    known = {k: fit[k] for k in FIT_FACTS if k in fit} | fit.get("metrics", {})
    return facts | {"fit": judge_fit(fit).sentence} | {f"fit {k}": v for k, v in known.items()}


def _table(t: "Table") -> dict[str, Any]:
    import numpy as np

    from gonio.models.geometry.sides import sides_in_words

    facts: dict[str, Any] = {"kind": "table", "name": t.name, "layout": t.layout.name, "cells": t.layout.size}
    facts["dimensions"] = ", ".join(f"{n} {s}" for n, s in zip(t.layout.dims, t.layout.shape, strict=True))
    for name, axis in t.layout.axes.items():
        a = np.degrees(axis)
        facts[f"{name} (degrees)"] = f"{a.min():.6g} to {a.max():.6g}, {np.unique(a).size} values"
    facts["hemispheres"] = sides_in_words(t.sides) or "reflection"
    facts["channels"] = list(t.channels.names)
    counts = t.counts()
    facts["readings"] = ", ".join(f"{v} {k.replace('_', ' ')}" for k, v in counts.items() if v and k != "cells")
    facts["negative readings"] = counts["negative"]
    facts["uncertainty"] = t.uncertainty()
    for name, sr in (("source", t.source_solid_angle), ("receiver", t.receiver_solid_angle)):
        facts[f"{name} solid angle"] = "not stated" if sr is None else f"{sr:.6g} sr"
    return facts | {f"provenance: {k}": v for k, v in t.provenance.items()}

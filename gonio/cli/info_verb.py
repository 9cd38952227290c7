"""``gonio info``: what a file holds, in any format that can be read."""

import argparse
import json
from typing import TYPE_CHECKING, Any, cast

from gonio.cli.arguments import FORCE, READING, add_options, reading_options, write_json
from gonio.text import columns, show

if TYPE_CHECKING:
    from gonio.data.material import Material
    from gonio.data.profile import Profile
    from gonio.data.table import Table

SENTENCES = ("comments", "understood", "warnings", "assumptions", "totals")
"""Lists of the provenance that hold sentences."""
FIT_FACTS = ("converged", "reason", "loss", "samples", "starts_agreed", "starts")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    file = "a table (HDF5, MERL, RGL, XML of windows, NIST or plain CSV), a material file, or published fits"
    parser.add_argument("file", metavar="FILE", help=file)
    add_options(parser.add_argument, READING | FORCE)


def run(args: argparse.Namespace) -> int:
    from gonio.data.formats.registry import load, sniff, split_entry
    from gonio.data.profile_files import holds_profile, open_profile
    from gonio.data.table import Table

    file, entry = split_entry(args.file)
    profile = holds_profile(file)
    entries = None if profile else sniff(file).entries
    if entry is None and entries is not None:
        names = entries(file)
        facts = {"kind": sniff(file).name, "file": file, "materials": len(names), "names": ", ".join(names)}
    elif profile:
        facts = _profile(open_profile(file))
    else:
        content = load(args.file, **reading_options(args))
        facts = _table(content) if isinstance(content, Table) else _material(content)
    show(columns([[k, line] for k, v in facts.items() for line in _lines(k, v)]))
    return write_json(args, facts)


def _lines(name: str, value: Any) -> list[str]:
    """A fact in words; of sentences one each."""
    if isinstance(value, list) and name.startswith("provenance"):
        words = [str(v) for v in cast("list[object]", value)]
        return words if name.endswith(SENTENCES) else [", ".join(words)] if words else []
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

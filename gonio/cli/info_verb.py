"""``gonio info``: what a file holds, in any format that can be read."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file", metavar="FILE", help="a table (HDF5, MERL, RGL, NIST or plain CSV), a material file, or published fits"
    )
    parser.add_argument("--json", action="store_true", help="machine-readable")


def run(args: argparse.Namespace) -> int:
    import json
    from pathlib import Path

    from gonio.text import columns, say

    kind = Path(args.file.partition(".fit:")[0]).suffix.lower() if ".fit:" not in args.file else ".toml"
    facts = {".toml": _material, ".fit": _published}.get(kind, _table)(args.file)
    if args.json:
        say(json.dumps(facts, indent=2, ensure_ascii=False))
        return 0
    rows = [[k, v if isinstance(v, str) else json.dumps(v, ensure_ascii=False)] for k, v in facts.items()]
    say(columns(rows))
    return 0


def _published(path: str) -> dict:
    from gonio.data.formats.bbm_fits import published_names

    names = published_names(path)
    return {"kind": "published fits", "file": path, "materials": len(names), "names": ", ".join(names)}


def _material(path: str) -> dict:
    from gonio.data.subject import load_material
    from gonio.models.expression.builder import to_expression

    m = load_material(path if "/" in path or ".fit:" in path else f"./{path}")
    facts = {
        "kind": "material",
        "name": m.name,
        "description": m.description,
        "model": m.expression or to_expression(m.brdf),
    }
    facts |= {"channels": list(m.channels.names), "source": m.source}
    fit = m.meta.get("fit")
    if fit:
        facts |= {
            f"fit {k}": fit[k]
            for k in ("converged", "reason", "loss", "samples", "starts_agreed", "starts")
            if k in fit
        }
        facts |= {f"fit {k}": v for k, v in fit.get("metrics", {}).items()}
    return facts


def _table(path: str) -> dict:
    import numpy as np

    from gonio.data.formats.registry import read

    t = read(path)
    degrees = {n: np.degrees(a) for n, a in t.layout.axes.items()}
    facts = {"kind": "table", "name": t.name, "layout": t.layout.name, "cells": t.layout.size}
    facts["dimensions"] = ", ".join(f"{n} {s}" for n, s in zip(t.layout.dims, t.layout.shape, strict=True))
    facts |= {
        f"{n} (degrees)": f"{a.min():.6g} to {a.max():.6g}, {np.unique(a).size} values" for n, a in degrees.items()
    }
    facts["channels"] = list(t.channels.names)
    counts = t.counts()
    facts["readings"] = ", ".join(f"{v} {k.replace('_', ' ')}" for k, v in counts.items() if v and k != "cells")
    facts["negative readings"] = counts["negative"]
    facts["uncertainty"] = _uncertainty(t)
    for what, sr in (("source", t.source_solid_angle), ("receiver", t.receiver_solid_angle)):
        facts[f"{what} solid angle"] = "not stated" if sr is None else f"{sr:.6g} sr"
    facts |= {f"provenance: {k}": v for k, v in t.provenance.items()}
    return facts


def _uncertainty(t) -> str:
    import numpy as np

    if t.u_f is None:
        return "not stated"
    sizes, known, exact, total = [], 0, 0, 0
    for start, stop in t.blocks():
        block = t.read(start, stop)
        u = np.asarray(block.u_f)[np.asarray(block.flag) == 0]
        total += u.size
        known += int(np.count_nonzero(np.isfinite(u) & (u > 0)))
        exact += int(np.count_nonzero(u == 0))
        sizes.append(u[np.isfinite(u) & (u > 0)])
    if exact == total:
        return "0: exact"
    every = np.concatenate(sizes) if sizes else np.empty(0)
    if not every.size:
        return "unknown"
    return f"stored for {known} of {total} valid readings, median {np.median(every):.4g} 1/sr"

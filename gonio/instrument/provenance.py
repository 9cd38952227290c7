"""Provenance of a table: all that is needed to make it again, in a form that JSON can hold."""

import datetime
import hashlib
import re
from typing import Any

import jax
import numpy as np

from gonio.data.material import Material
from gonio.instrument.instrument import Systematic
from gonio.instrument.reader import Reader
from gonio.models.brdf import AbstractBRDF
from gonio.models.expression.builder import to_expression
from gonio.text import versions

LONG_TEXT = 4000


def of(reader: Reader, command: str | None) -> dict[str, Any]:
    """The provenance of a measurement that begins now. `command`: the way to ask for it on the command line."""
    material, layout = reader.material, reader.layout
    values: dict[str, Any] = {
        "material": {
            "name": material.name[:LONG_TEXT],
            # In full precision: what a person wrote may hold fewer digits than the numbers of a fit.
            "spelling": to_expression(material.brdf) if material.expression is not None else None,
            "description": material.description[:LONG_TEXT],
            "source": material.source[:LONG_TEXT],
        },
        "instrument": reader.instrument.to_dict() or "ideal",
        "scan": {"layout": layout.name, "shape": list(layout.shape)},
        "seed": reader.seed,
        "versions": versions("jax", "numpy"),
        "computed": {"platform": jax.default_backend(), "precision": str(reader.dtype)},
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    if material.meta.get("file"):
        values["material"]["file"] = str(material.meta["file"])
    if command:
        values["command"] = command[:LONG_TEXT]
    if reader.errors != Systematic():
        values["systematic"] = reader.errors.to_dict()
    return values


def recipe(provenance: dict[str, Any], material: Material) -> dict[str, Any]:
    """What determines the values, bit for bit: the provenance but for time, with the material's own numbers."""
    kept = {name: value for name, value in provenance.items() if name not in ("created", "command", "scan")}
    return kept | {"material": {"digest": digest(material.brdf)}}


def digest(brdf: AbstractBRDF) -> str:
    """A fingerprint of a model's structure and numbers."""
    leaves, structure = jax.tree.flatten(brdf)
    digester = hashlib.sha256(re.sub(r" at 0x[0-9a-f]+", "", str(structure)).encode())
    for leaf in leaves:
        values = np.asarray(leaf)
        digester.update(f"{values.dtype}{values.shape}".encode() + np.ascontiguousarray(values).tobytes())
    return digester.hexdigest()

"""How a table came about: all that is needed to make it again, in a form that JSON can hold."""

import datetime
import hashlib
import platform
import re

import jax
import numpy as np

from gonio import __version__
from gonio.data.layouts import Layout
from gonio.data.material import Material
from gonio.instrument.instrument import Instrument, Systematic, systematic_to_dict
from gonio.models.brdf import AbstractBRDF
from gonio.models.expression.builder import to_expression

LONG_TEXT = 4000


def of(
    material: Material, instrument: Instrument, errors: Systematic, layout: Layout, seed: int, command: str | None
) -> dict:
    """The provenance of a measurement that begins now. `command` is how a person asked for it."""
    told = {
        "material": {
            "name": material.name[:LONG_TEXT],
            # In full precision: what a person wrote may hold fewer digits than the numbers that a fit found.
            "spelling": to_expression(material.brdf) if material.expression is not None else None,
            "description": material.description[:LONG_TEXT],
            "source": material.source[:LONG_TEXT],
        },
        "instrument": instrument.to_dict() or "ideal",
        "scan": {"layout": layout.name, "shape": list(layout.shape)},
        "seed": seed,
        "versions": {
            "gonio": __version__,
            "jax": jax.__version__,
            "numpy": np.__version__,
            "python": platform.python_version(),
        },
        "computed": {"platform": jax.default_backend(), "precision": str(np.dtype(jax.numpy.result_type(float)))},
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    if material.meta.get("file"):
        told["material"]["file"] = str(material.meta["file"])
    if command:
        told["command"] = command[:LONG_TEXT]
    if errors != Systematic():
        told["systematic"] = systematic_to_dict(errors)
    return told


def recipe(told: dict, material: Material) -> dict:
    """What determines the values, bit for bit: the provenance but for time, with the material's own numbers."""
    kept = {name: value for name, value in told.items() if name not in ("created", "command", "scan")}
    return kept | {"material": {"digest": digest(material.brdf)}}


def digest(brdf: AbstractBRDF) -> str:
    """A fingerprint of a model's structure and numbers."""
    leaves, structure = jax.tree.flatten(brdf)
    found = hashlib.sha256(re.sub(r" at 0x[0-9a-f]+", "", str(structure)).encode())
    for leaf in leaves:
        values = np.asarray(leaf)
        found.update(f"{values.dtype}{values.shape}".encode() + np.ascontiguousarray(values).tobytes())
    return found.hexdigest()

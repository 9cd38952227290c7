"""Which channels stand for the red, green and blue of a file that holds no others."""

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from gonio.data.channels import Channels
from gonio.data.table import Table
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.data.material import Material

RGB, XYZ = ("R", "G", "B"), ("X", "Y", "Z")


def in_file_colours(source: "Table | Material", kind: str, places: tuple[str, ...]) -> tuple["Table | Material", str]:
    """(a source with its channels in the order in which a file has them, what is to be said of that).

    Args:
        source: a table or a material.
        kind: how a sentence names the format.
        places: kinds of three channels that the format has a place for, of "rgb", "xyz", "wavelengths"; empty: any
            channels.

    Raises:
        GonioError: X, Y, Z where it has no place for them; a model whose channels would have to be put in order.
    """
    names, wavelengths = source.channels.names, source.channels.wavelengths_nm
    if not places or len(names) != 3 or names == RGB or (wavelengths is not None and "wavelengths" in places):
        return source, ""
    if set(names) == set(XYZ):
        if "xyz" not in places:
            raise GonioError(
                f"{kind} holds R, G, B, and the channels are X, Y, Z; convert their values to R, G, B first"
            )
        return (source, "") if names == XYZ else (_ordered(source, XYZ, kind), "")
    if set(names) == set(RGB):
        return _ordered(source, RGB, kind), ""
    if wavelengths is None:
        return source, f"{', '.join(names)} as R, G, B"
    order = tuple(names[k] for k in np.argsort(wavelengths)[::-1])
    ordered = _ordered(source, order, kind)
    assert isinstance(ordered, Table)
    return dataclasses.replace(ordered, channels=Channels.rgb()), f"{', '.join(order)} as R, G, B"


def _ordered(source: "Table | Material", names: tuple[str, ...], kind: str) -> Table:
    if isinstance(source, Table):
        return source.only(names)
    raise GonioError(
        f"{source.name} is a model of {', '.join(source.channels.names)}, and {kind} holds R, G, B in this order; "
        f"measure it first: gonio measure '{source.name}' -o T.h5"
    )

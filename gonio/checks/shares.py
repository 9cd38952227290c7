"""The check of a large table in shares, which any processes may do, and the certificate of one check out of them.

A share is one property, or the albedos of some incidences: each depends on the table alone. So the certificate is that
of an undivided check to the bit, however energy is divided. What reads the table once and adds little is no share.
"""

import dataclasses
import json
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from gonio.checks.albedos import Incidence
from gonio.checks.certificate import Certificate, Property
from gonio.checks.certify import CheckSettings, certificate_of, judged_property
from gonio.checks.hidden_lobes import ALPHAS
from gonio.checks.properties import PROPERTIES
from gonio.checks.table.albedos.on_grid import HemisphereGrid, albedos_on, hemisphere_grid, incidences_on
from gonio.checks.table.energy import features_of
from gonio.checks.table.evidence import TableEvidence
from gonio.data.interpolation.sheets import sheet_of
from gonio.data.layouts import Layout
from gonio.data.serialise import unboxed
from gonio.data.subject import resolve_subject
from gonio.data.table import Table
from gonio.models.errors import GonioError
from gonio.models.geometry.sides import FRONT

ALONE = ("reciprocity", "symmetry")
"""Properties that compare millions of pairs, each a share; the others read the table once."""
ROWS = tuple(name for name in Incidence._fields if name != "hidden")
Arrays = dict[str, np.ndarray]
"""What a share comes to, as a file can hold it."""


class Share(NamedTuple):
    """A property; of energy the incidences `start` to `stop` of the table's grid."""

    name: str
    start: int = 0
    stop: int = 0


def shares_of(layout: Layout, channels: int, settings: CheckSettings, values: int) -> list[Share]:
    """The shares of the check of a table that `is_ordinary`; those of energy have about so many values each."""
    with_model = settings.model is not None  # reciprocity and energy then share a fit, and are judged together
    shares = [Share(name) for name in ALONE if not (with_model and name == "reciprocity")]
    grid = hemisphere_grid(layout)
    if layout.sides == FRONT and not isinstance(grid, str):
        count, each = len(grid.incidences), max(1, values // (grid.stored * channels))
        shares += [Share("energy", k, min(k + each, count)) for k in range(0, count, each)]
    return shares


def is_ordinary(table: Table) -> bool:
    """Whether the layout tells how a table is interpolated, and it is no sheet."""
    return table.interpolant is None and sheet_of(table) is None


def do_share(table: Table, share: Share, settings: CheckSettings) -> Arrays:
    """What one share of a table's check comes to."""
    table = resolve_subject(table, blockwise=True).require_table()
    if share.name != "energy":
        judged = judged_property(share.name, "table", TableEvidence(table, settings.level, settings.feature_width))
        assert judged is not None
        return {"property": np.array(json.dumps(unboxed(dataclasses.asdict(judged))))}
    features = features_of(table, settings.feature_width)
    rows = incidences_on(_grid(table), table, features, some=slice(share.start, share.stop))
    arrays = {name: np.array([getattr(row, name) for row in rows]) for name in ROWS}
    shape = ALPHAS.size, len(table.channels)
    hidden = [np.broadcast_to(row.hidden, shape) for row in rows if row.hidden is not None]
    hiding = np.array([row.hidden is not None for row in rows])
    return arrays | {"hiding": hiding, "hidden": np.array(hidden)}


def put_together(table: Table, settings: CheckSettings, shares: Iterable[tuple[Share, Arrays]]) -> Certificate:
    """The certificate of a table whose shares are done, in the order of `shares_of`; the rest is judged here."""
    judged = resolve_subject(table, blockwise=True)
    table = judged.require_table()
    there: dict[str, Property] = {}
    rows: list[Incidence] = []
    for share, arrays in shares:
        if share.name == "energy":
            rows += _incidences(arrays)
        else:
            there[share.name] = Property(**json.loads(str(arrays["property"])))
    evidence = TableEvidence(table, settings.level, settings.feature_width, model=settings.model)
    if rows:
        albedos = albedos_on(_grid(table), rows, features_of(table, settings.feature_width))
        evidence = dataclasses.replace(evidence, albedos=albedos)
    every = [there[key] if key in there else judged_property(key, "table", evidence) for key in PROPERTIES]
    return certificate_of(judged, settings, [p for p in every if p is not None])


def _grid(table: Table) -> HemisphereGrid:
    grid = hemisphere_grid(table.layout)
    if isinstance(grid, str):
        raise GonioError(f"the albedos of {table.name or 'the table'} cannot be divided: {grid}")
    return grid


def _incidences(arrays: Arrays) -> list[Incidence]:
    hidden, rows = iter(arrays["hidden"]), zip(*(arrays[name] for name in ROWS), strict=True)
    return [
        Incidence(**dict(zip(ROWS, row, strict=True)), hidden=next(hidden) if hides else None)
        for hides, row in zip(arrays["hiding"], rows, strict=True)
    ]

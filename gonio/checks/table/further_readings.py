"""Further readings of the surface of a table, such as a plan named: joined to a list, or limits of what lobes hide."""

import dataclasses
from typing import Any

import numpy as np

from gonio.checks.hidden_lobes import Features, Further
from gonio.checks.table.pairs.equal_pairs import angles_of, readings_of
from gonio.data.layouts import scattered
from gonio.data.table import Table
from gonio.models.errors import GonioError
from gonio.models.geometry.sides import FRONT


def joined(table: Table, further: Table) -> Table:
    """The readings of both tables as one list, under the name and the provenance of the first."""
    one, other = (t.as_list() if t.layout.gridded else t for t in (table, further))
    layout = scattered(*(np.concatenate(pair) for pair in zip(one.layout.angles(), other.layout.angles(), strict=True)))
    values: dict[str, Any] = {
        name: np.concatenate([np.asarray(getattr(t, name)[...]) for t in (one, other)]) for name in ("f", "flag")
    }
    uncertain = [t.u_f is not None for t in (one, other)]
    unknown = [np.full(t.shape, np.nan) if t.u_f is None else np.asarray(t.u_f[...]) for t in (one, other)]
    values["u_f"] = np.concatenate(unknown) if any(uncertain) else None
    return dataclasses.replace(one, layout=layout, interpolant=None, **values)


def require_alike(table: Table, further: Table) -> None:
    """Raises GonioError unless further readings are of the same channels, and both of reflection in front."""
    if table.interpolant is not None:
        raise GonioError(f"{table.name or 'the table'} brings its own interpolation: further readings cannot join it")
    if further.channels.names != table.channels.names:
        raise GonioError(
            f"the further readings are of {', '.join(further.channels.names)}, the table of "
            f"{', '.join(table.channels.names)}; measure the same channels"
        )
    if table.sides != FRONT or further.sides != FRONT:
        raise GonioError("further readings join tables of reflection from the front alone; check the tables apart")


def limits_of(further: Table) -> Further:
    """What a lobe may be at further readings at the most: what was read, and twice its uncertainty."""
    cells = np.arange(further.layout.size)
    f, u = readings_of(further, cells)
    use = np.isfinite(f).all(axis=1)
    f, u = f[use], np.nan_to_num(u[use])
    return Further(angles_of(further.layout, cells)[use], f, u, np.maximum(f, 0.0) + 2 * u)


def with_further(features: Features, further: Table | None) -> Features:
    """The features, with the limits of further readings."""
    return features if further is None else features._replace(further=limits_of(further))

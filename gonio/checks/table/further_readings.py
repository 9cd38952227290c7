"""Further readings of the surface of a table, such as a plan named: joined to a list, or limits of what lobes hide."""

import dataclasses
from typing import Any

import numpy as np

from gonio.checks.hidden_lobes import Features, Further
from gonio.checks.table.pairs.columns import readings_of
from gonio.checks.table.pairs.places import angles_of
from gonio.data.layouts import scattered
from gonio.data.table import MEDIA, Table
from gonio.models.errors import GonioError
from gonio.models.geometry.sides import sides_in_words

REFLECTION = "reflection"


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
    if not further.sides & table.sides:
        raise GonioError(
            f"the further readings are of {sides_in_words(further.sides) or REFLECTION}, the table is of "
            f"{sides_in_words(table.sides) or REFLECTION}: measure where the table was read"
        )
    indices = [np.divide(*t.media) for t in (table, further)]
    if MEDIA in further.provenance and not np.allclose(indices[0], indices[1], rtol=1e-3):
        raise GonioError(
            f"the further readings are of media of the ratio {indices[1].flat[0]:.4g}, the table of "
            f"{indices[0].flat[0]:.4g}; state the same media for both"
        )


def limits_of(further: Table) -> Further:
    """What a lobe may be at further readings at the most: what was read, and twice its uncertainty."""
    cells = np.arange(further.layout.size)
    f, u = readings_of(further, cells)
    use = np.isfinite(f).all(axis=1)
    f, u = f[use], np.nan_to_num(u[use])
    return Further(angles_of(further.layout, cells)[use], f, u, np.maximum(f, 0.0) + 2 * u)


class FurtherBySide:
    """Further readings, or none, by the sides of light and detector."""

    def __init__(self, further: Table | None) -> None:
        self._parts = {} if further is None else further.parts()

    def added(self, features: Features, light: int = 1, detector: int = 1) -> Features:
        """The features, with the limits of what was read further on these sides."""
        part = self._parts.get((light, detector))
        return features if part is None else features._replace(further=limits_of(part))

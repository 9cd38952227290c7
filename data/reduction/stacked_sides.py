"""A table of both sides of a sample as one of reflection, whose channels are those of each pair of sides."""

import dataclasses
from typing import Any

import numpy as np

from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.table import FOLDED, Table
from gonio.models.errors import GonioError
from gonio.models.geometry.sides import side_in_words


@dataclasses.dataclass(frozen=True)
class StackedSides:
    """The folded table; the sides of its groups of channels; and the table that it was made of."""

    table: Table
    sides: tuple[tuple[int, int], ...]
    whole: Table

    @classmethod
    def of(cls, whole: Table) -> "StackedSides":
        """GonioError where the readings of the sides are not on one grid of directions, mirrored."""
        name = whole.name or "the table"
        if whole.interpolant is not None or not whole.layout.gridded or whole.layout.in_one_plane:
            raise GonioError(
                f"{name} has readings behind the sample without a grid of both hemispheres, and such a table is not "
                "reduced; give an isotropic or spherical one"
            )
        parts = whole.parts()
        first = next(iter(parts.values()))
        for part in parts.values():
            if part.shape != first.shape or not all(
                np.allclose(part.layout.axes[n], axis, atol=1e-9) for n, axis in first.layout.axes.items()
            ):
                raise GonioError(
                    f"{name} was read at other polar angles behind the sample than in front, and a reduced grid is one "
                    "for both; measure both hemispheres by one step"
                )
        names = [f"{channel} {side_in_words(*pair)}" for pair in parts for channel in whole.channels.names]
        arrays: dict[str, Any] = {
            n: None
            if getattr(whole, n) is None
            else np.concatenate([np.asarray(getattr(p, n)[...]) for p in parts.values()], axis=-1)
            for n in ("f", "flag", "u_f")
        }
        about = whole.provenance | {FOLDED: [list(pair) for pair in parts]}
        table = dataclasses.replace(first, channels=Channels(tuple(names)), provenance=about, **arrays)
        return cls(table, tuple(parts), whole)

    def unstacked(self, table: Table) -> Table:
        """A table of such channels, reduced, as one of both sides."""
        axes, places = dict(table.layout.axes), {}
        for k, name in enumerate(("theta_i", "theta_o")):
            present, polar = {pair[k] for pair in self.sides}, axes[name]
            behind = (np.pi - polar)[::-1]
            axes[name] = np.concatenate([a for s, a in ((1, polar), (-1, behind)) if s in present])
            places[name] = {
                s: np.arange(polar.size) if s > 0 else np.arange(axes[name].size)[::-1][: polar.size] for s in present
            }
        layout, count = type(table.layout)(axes), len(self.whole.channels)
        f = np.full((*layout.shape, count), np.nan, np.asarray(table.f[:0]).dtype)
        flag = np.full(f.shape, np.uint8(Flag.BELOW_HORIZON))
        for number, (light, detector) in enumerate(self.sides):
            chosen = {"theta_i": places["theta_i"][light], "theta_o": places["theta_o"][detector]}
            index = np.ix_(*(chosen.get(n, np.arange(a.size)) for n, a in axes.items()))
            channels = slice(number * count, (number + 1) * count)
            f[index], flag[index] = table.f[..., channels], table.flag[..., channels]
        about = {k: v for k, v in table.provenance.items() if k != FOLDED}
        return dataclasses.replace(table, layout=layout, f=f, flag=flag, channels=self.whole.channels, provenance=about)

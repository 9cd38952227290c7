"""The totals that a Zemax file states (TIS) beside the integrals of its values, and its values scaled to them."""

import os
from typing import NamedTuple

import numpy as np

from gonio.data.formats.optics.grid_words import totals_in_words
from gonio.data.formats.optics.hemispherical_totals import grid_totals
from gonio.data.table import Table
from gonio.models.errors import GonioError

BY_TOTALS = "tis"
"""The scale by which each incidence has the file's TIS."""


class StatedTotals(NamedTuple):
    """The file's TIS beside the integrals of its values, (incidence and rotation, channel)."""

    theta_i: np.ndarray
    """Radians."""
    stated: np.ndarray
    ours: np.ndarray

    @classmethod
    def of(cls, table: Table, stated: np.ndarray) -> "StatedTotals":
        """Those of a table; `stated` (incidence, rotation, channel)."""
        theta_i, theta_m, phi_m, *turn = table.layout.axes.values()
        rotations = turn[0].size if turn else 1
        f = np.reshape(table.f, (theta_i.size, theta_m.size, phi_m.size, rotations, -1))
        f = np.moveaxis(f, 3, 1).reshape(-1, *f.shape[1:3], f.shape[4])
        light = np.repeat(theta_i, rotations)
        ours = grid_totals(theta_m, phi_m, f, light, bool(table.layout.mirrored_axes))
        return cls(light, stated.reshape(ours.shape), ours)

    @property
    def ratios(self) -> np.ndarray:
        """TIS over the integral; NaN where there is no TIS or nothing is scattered."""
        with np.errstate(over="ignore"):
            return np.divide(self.stated, self.ours, out=np.full_like(self.ours, np.nan), where=self.ours > 0)

    def in_words(self) -> list[str]:
        """Both, a sentence for each incidence or one for all."""
        return totals_in_words("TIS", np.degrees(self.theta_i), self.stated, self.ours)

    def unscaled(self) -> str:
        """That values were not scaled, and by how much they would be."""
        ratio = self.ratios[np.isfinite(self.ratios)]
        by = f", by {ratio.min():.4g} to {ratio.max():.4g}" if ratio.size else ""
        return (
            "values are f, 1/sr, as they stand; TIS is an integral of the file's own: --scale "
            f"{BY_TOTALS} scales each incidence to it{by}"
        )

    def scaled(self, table: Table, path: str | os.PathLike[str]) -> str:
        """Scales the values of each incidence to its TIS. Raises GonioError where the file does not have it."""
        ratio = np.where((self.ours == 0) & np.isfinite(self.stated), 1.0, self.ratios)
        if not (np.isfinite(ratio) & (ratio >= 0)).all():
            raise GonioError(
                f"{path} does not state a TIS that is a share of light for each incidence; leave --scale out"
            )
        incidences = next(iter(table.layout.axes.values())).size
        by_light = ratio.reshape(incidences, 1, 1, -1, ratio.shape[1])  # (incidence, 1, 1, rotation, channel)
        turned = table.f.ndim == by_light.ndim
        with np.errstate(over="ignore"):
            table.f = table.f * (by_light if turned else by_light[:, :, :, 0])
        return f"each incidence is scaled to the file's TIS: by {ratio.min():.4g} to {ratio.max():.4g}"

"""A profile: what leaves a translucent surface beside a spot of light, by the distance, with how it was read."""

import dataclasses
from typing import Any

import numpy as np

from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.models.display import Displayed, listed
from gonio.models.errors import GonioError, printable

LARGEST = 1e5
"""mm, of offsets and radii."""
MOST_OFFSETS = 2000


@dataclasses.dataclass(frozen=True, repr=False)
class Profile(Displayed):
    """Readings of an illuminated and a viewed spot at some offsets: R by wavelength, as spots of this size read it.

    Attributes:
        offsets: (n,) from the illuminated to the viewed spot, mm, along a line; of opposite signs the spots change
            places.
        value: (n, channels), π times the radiance over the flux, both along the normal, mean of the viewed spot, 1/mm².
        u: standard uncertainties of the expected readings, of the same shape (NaN unknown, 0 exact).
        flag: uint8 `Flag`, of the same shape.
        channels: names and wavelengths of the last dimension.
        illuminated_radius, viewed_radius: mm, 0 for points.
        provenance: how it came about; anything that JSON can hold.
        name: what a person calls it.

    Raises:
        GonioError: shapes disagree, lengths out of range, and what is no reading but flagged as one.
    """

    offsets: np.ndarray
    value: np.ndarray
    u: np.ndarray
    flag: np.ndarray
    channels: Channels
    illuminated_radius: float = 0.0
    viewed_radius: float = 0.0
    provenance: dict[str, Any] = dataclasses.field(default_factory=dict)
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", printable(self.name))
        shape = (self.offsets.size, len(self.channels))
        if any(a.shape != shape for a in (self.value, self.u, self.flag)) or self.offsets.ndim != 1:
            raise GonioError(f"a profile of {shape[0]} offsets and {shape[1]} channels has values of another shape")
        check_lengths(self.offsets, self.illuminated_radius, self.viewed_radius)
        valid = self.valid
        if (self.flag > max(Flag)).any() or not np.isfinite(self.value[valid]).all():
            raise GonioError("a profile holds readings flagged valid that are no numbers, or flags that are none")
        if ((self.u < 0) | np.isinf(self.u))[valid].any():
            raise GonioError("a profile has negative or infinite uncertainties; give 0 for exact, NaN for unknown")

    @property
    def valid(self) -> np.ndarray:
        """Which readings (n, channels) are there."""
        return self.flag == Flag.VALID

    def facts(self) -> dict[str, str]:
        """Offsets, spots, channels and uncertainty."""
        radii = self.illuminated_radius, self.viewed_radius
        spots = [f"{kind}: {f'{r:g} mm' if r else 'a point'}" for kind, r in zip(("lit", "viewed"), radii, strict=True)]
        sides = " on both sides" if (self.offsets < 0).any() and (self.offsets > 0).any() else ""
        distance = np.abs(self.offsets)
        return {
            "name": self.name,
            "offsets": f"{self.offsets.size}, {distance.min():g} to {distance.max():g} mm{sides}",
            "spots": ", ".join(spots),
            "channels": f"{len(self.channels)}: {listed(self.channels.names)}",
            "readings": f"{np.count_nonzero(self.valid)} valid of {self.value.size}",
            "uncertainty": self.uncertainty(),
        }

    def uncertainty(self) -> str:
        """What is known of the noise, in words."""
        u, valid = self.u[self.valid], np.abs(self.value[self.valid])
        if not u.size or np.isnan(u).all():
            return "not stated"
        if not np.nan_to_num(u).any():
            return "exact"
        return f"median {np.nanmedian(u / np.maximum(valid, 1e-300)):.2g} of a reading"


def check_lengths(offsets: np.ndarray, illuminated_radius: float, viewed_radius: float) -> None:
    """Raises GonioError for offsets and radii, mm, that no instrument has."""
    if not 0 < offsets.size <= MOST_OFFSETS:
        raise GonioError(f"{offsets.size} offsets came; give from 1 to {MOST_OFFSETS}")
    if not (np.abs(offsets) <= LARGEST).all():
        raise GonioError(f"an offset is no number or beyond {LARGEST:g} mm; give distances in mm")
    for what, radius in (("illuminated", illuminated_radius), ("viewed", viewed_radius)):
        if not 0 <= radius <= LARGEST:
            raise GonioError(f"the {what} radius is {radius:g} mm; give from 0 (a point) to {LARGEST:g}")

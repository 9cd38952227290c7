"""The channels of a table or a material: names, and wavelengths where they are monochromatic."""

import dataclasses
from collections.abc import Iterable

from gonio.models.display import listed
from gonio.models.errors import GonioError


@dataclasses.dataclass(frozen=True)
class Channels:
    """Names of the channels and, where they are monochromatic, their wavelengths in nm."""

    names: tuple[str, ...]
    wavelengths_nm: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(str(n) for n in self.names))
        if not self.names:
            raise GonioError("a table has no channel; name at least one")
        if self.wavelengths_nm is not None:
            object.__setattr__(self, "wavelengths_nm", tuple(float(w) for w in self.wavelengths_nm))
            if len(self.wavelengths_nm) != len(self.names):
                raise GonioError(
                    f"{len(self.names)} channels have {len(self.wavelengths_nm)} wavelengths; give one each"
                )

    def __len__(self) -> int:
        return len(self.names)

    def __repr__(self) -> str:
        return f"Channels({listed(self.names)})"

    @classmethod
    def grey(cls) -> "Channels":
        """A single channel of no stated wavelength."""
        return cls(("grey",))

    @classmethod
    def rgb(cls) -> "Channels":
        """Red, green, blue."""
        return cls(("R", "G", "B"))

    @classmethod
    def of_wavelengths(cls, wavelengths_nm: Iterable[float]) -> "Channels":
        """One monochromatic channel for each wavelength, nm."""
        wavelengths = tuple(wavelengths_nm)
        return cls(tuple(f"{w:g} nm" for w in wavelengths), wavelengths)

    @classmethod
    def of_count(cls, count: int) -> "Channels":
        """Channels of which only the number is known: grey, RGB if three, else numbered from 1."""
        return {1: cls.grey, 3: cls.rgb}.get(count, lambda: cls(tuple(f"channel {k + 1}" for k in range(count))))()

"""The channels of a table or a material: names, and wavelengths where they are monochromatic."""

import collections
import dataclasses
import math
from collections.abc import Iterable

from gonio.models.display import listed
from gonio.models.errors import GonioError, one_line

LONGEST_NAME = 200
"""Characters of a name, of a channel or of a table."""


@dataclasses.dataclass(frozen=True)
class Channels:
    """Names of the channels and, where they are monochromatic, their wavelengths in nm.

    Raises GonioError for no channel, names that are doubled, and wavelengths that are none.
    """

    names: tuple[str, ...]
    wavelengths_nm: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(one_line(str(n), LONGEST_NAME) for n in self.names))
        if not self.names:
            raise GonioError("a table has no channel; name at least one")
        if len(set(self.names)) < len(self.names):
            name, count = collections.Counter(self.names).most_common(1)[0]
            raise GonioError(f"{count} channels are called {name!r}; give each a name of its own")
        if self.wavelengths_nm is not None:
            object.__setattr__(self, "wavelengths_nm", tuple(float(w) for w in self.wavelengths_nm))
            if len(self.wavelengths_nm) != len(self.names):
                raise GonioError(
                    f"{len(self.names)} channels have {len(self.wavelengths_nm)} wavelengths; give one each"
                )
            for w in self.wavelengths_nm:
                if not 0 < w < math.inf:
                    raise GonioError(f"a channel has the wavelength {w:g} nm; give lengths above 0, in nm")

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
        names = [f"{w:g} nm" for w in wavelengths]
        if len(set(names)) < len(names):  # closer to each other than six digits tell
            names = [f"{w!r} nm" for w in map(float, wavelengths)]
        return cls(tuple(names), wavelengths)

    @classmethod
    def of_count(cls, count: int) -> "Channels":
        """Channels of which only the number is known: grey, RGB if three, else numbered from 1."""
        return {1: cls.grey, 3: cls.rgb}.get(count, lambda: cls(tuple(f"channel {k + 1}" for k in range(count))))()

"""The numbers of the experiments: every one may be changed, on the command line, in a file, or from Python."""

import dataclasses
import math
import os
from typing import Any

from gonio.data.files import read_toml
from gonio.models.errors import GonioError, nearest

LARGEST = 1 << 16


def number(default: float, unit: str, doc: str, low: float, high: float) -> Any:
    """A field that holds a number of a domain, with its unit and meaning."""
    return dataclasses.field(default=default, metadata={"unit": unit, "doc": doc, "low": low, "high": high})


def text(default: str, doc: str) -> Any:
    """A field that holds a material."""
    return dataclasses.field(default=default, metadata={"unit": "", "doc": doc})


@dataclasses.dataclass(frozen=True)
class Numbers:
    """What a student may change; angles in degrees. Raises GonioError for a number out of its domain."""

    seed: float = number(1, "1", "of all random numbers", 0, 2**32)
    rays: float = number(200_000, "1", "random rays of each experiment with light alone", 100, 1e7)
    patch_side: float = number(0.2, "m", "side of the square patch", 1e-3, 100)
    patch_distance: float = number(1.0, "m", "from the eye to its middle", 1e-2, 100)
    patch_tilt: float = number(30, "deg", "of its normal from the line of sight", 0, 89)
    radiance: float = number(100, "W/(m² sr)", "of the luminous hemisphere and of the lamp", 1e-6, 1e12)
    cap: float = number(30, "deg", "half-angle of a luminous cap", 0.1, 90)
    aperture: float = number(0.05, "m", "radius of both apertures", 1e-4, 10)
    distance: float = number(1.0, "m", "of the apertures, then twice and four times that", 1e-2, 1e3)
    material: str = text("lambert(rho=0.3) + 0.3 * ggx(alpha=0.2)", "whose BRDF is measured")
    theta_i: float = number(30, "deg", "of the lamp", 0, 89)
    theta_o: float = number(50, "deg", "of the detector", 0, 89)
    ambient: float = number(0.2, "1", "light of the room over that of the lamp at full power", 0, 100)
    photons: float = number(1e6, "1", "counted off the white diffuser at normal incidence", 10, 1e12)
    liar: str = text("minnaert(rho=1, k=0.5)", "a model that reflects more than it receives")
    step: float = number(5, "deg", "of a scan", 1, 30)
    axis_speed: float = number(10, "deg/s", "of the arms", 0.1, 1e3)
    settling: float = number(0.3, "s", "from arrival to reading", 0, 100)
    metal: str = text("gold", "whose colour is told by wavelengths")
    interface: str = text("rough_dielectric(alpha=0.2, eta=1.5)", "what light passes")
    absorption: float = number(0.05, "1/mm", "σa below the surface", 0, 1e3)
    scattering: float = number(2.0, "1/mm", "σs' below the surface", 1e-3, 1e3)
    spot: float = number(2.0, "mm", "radius of the lit and of the viewed spot", 1e-3, 1e3)
    disc: str = text("compact_disc", "whose orders of diffraction are read")
    disc_theta_i: float = number(0, "deg", "of the light on the disc, across the tracks", 0, 85)

    def __post_init__(self) -> None:
        for f in dataclasses.fields(self):
            value = getattr(self, f.name)
            if "low" not in f.metadata:
                if not isinstance(value, str):
                    raise GonioError(f"{f.name} is {value!r}; give a material, {f.metadata['doc']}")
                continue
            known = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
            low, high = f.metadata["low"], f.metadata["high"]
            if not (known and low <= value <= high):
                raise GonioError(f"{f.name} is {value!r}; give a number from {low:g} to {high:g}, {f.metadata['unit']}")

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Name, value, unit, meaning, and whether it was changed, of each."""
        return [
            {
                "name": f.name, "value": getattr(self, f.name), "unit": f.metadata["unit"], "doc": f.metadata["doc"],
                "changed": getattr(self, f.name) != f.default,
            }
            for f in dataclasses.fields(self)
        ]  # fmt: skip


def known_names() -> list[str]:
    """The names of all numbers."""
    return [f.name for f in dataclasses.fields(Numbers)]


def numbers_of(changes: dict[str, Any]) -> Numbers:
    """The numbers with some changed. Raises GonioError for a name that is none, and a value out of its domain."""
    for name in changes:
        if name not in known_names():
            raise GonioError(f"the chapter has no number {name!r}; {nearest(name, known_names())}")
    return Numbers(**changes)


def assigned(words: list[str]) -> dict[str, Any]:
    """Changes that are written name=value."""
    changes: dict[str, Any] = {}
    for word in words:
        name, sign, value = word.partition("=")
        if not sign:
            raise GonioError(f"{word!r} changes nothing; write name=value, as in theta_i=60")
        name = name.strip()
        kinds = {f.name: f.type for f in dataclasses.fields(Numbers)}
        try:
            changes[name] = value if kinds.get(name) is str else float(value)
        except ValueError:
            raise GonioError(f"{name} is {value!r}; give a number") from None
    return changes


def read_numbers(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Changes of a TOML file: `gonio_chapter = 1`, then name = value. Raises GonioError for anything else."""
    keys = dict.fromkeys(known_names(), (object, "a number, or a material in quotes"))
    return read_toml(path, "chapter", LARGEST, keys, lambda data: {n: v for n, v in data.items() if n in keys})

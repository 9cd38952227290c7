"""Every quantity that a standard names, by groups; to add one: an entry in the list of its file."""

import dataclasses

from gonio.data.channels import Channels
from gonio.metrology.standards.colour import Reference, Viewing, colours, flop, held_ends, no_colour, weights_of
from gonio.metrology.standards.gloss import gloss
from gonio.metrology.standards.haze import haze
from gonio.metrology.standards.images import images
from gonio.metrology.standards.reflectance import PORT, multi_angle, reflectance, remote_sensing, retroreflection
from gonio.metrology.standards.scatter import scatter
from gonio.metrology.standards.standard import StandardQuantity
from gonio.models.errors import GonioError, nearest

BASIC = "albedo"
GROUPS = (
    BASIC, "reflectance", "transmission", "gloss", "colour", "multi-angle", "scatter", "retroreflection",
    "remote sensing", "scatter law", "subsurface",
)  # fmt: skip
"""`BASIC` and what is no entry here (fits, scatter laws, light below a surface) are always there, or made elsewhere."""


COLOURED = ("45°a:0°", "8°:di", "8°:de")
"""Reflectance factors whose colour is computed."""


@dataclasses.dataclass(frozen=True)
class Wanted:
    """Which quantities: the groups (none: all), the sphere's port (half-angle, degrees), how colours are seen, and the
    L*a*b* of another subject (see `colours`)."""

    groups: tuple[str, ...] = ()
    port: float = PORT
    viewing: Viewing = dataclasses.field(default_factory=Viewing)
    against: dict[str, Reference] | None = None

    def __post_init__(self) -> None:
        for name in self.groups:
            if name not in GROUPS:
                raise GonioError(f"there is no group of quantities {name!r}; {nearest(name, GROUPS)}")
        if not 0 < self.port <= 30:
            raise GonioError(f"the port is {self.port:g}°; give its half-angle, above 0° and up to 30°")

    def __contains__(self, group: str) -> bool:
        return not self.groups or group in self.groups


def standard_quantities(channels: Channels, wanted: Wanted, behind: bool) -> tuple[list[StandardQuantity], list[str]]:
    """The quantities that are wanted, and remarks on those that there are none of; `behind`: of light through too."""
    factors, angles, notes = reflectance(wanted.port), multi_angle(), []
    made = factors if "reflectance" in wanted else []
    made = made + (gloss() + images() if "gloss" in wanted else [])
    if "colour" in wanted or "multi-angle" in wanted:
        why = no_colour(channels, wanted.viewing)
        weights = [] if why else weights_of(channels, wanted.viewing)
        if why and "colour" in wanted and (len(channels) > 1 or wanted.groups):
            notes.append(f"There is no colour: {why}.")
        notes += [] if why else filter(None, [held_ends(channels, wanted.viewing)])
        coloured = [f for f in factors if f.name in COLOURED]
        made += colours(coloured, weights, wanted.against) if "colour" in wanted else []
        if "multi-angle" in wanted:
            made += angles + colours(angles, weights, wanted.against)
            made += [flop([angles[0], angles[2], angles[4]], w) for w in weights[:1]]
    made += scatter(False) + (scatter(True) if behind else []) if "scatter" in wanted else []
    made += haze() if behind and "transmission" in wanted else []
    made += retroreflection() if "retroreflection" in wanted else []
    made += remote_sensing() if "remote sensing" in wanted else []
    return made, notes

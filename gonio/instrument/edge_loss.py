"""Edge loss: light that leaves a translucent sample beside the viewed spot, and is missing in every reading."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gonio.instrument.instrument import Instrument
from gonio.models.brdf import AbstractBRDF
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.models.subsurface.spots import kept_share
from gonio.models.subsurface.wide_spots import WideSpots

NAMED = 1e-3
"""A loss from which on a table and its check name it."""
ENOUGH = 0.01
WIDEST = 1e5
"""mm."""


@dataclasses.dataclass(frozen=True)
class EdgeLoss:
    """The share of the light that spots of these radii, mm, lose of each channel, with a bound on its error."""

    illuminated_radius: float
    viewed_radius: float
    lost: np.ndarray
    bound: np.ndarray
    enough: float
    """Radius of an illuminated spot that loses at most `ENOUGH`, mm; infinite where none does."""

    def to_dict(self) -> dict[str, Any]:
        """For a table's provenance."""
        radii = {"illuminated_radius_mm": self.illuminated_radius, "viewed_radius_mm": self.viewed_radius}
        return radii | {"lost": self.lost.tolist(), "bound": float(np.max(self.bound))}

    def sentence(self, channels: Sequence[str]) -> str:
        """What is lost, and which spot would do, for people; empty where it does not matter."""
        worst = int(np.argmax(self.lost))
        if self.lost[worst] < NAMED:
            return ""
        named = f" of channel {channels[worst]}" if len(channels) > 1 else ""
        remedy = "no spot is wide enough" if np.isinf(self.enough) else f"light a spot of {self.enough:.2g} mm radius"
        return (
            f"edge loss: {percent(float(self.lost[worst]))} of the light{named} leaves this translucent sample beside "
            f"the viewed spot (lit {self.illuminated_radius:g} mm, viewed {self.viewed_radius:g} mm radius), and every "
            f"reading is too low by it; to lose at most {percent(ENOUGH)}, {remedy}"
        )


def seen_by(brdf: AbstractBRDF, instrument: Instrument) -> tuple[AbstractBRDF, EdgeLoss | None]:
    """The BRDF that an instrument with spots of finite size reads, and what it loses; the BRDF itself without spots.

    Where the light travels below the surface is known of `WideSpots` only; other models lose nothing.

    Raises:
        GonioError: both spots are points.
    """
    a, b = instrument.illuminated_radius, instrument.viewed_radius
    losses: list[EdgeLoss] = []
    if a is None or b is None:
        return brdf, None
    if a == 0:
        raise GonioError("illuminated_radius is 0, which sends no light; give the radius of the spot, mm")

    def narrowed(node: Any) -> Any:
        if not isinstance(node, WideSpots):
            return node
        kept = kept_share(node.bssrdf, a, b)
        losses.append(EdgeLoss(a, b, np.clip(1 - kept.value, 0, 1), kept.bound, _enough(node, b)))
        return WideSpots(node.bssrdf, jnp.asarray(kept.value if kept.value.size > 1 else kept.value[0]))

    result = jax.tree.map(narrowed, brdf, is_leaf=lambda node: isinstance(node, WideSpots))
    return result, max(losses, key=lambda loss: float(np.max(loss.lost)), default=None)


def _enough(material: WideSpots, viewed: float) -> float:
    """The least radius of an illuminated spot, to 1 %, that loses at most `ENOUGH` in every channel."""
    low, high = max(viewed, 1e-5), WIDEST

    def loses(radius: float) -> bool:
        return bool((1 - kept_share(material.bssrdf, radius, viewed).value > ENOUGH).any())

    if not loses(low):
        return low
    if loses(high):
        return np.inf
    while high > 1.01 * low:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if loses(middle) else (low, middle)
    return high

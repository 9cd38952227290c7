"""Materials: a model with its name, channels and source; from a name, a file or an expression, and to a file."""

import dataclasses
from pathlib import Path

from gonio.data.table import Channels
from gonio.models.brdf import AbstractBRDF
from gonio.models.display import Displayed, listed
from gonio.models.errors import GonioError
from gonio.models.evaluation import channel_count
from gonio.models.expression.builder import to_expression

REFERENCE_FOLDER = Path(__file__).parent / "materials"


@dataclasses.dataclass(frozen=True, repr=False)
class Material(Displayed):
    """A BRDF that knows what it is: whatever takes a material takes this.

    `expression` is None where the model has none (an interpolated table). `channels` are those of the model's values;
    `source` says where the numbers come from; `meta` is anything JSON can hold (`fit`: how it was fitted; `file`).
    """

    name: str
    brdf: AbstractBRDF
    expression: str | None
    channels: Channels
    description: str = ""
    source: str = ""
    meta: dict = dataclasses.field(default_factory=dict)

    def facts(self) -> dict[str, str]:
        """Name, model, channels and source."""
        return {
            "name": self.name,
            "model": self.expression or self.description or type(self.brdf).__name__,
            "channels": f"{len(self.channels)}: {listed(self.channels.names)}",
            "source": self.source,
        }


def reference_materials() -> list[str]:
    """The names of the reference materials that come with gonio, sorted."""
    return sorted(path.stem for path in REFERENCE_FOLDER.glob("*.toml"))


def channels_of(brdf: AbstractBRDF) -> Channels:
    """The channels of a model that does not name them."""
    return Channels.of_count(channel_count(brdf) or 1)


def material_of(brdf: AbstractBRDF) -> Material:
    """A bare model as a material: its expression, where it has one, is its name."""
    try:
        expression = to_expression(brdf)
    except GonioError:
        expression = None
    return Material(expression or type(brdf).__name__, brdf, expression, channels_of(brdf))

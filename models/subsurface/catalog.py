"""The models of light below the surface by the names that people and files spell them with."""

from typing import TYPE_CHECKING

from gonio.models.catalog import Catalog
from gonio.models.names import BELOW

if TYPE_CHECKING:
    from gonio.models.subsurface.base import AbstractBSSRDF

BSSRDFS: "Catalog[AbstractBSSRDF]" = Catalog(BELOW)

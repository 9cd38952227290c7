"""The models by the names that people and files spell them with."""

import importlib
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from gonio.models.names import WHERE

if TYPE_CHECKING:
    from gonio.models.brdf import AbstractBRDF


_Model = TypeVar("_Model")


class Catalog(dict[str, Any], Generic[_Model]):
    """Model classes by name, each imported when it is first asked for: a fit of two lobes waits for no others."""

    def __getitem__(self, name: str) -> type[_Model]:
        known = super().__getitem__(name)
        if isinstance(known, tuple):
            known = self[name] = getattr(importlib.import_module(f"gonio.models.{known[0]}"), known[1])
        return known

    def values(self) -> list[type[_Model]]:
        return [self[name] for name in self]

    def items(self) -> list[tuple[str, type[_Model]]]:
        return [(name, self[name]) for name in self]


MODELS: "Catalog[AbstractBRDF]" = Catalog(WHERE)


def is_ours(brdf: "AbstractBRDF") -> bool:
    """Whether all of a model, what stands inside it too, is of this package: its map and its word are to be trusted."""
    from gonio.models.brdf import AbstractBRDF

    inside = [v for v in vars(brdf).values() if isinstance(v, AbstractBRDF)] + list(getattr(brdf, "parts", ()))
    return type(brdf).__module__.startswith("gonio.models.") and all(is_ours(b) for b in inside)


def name_of(model_class: type) -> str | None:
    """The expression's name of a model class; None for one that has none."""
    # Only what has been imported can be a model's class.
    place = model_class.__module__.removeprefix("gonio.models."), model_class.__qualname__
    return next((name for name, known in dict.items(MODELS) if known is model_class or known == place), None)

"""Silent failures that are known and left as they are, each with its reason; a new model needs no entry."""

from typing import NamedTuple


class KnownFailure(NamedTuple):
    """A method, a model, a part of the setting, column or precision, and the reason."""

    method: str
    model: str
    where: str
    reason: str


KNOWN = (
    KnownFailure(
        "gradient", "kelemen", "alpha=0.0001", "a tabulated albedo's slope by alpha: its error over a width of 1e-4"
    ),
)

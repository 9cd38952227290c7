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
        "sampler", "sgd", "alpha=1e-05", "lobe 3e-7 wide across at 89°, directions in single precision 6e-8 apart"
    ),
    KnownFailure("sampler", "abg", "b=1e-12", "core 1e-8 wide, directions in single precision 6e-8 apart"),
    KnownFailure(
        "gradient", "kelemen", "alpha=0.0001", "a tabulated albedo's slope by alpha: its error over a width of 1e-4"
    ),
)

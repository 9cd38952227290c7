"""Silent failures that are known and left as they are, each with its reason; a new model needs no entry."""

from typing import NamedTuple


class KnownFailure(NamedTuple):
    """A method, a model, a part of the setting, column or precision, and the reason."""

    method: str
    model: str
    where: str
    reason: str


_LOBE_EDGE = (
    "on the very edge of the lobe, where the bracket is the rounding of its own terms and f a power of it near 0"
)
_PHONG_EDGE = "at 90° from the mirror direction, where f jumps to 0 and the cosine is rounding"
_NARROW_ABG = "|β − β₀| is the rounding of the directions there, and b far below it"

KNOWN = (
    KnownFailure("gradient", "chandrasekhar", "w=1", "the slope by w is infinite at w = 1, and a number stands for it"),
    KnownFailure("gradient", "lafortune", "n=0", _LOBE_EDGE),
    KnownFailure("value", "lafortune", "n=0", _LOBE_EDGE),
    KnownFailure("value", "phong", "n=0)", _PHONG_EDGE),
    KnownFailure("gradient", "phong", "n=0", _PHONG_EDGE),
    KnownFailure(
        "gradient", "abg", "g=0", "at the mirror direction itself, where |β − β₀|^g jumps from 0 to 1 at g = 0"
    ),
    KnownFailure(
        "sampler", "sgd", "alpha=1e-05", "lobe 3e-7 wide across at 89°, directions in single precision 6e-8 apart"
    ),
    KnownFailure("sampler", "abg", "b=1e-12", _NARROW_ABG),
    KnownFailure("value", "abg", "b=1e-12", _NARROW_ABG),
    KnownFailure("gradient", "abg", "b=1e-12", _NARROW_ABG),
    KnownFailure(
        "gradient", "he_torrance", "sigma=20", "orders of waves that cancel leave √g = 900 roundings, 1e-13 of f"
    ),
    KnownFailure(
        "gradient", "kelemen", "alpha=0.0001", "a tabulated albedo's slope by alpha: its error over a width of 1e-4"
    ),
)

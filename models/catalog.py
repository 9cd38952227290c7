"""The models by the names that people and files spell them with."""

from gonio.models.beckmann import Beckmann
from gonio.models.ggx import GGX
from gonio.models.lambert import Lambert
from gonio.models.oren_nayar import EON, FujiiOrenNayar
from gonio.models.phong import Phong
from gonio.models.white_standard import WhiteStandard

MODELS = {
    "lambert": Lambert,
    "fujii": FujiiOrenNayar,
    "eon": EON,
    "phong": Phong,
    "ggx": GGX,
    "beckmann": Beckmann,
    "white_standard": WhiteStandard,
}


def is_lobe(model_class: type) -> bool:
    """Whether a model is a lobe without an albedo of its own, which a fit gives a free scale."""
    return model_class.lobe


def name_of(model_class: type) -> str:
    """The spelling's name of a model class."""
    return next(name for name, known in MODELS.items() if known is model_class)

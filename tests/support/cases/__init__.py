"""The settings of every model that the laws of all models are tested with."""

from collections.abc import Callable

from gonio.models.brdf import AbstractBRDF
from gonio.models.expression.builder import example
from support.cases import diffuse, energy, half_vector, mirror, transmission

FIRST = {
    "lambert": "lambert(rho=[0, 0.5, 1])",
    "fujii": "fujii(rho=0.5, r=1)",
    "eon": "eon(rho=1, r=1)",
    "phong": "phong(n=30)",
    "phong flat": "phong(n=0)",
    "phong narrow": "phong(n=1e6)",
    "ggx": "ggx(alpha=0.3)",
    "ggx narrow": "ggx(alpha=0.0001)",
    "ggx separable": "ggx(alpha=1, eta=1.5, smith=separable)",
    "ggx anisotropic": "ggx(alpha_x=0.02, alpha_y=0.5, f0=[0.04, 0.5, 1])",
    "ggx conductor": "ggx(alpha=0.1, eta=0.2, k=3.9)",
    "beckmann": "beckmann(alpha=0.3, eta=1.000001)",
    "beckmann narrow": "beckmann(alpha=0.0001)",
    "beckmann walter": "beckmann(alpha=1, smith=walter)",
    "beckmann anisotropic": "beckmann(alpha_x=0.02, alpha_y=0.5)",
    "white_standard": "white_standard()",
}

CASES = {**FIRST, **diffuse.CASES, **half_vector.CASES, **mirror.CASES, **energy.CASES, **transmission.CASES}
"""An expression, or a function without arguments that makes the model, by a name that begins with the model's."""


def cases_of(name: str) -> dict[str, str | Callable[[], AbstractBRDF]]:
    """The settings of one model; a model that is not listed is tested at its starting values."""
    listed = {case: setting for case, setting in CASES.items() if case.split()[0] == name}
    return listed or {name: example(name).strip("'")}

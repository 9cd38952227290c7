"""What a model's parameter is: its domain, unit and meaning, kept as data on the field that holds it."""

import dataclasses
import functools
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

Role = Literal[
    "albedo", "scale", "weight",  # levels: of what is reflected, of a lobe, of a term
    "width", "inverse_width", "roughness", "shoulder", "hot_spot", "exponent",  # shapes; "width" is alpha, of facets
    "fresnel", "index", "extinction", "masking", "phase",  # optics
    "length", "angle", "wavelength", "coefficient",
]  # fmt: skip
"""What a parameter stands for, in the terms of the field."""


@dataclasses.dataclass(frozen=True)
class ParameterInfo:
    """Domain [low, high] (closed at both ends), unit and meaning of a parameter.

    `start` is where a fit begins when nothing is known; `role` is what the parameter stands for; `per_channel`: a joint
    fit frees one value for each channel; `linear`: f is proportional to it; `log`: a fit steps in its logarithm;
    `only`: an option and its choice, with which alone the model has the parameter, and needs it.
    """

    low: float
    high: float
    unit: str
    doc: str
    start: float
    role: Role
    per_channel: bool = False
    linear: bool = False
    log: bool = False
    only: tuple[str, str] | None = None


def parameter(info: ParameterInfo, **kwargs: Any) -> Any:
    """An Equinox field that holds a parameter: a scalar, or one value a channel (shape ``(channels,)``)."""
    return eqx.field(converter=_as_parameter, metadata={"parameter": info}, **kwargs)


def _as_parameter(value: Any) -> Any:
    if value is None:
        return None
    return jnp.asarray(value, dtype=jnp.result_type(float)) if isinstance(value, int | float | list | tuple) else value


def parameters_of(model_class: type) -> dict[str, ParameterInfo]:
    """The parameters of a model class by name, in the order of its fields."""
    return dict(_known_parameters(model_class))


@functools.lru_cache(maxsize=256)
def _known_parameters(model_class: type) -> dict[str, ParameterInfo]:
    fields = dataclasses.fields(model_class)
    return {f.name: f.metadata["parameter"] for f in fields if "parameter" in f.metadata}


def known_total_reflection(eta: Any, k: Any) -> bool:
    """Whether light is reflected totally beyond some angle, by the index, in any channel; no under JAX."""
    if eta is None or any(isinstance(v, Tracer) for v in (eta, k)):
        return False
    index, absorbed = np.broadcast_arrays(np.asarray(eta, float), np.asarray(0.0 if k is None else k, float))
    # The root of η² − k² − sin²θ + 2iηk is 0, or nearly, at an angle where k < η < 1; of metals it is nowhere.
    return bool(np.any((index < 1) & (absorbed < index)))


def known_equal(a: Any, b: Any) -> bool:
    """Whether two parameters are the same in every channel, None like None: a question to values, so no under JAX."""
    if a is None or b is None:
        return a is b
    return not any(isinstance(v, Tracer) for v in (a, b)) and bool(np.all(np.asarray(a) == np.asarray(b)))

"""A picture of a sphere of a material by Mitsuba, where it is installed."""

import importlib
import importlib.util
from typing import Any

import numpy as np

from gonio.data.material import Material
from gonio.exports.about import about
from gonio.exports.forms import appearance_of
from gonio.exports.nearest import nearest
from gonio.exports.reexpression import ReExpression, reexpression
from gonio.exports.renderers.mitsuba import forms
from gonio.exports.renderers.mitsuba_file import scene
from gonio.models.errors import GonioError

VARIANT = "scalar_rgb"
SIDE, SAMPLES = 192, 48


def require_mitsuba() -> None:
    """Raises GonioError where Mitsuba is not installed."""
    if importlib.util.find_spec("mitsuba") is None:
        raise GonioError(
            "a rendered preview needs Mitsuba 3, which is not installed; pip install mitsuba, or leave it out"
        )


def rendered(material: Material) -> tuple[np.ndarray, ReExpression]:
    """(linear sRGB (side, side, 3) of the scene that an export writes, errors of Mitsuba's expression).

    Raises GonioError without Mitsuba, and for a material without colour. A variant of Mitsuba's that the caller chose
    is the caller's again afterwards.
    """
    require_mitsuba()
    mi: Any = importlib.import_module("mitsuba")
    sought = appearance_of(material)
    expression = nearest(forms(sought), sought)
    error = reexpression("Mitsuba 3", sought, expression)
    text = scene(expression.form.describe(expression.values), about(material, error), SIDE, SAMPLES)
    before = mi.variant()
    mi.set_variant(VARIANT)
    try:
        return np.array(mi.render(mi.load_string(text)))[..., :3], error
    finally:
        if before is not None:
            mi.set_variant(before)

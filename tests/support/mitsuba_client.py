"""Mitsuba's own values, of its scalar variants; whoever asks has chosen one by `mi.set_variant`."""

from typing import Any

import numpy as np

from gonio.models.geometry.directions import Direction


def f_cosine(bsdf: Any, wi: Direction, wo: Direction, wavelengths: Any = None) -> np.ndarray:
    """f·|cosθo| (n, channels) of one of its BSDFs; `wavelengths`, nm, of a spectral variant."""
    import mitsuba as mi

    context, si, values = mi.BSDFContext(), mi.SurfaceInteraction3f(), []
    if wavelengths is not None:
        si.wavelengths = wavelengths
    for light, detector in zip(np.stack(wi, axis=1).tolist(), np.stack(wo, axis=1).tolist(), strict=True):
        si.wi = light
        values.append(np.array(bsdf.eval(context, si, detector)))
    return np.array(values)

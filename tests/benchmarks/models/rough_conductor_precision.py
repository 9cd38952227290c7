"""How far Mitsuba's rough conductor in single precision is from itself in double: its formula by NumPy in both.

python tests/benchmarks/models/rough_conductor_precision.py
"""

import pathlib
import sys

import jax
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
jax.config.update("jax_enable_x64", True)
from gonio.models.evaluation import evaluate_in_blocks  # noqa: E402
from gonio.models.geometry.directions import Direction  # noqa: E402
from gonio.models.microfacet.beckmann import Beckmann  # noqa: E402
from gonio.models.microfacet.ggx import GGX  # noqa: E402
from support import helpers  # noqa: E402

CUT = 1e-20
"""Densities of normals times the cosine below which the renderer has 0."""
FAINT = 1e-6
"""Of an entry's largest value: below it digits of a Gaussian tail are looked at apart."""


def renderers_value(said: dict, wi: np.ndarray, wo: np.ndarray, dtype: type) -> np.ndarray:
    """eval of `roughconductor`, (n, channels), of directions (3, n), every step rounded to a precision."""
    f = dtype
    wi, wo = wi.astype(f), wo.astype(f)
    a_x, a_y = (f(said.get(k, said.get("alpha"))) for k in ("alpha_u", "alpha_v"))
    m = wi + wo
    m = m / np.sqrt(np.sum(m * m, axis=0))
    gaussian = said["distribution"] == "beckmann"
    slope = (m[0] / a_x) ** 2 + (m[1] / a_y) ** 2
    if gaussian:
        cos2 = m[2] ** 2
        density = np.exp(-slope / cos2) / (f(np.pi) * a_x * a_y * cos2**2)
    else:
        density = f(1) / (f(np.pi) * a_x * a_y * (slope + m[2] ** 2) ** 2)
    density = np.where(density * m[2] > f(CUT), density, f(0))
    masking = f(1)
    for w in (wi, wo):
        tan2 = ((a_x * w[0]) ** 2 + (a_y * w[1]) ** 2) / w[2] ** 2
        masking = masking * (_walter(tan2) if gaussian else f(2) / (f(1) + np.sqrt(f(1) + tan2)))
    facets = np.where((wi[2] > 0) & (wo[2] > 0), density * masking / (f(4) * wi[2]), f(0))
    return facets[:, None] * _fresnel(said, np.sum(wi * m, axis=0)[:, None])


def _walter(tan2: np.ndarray) -> np.ndarray:
    """The rational fit to Beckmann's masking, by the square of α tan θ."""
    f = tan2.dtype.type
    with np.errstate(divide="ignore"):
        a = f(1) / np.sqrt(tan2)
    a = np.minimum(a, f(1.6))
    fitted = (f(3.535) * a + f(2.181) * a * a) / (f(1) + f(2.276) * a + f(2.577) * a * a)
    return np.where(a >= f(1.6), f(1), fitted)


def _fresnel(said: dict, cos: np.ndarray) -> np.ndarray:
    """Reflectance of a metal (n, channels)."""
    if said.get("material") == "none":
        return np.ones_like(cos)
    f = cos.dtype.type
    eta, k = (np.asarray(said[name]["value"], f) for name in ("eta", "k"))
    cos2 = cos * cos
    sin2 = f(1) - cos2
    inner = eta * eta - k * k - sin2
    root = np.sqrt(inner * inner + f(4) * k * k * eta * eta)
    a = np.sqrt(np.maximum(f(0.5) * (root + inner), f(0)))
    both = f(2) * cos * a
    s = (root + cos2 - both) / (root + cos2 + both)
    p = s * (root * cos2 + sin2 * sin2 - both * sin2) / (root * cos2 + sin2 * sin2 + both * sin2)
    return f(0.5) * (s + p)


def ours(said: dict, wi: Direction, wo: Direction) -> np.ndarray:
    """f cosθo, (n, channels)."""
    x, y = (said.get(axis, said.get("alpha")) for axis in ("alpha_u", "alpha_v"))
    index = {} if said.get("material") == "none" else {"eta": said["eta"]["value"], "k": said["k"]["value"]}
    kind, smith = (Beckmann, "walter") if said["distribution"] == "beckmann" else (GGX, "separable")
    model = kind(alpha_x=x, alpha_y=y, smith=smith, **index)
    return np.asarray(evaluate_in_blocks(model, wi, wo)).reshape(wi.z.size, -1) * np.maximum(wo.z, 0)[:, None]


def _worst(a: np.ndarray, b: np.ndarray, here: np.ndarray) -> float:
    """Largest relative difference."""
    return float(np.max(np.abs(a.astype(float) - b)[here] / b.astype(float)[here], initial=0.0))


def main() -> None:
    """Of each entry the largest relative differences, by columns.

    The stored values from ours at the stored directions, and the renderer's formula in single precision from itself in
    double there: all values, then those above `FAINT` of the largest. Ours at the stored directions from ours at the
    same made units in double, which is what single precision of the directions alone costs. There the renderer's
    formula from ours.
    """
    print(f"{'entry':44s} {'stored':>19s}  {'single':>19s}  {'directions':>19s}  exact")
    largest = 0.0
    for name, said, wi, wo, stored, _ in helpers.mitsuba("roughconductor"):
        given = [np.stack(w) for w in (wi, wo)]
        unit = [w / np.linalg.norm(w, axis=0) for w in given]
        single, double = (renderers_value(said, *given, d) for d in (np.float32, np.float64))
        exact, of_units = renderers_value(said, *unit, np.float64), ours(said, *(Direction(*w) for w in unit))
        value = ours(said, wi, wo)
        stored = stored.reshape(len(value), -1)[:, : value.shape[1]]
        there = (stored > 0) & (value > 0) & (single > 0) & (double > 0) & (exact > 0)
        bright = there & (value > FAINT * value.max())
        columns = []
        for a, b in ((stored, value), (single, double), (value, of_units)):
            columns.append(f"{_worst(a, b, there):.2e} ({_worst(a, b, bright):.2e})")
        largest = max(largest, _worst(exact, of_units, there))
        print(f"{name:44s} " + "  ".join(columns) + f"  {_worst(exact, of_units, there):.2e}")
    print(f"the renderer's formula in double precision is ours to {largest:.1e}")


if __name__ == "__main__":
    main()

"""How far Mitsuba's rough dielectric in single precision is from itself in double: its formula by NumPy in both.

    python tests/benchmarks/models/rough_dielectric_precision.py

Monte Carlo arithmetic [Parker, Pierce & Eggert 2000] shows what any order of rounding costs: each step of the formula
in double precision gets a random relative error of at most 2⁻²⁴, as single precision makes, or of 2⁻³⁴.
"""

import pathlib
import sys
from typing import Any, ClassVar

import jax
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
jax.config.update("jax_enable_x64", True)
from gonio.models.evaluation import evaluate_in_blocks  # noqa: E402
from gonio.models.geometry.directions import Direction  # noqa: E402
from gonio.models.transmission.rough_dielectric import RoughDielectric  # noqa: E402
from support import helpers  # noqa: E402

DRAWS = 100
SINGLE, FINER = 2.0**-24, 2.0**-34
"""Relative errors of one step: of single precision, and of ten bits more."""


class Rounded(np.ndarray):
    """Numbers of which every step of arithmetic gets a random relative error, at most `unit`."""

    unit: ClassVar[float] = SINGLE
    rng: ClassVar[np.random.Generator] = np.random.default_rng(0)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        plain = (np.asarray(v) if isinstance(v, Rounded) else v for v in inputs)
        result = np.asarray(getattr(ufunc, method)(*plain, **options))
        if result.dtype.kind != "f":
            return result
        return (result * (1.0 + self.unit * self.rng.uniform(-1.0, 1.0, result.shape))).view(Rounded)


def rounding_errors(said: dict, wi: np.ndarray, wo: np.ndarray, unit: float) -> np.ndarray:
    """Relative errors (DRAWS, n) of the renderer's formula whose every step is rounded at random."""
    Rounded.unit, exact = unit, renderers_value(said, wi, wo, np.float64)
    draws = [np.asarray(renderers_value(said, wi.view(Rounded), wo.view(Rounded), np.float64)) for _ in range(DRAWS)]
    return np.abs(np.stack(draws) - exact) / np.maximum(exact, 1e-300)


def renderers_value(said: dict, wi: np.ndarray, wo: np.ndarray, dtype: type) -> np.ndarray:
    """eval of `roughdielectric` (GGX), (n,), of directions (3, n), every step rounded to a precision."""
    f = dtype
    wi, wo = wi.astype(f), wo.astype(f)
    ratio = f(said["int_ior"] / said["ext_ior"])
    a_x, a_y = (f(said.get(k, said.get("alpha"))) for k in ("alpha_u", "alpha_v"))
    reflects, front = wi[2] * wo[2] > 0, wi[2] > 0
    eta, inverse = np.where(front, ratio, f(1) / ratio).astype(f), np.where(front, f(1) / ratio, ratio).astype(f)
    m = wi + wo * np.where(reflects, f(1), eta)
    m = m / np.sqrt(np.sum(m * m, axis=0))
    m = m * np.where(m[2] < 0, f(-1), f(1))
    slope = (m[0] / a_x) ** 2 + (m[1] / a_y) ** 2 + m[2] ** 2
    density = f(1) / (f(np.pi) * a_x * a_y * slope**2)
    density = np.where(density * m[2] > f(1e-20), density, f(0))
    dot_i, dot_o = np.sum(wi * m, axis=0), np.sum(wo * m, axis=0)
    outside = dot_i >= 0
    eta_it = np.where(outside, ratio, f(1) / ratio).astype(f)
    cos_t2 = f(1) - (f(1) - dot_i * dot_i) * (f(1) / eta_it) ** 2
    cos_i, cos_t = np.abs(dot_i), np.sqrt(np.maximum(cos_t2, f(0)))
    a_s = (cos_i - eta_it * cos_t) / (cos_i + eta_it * cos_t)
    a_p = (cos_t - eta_it * cos_i) / (cos_t + eta_it * cos_i)
    fresnel = f(0.5) * (a_s * a_s + a_p * a_p)
    masking = f(1)
    for w, dot in ((wi, dot_i), (wo, dot_o)):
        tan2 = ((a_x * w[0]) ** 2 + (a_y * w[1]) ** 2) / w[2] ** 2
        masking = masking * np.where(dot * w[2] > 0, f(2) / (f(1) + np.sqrt(f(1) + tan2)), f(0))
    back = fresnel * density * masking / (f(4) * np.abs(wi[2]))
    through = inverse**2 * (f(1) - fresnel) * density * masking * eta**2 * dot_i * dot_o
    through = through / (wi[2] * (dot_i + eta * dot_o) ** 2)
    return np.where(reflects, back, np.abs(through))


def _worst(a: np.ndarray, b: np.ndarray) -> float:
    """Largest relative difference."""
    return float(np.max(np.abs(a.astype(float) - b) / np.maximum(b.astype(float), 1e-6)))


def main() -> None:
    """Of each entry the largest relative differences, by columns.

    The stored values from ours; the renderer's formula in single from double precision; ours at directions as they are
    stored, in single precision, from ours at the same made units in double; there the renderer's formula from ours.
    Then, where the stored value is furthest off, the rms of random roundings of single precision, and of ten bits more,
    and the largest difference of any stored value over the largest of its random roundings.
    """
    print(f"{'entry':40s} stored    single    rounded   exact     | random    2^-34     stored/largest random")
    for name, said, wi, wo, f_cos, _ in helpers.mitsuba("roughdielectric"):
        if said["distribution"] != "ggx":
            continue
        eta = said["int_ior"] / said["ext_ior"]
        x, y = (said.get(axis, said.get("alpha")) for axis in ("alpha_u", "alpha_v"))
        model = RoughDielectric(alpha_x=x, alpha_y=y, eta=eta, distribution="ggx", smith="separable")
        ours = evaluate_in_blocks(model, wi, wo)[:, 0] * np.abs(wo.z)
        ours /= np.where(wi.z * wo.z < 0, np.where(wi.z > 0, eta**2, eta**-2), 1.0)
        stored = f_cos.reshape(wi.z.size, -1)[:, 0]
        given = np.stack(wi), np.stack(wo)
        single, double = (renderers_value(said, *given, d) for d in (np.float32, np.float64))
        unit = [w / np.linalg.norm(w, axis=0) for w in given]
        exact = renderers_value(said, *unit, np.float64)
        of_units = evaluate_in_blocks(model, *(Direction(*w) for w in unit))[:, 0] * np.abs(unit[1][2])
        of_units /= np.where(wi.z * wo.z < 0, np.where(wi.z > 0, eta**2, eta**-2), 1.0)
        both = (stored > 1e-6) & (ours > 1e-6)

        pairs = ((stored, ours), (single, double), (ours, of_units), (exact, of_units))
        print(f"{name:40s} " + "  ".join(f"{_worst(a[both], b[both]):.2e}" for a, b in pairs), end="  | ")
        random, finer = (rounding_errors(said, *given, u)[:, both] for u in (SINGLE, FINER))
        off = (np.abs(stored - double) / np.maximum(double, 1e-300))[both]
        rms = [np.sqrt(np.mean(e[:, np.argmax(off)] ** 2)) for e in (random, finer)]
        print("  ".join(f"{v:.2e}" for v in rms) + f"  {np.max(off / np.maximum(np.max(random, 0), SINGLE)):.2f}")


if __name__ == "__main__":
    main()

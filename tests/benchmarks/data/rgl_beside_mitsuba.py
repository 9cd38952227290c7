"""RGL files evaluated by gonio, in double and in single precision, beside Mitsuba's values on file (single precision).

python rgl_beside_mitsuba.py FOLDER ORACLE.npz
"""

import pathlib
import sys

import jax
import jax.numpy as jnp
import numpy as np

from gonio.data.formats.rgl_file import read_rgl_data
from gonio.data.interpolation.rgl_warp import RGLMaterial
from gonio.models.geometry.directions import Direction


def main(folder: str, oracle: str) -> None:
    jax.config.update("jax_enable_x64", True)
    witness = np.load(oracle)
    head = ("file", "values", "worst, bright", "within 1e-4", "median", "single precision within 1e-4 of double")
    print("{:24} {:>7} {:>14} {:>12} {:>9}   {}".format(*head))
    for path in sorted(pathlib.Path(folder).glob("*.bsdf")):
        entry = f"measured_{path.stem}"
        if f"{entry}/wi" not in witness:
            continue
        wi, wo = (witness[f"{entry}/{w}"].astype(float) for w in ("wi", "wo"))
        expected = witness[f"{entry}/f_cos"].astype(float)
        model = RGLMaterial(read_rgl_data(path))
        ours, single = (values(model, wi, wo, t) for t in (jnp.float64, jnp.float32))
        seen = expected > 0
        error = np.abs(ours - expected)[seen] / expected[seen]
        bright = expected[seen] > 1e-3 * expected.max()
        rounding = np.abs(single - ours)[seen] / np.abs(ours)[seen]
        print(
            f"{path.stem:24} {seen.sum():7d} {error[bright].max():14.1e} {np.mean(error < 1e-4):12.4f}"
            f" {np.median(error):9.1e}   {np.mean(rounding < 1e-4):.4f}"
        )
    print("bright: above 1e-3 of the file's largest value. Mitsuba's values are single precision.")


def values(model, wi, wo, dtype) -> np.ndarray:
    model = jax.tree.map(lambda a: a.astype(dtype) if jnp.issubdtype(a.dtype, jnp.floating) else a, model)
    pair = [Direction(*(jnp.asarray(c, dtype) for c in w.T)) for w in (wi, wo)]
    f = np.asarray(jax.jit(jax.vmap(model.f))(*pair), float)
    return f * np.maximum(wo[:, 2], 0)[:, None]


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])

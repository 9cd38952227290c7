"""How near each renderer comes to the reference materials and to fits of measured files, and its own values of that.

    python tests/benchmarks/reports/exports.py [--materials gold,copper] [--fits FILE.bsdf ...] [--model EXPRESSION]

A line for each material: by renderer the rms (relative, cosine-weighted, %), the largest difference of albedo (%), the
largest ΔE2000 of a lit sphere, and CPU seconds of the export; for Mitsuba the largest relative difference between its
own values of the written file (scalar_rgb, single precision) and what the errors were computed with.
"""

import argparse
import sys
import time
from pathlib import Path

import jax
import mitsuba as mi
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import gonio
from gonio.data.subject import reference_materials
from gonio.exports.about import about
from gonio.exports.forms import appearance_of
from gonio.exports.nearest import Nearest, nearest
from gonio.exports.pairs import Pairs, polar_pairs
from gonio.exports.reexpression import reexpression
from gonio.exports.targets import TARGETS
from support.mitsuba_client import f_cosine

LOW = 0.035
"""Cosine of the directions beyond which single precision is worse."""
DARK = 1e-4
"""Of the largest value, below which a difference of the client's counts by that."""


def client_values(text: str, pairs: Pairs) -> np.ndarray:
    """f (n, 3) of Mitsuba's own BSDF."""
    bsdf = mi.load_string(text).shapes()[0].bsdf()
    return f_cosine(bsdf, pairs.wi, pairs.wo) / np.abs(pairs.wo.z[:, None])


def off(text: str, expression: Nearest, pairs: Pairs) -> float:
    """Largest relative difference between Mitsuba's values of a file and those of the expression."""
    theirs = client_values(text, pairs)
    ours = np.broadcast_to(expression.form.f(expression.values, pairs), theirs.shape)
    return float(np.max(np.abs(theirs - ours) / np.maximum(ours, DARK * ours.max())))


def row(name: str, material: gonio.Material) -> str:
    """The figures of one material."""
    try:
        sought = appearance_of(material)
    except gonio.GonioError as error:
        return f"{name:22s} refused: {error}"
    cells = []
    for key, target in TARGETS.items():
        begin = time.process_time()
        expression = nearest(target.forms(sought), sought)
        error = reexpression(target.title, sought, expression)
        text = target.file(expression.form.describe(expression.values), about(material, error), target.suffixes[0])
        seconds = time.process_time() - begin
        rms, albedo = 100 * error.relative_rms, 100 * error.albedo_difference
        cell = f"{rms:6.2f} {albedo:5.1f} {error.delta_e_max:6.2f} {seconds:4.1f}"
        if error.exact:
            cell = f"{'exact':>19s} {seconds:4.1f}"
        if key == "mitsuba":
            pairs = polar_pairs(5, 12, 5, turns=1 if sought.isotropic else 2)
            pairs = pairs.where(np.minimum(pairs.wi.z, pairs.wo.z) > LOW)
            sheet = expression.form.transmits and not sought.interface  # whose light through it is seen over η² there
            cell += f" {max(off(text.decode(), expression, s) for s in (pairs, *[pairs.through()] * sheet)):7.1e}"
        cells.append(cell)
    return f"{name:22s} " + " | ".join(cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--materials", default=",".join(reference_materials()))
    parser.add_argument("--fits", nargs="*", default=[])
    parser.add_argument("--model", default="lambert + ggx(f0=?) + ggx")
    args = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    mi.set_variant("scalar_rgb")
    widths = {key: 24 + 8 * (key == "mitsuba") for key in TARGETS}
    print(f"{'':22s} " + " | ".join(f"{key:{width}s}" for key, width in widths.items()))
    print(f"{'':22s} " + " | ".join(f"{'rms%  alb%    ΔE    s':>{width}s}" for width in widths.values()))
    for name in filter(None, args.materials.split(",")):
        print(row(name, gonio.material(name)), flush=True)
    for path in args.fits:
        result = gonio.fit(path, args.model, samples=20_000, starts=2)
        off = 100 * result.metrics["relative_rms_cosine"]
        print(row(f"{Path(path).stem[:14]} ({off:.0f}%)", result.material), flush=True)


if __name__ == "__main__":
    main()

"""XML files of windows beside Radiance's own reader: hemispherical values, f, and reciprocity by its measure.

    window_xml.py FILE...

Needs pyradiance. Its "back" is the file's and gonio's front; its f marks the place of a value by up to ±0.03 %. Its
checkBSDF, whose lines follow, states reciprocity as |a − b| / max(a, b) over pairs above 1e-4 in percent, least, mean
and most, as the last columns do here; exterior is the front. In transmission it adds the diffuse part that it took out
of one side's matrix to that one (2011-SA1: 4.7 %; so ours would be 0.6, 31.3, 49.3 %); of trees it takes other places.
"""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np

from gonio.checks.table.sheet import sheet_pairs
from gonio.data.formats.optics.window_xml import read_window_xml
from gonio.data.interpolation.scattering_blocks import BLOCKS, SheetBSDF
from gonio.data.interpolation.sheets import sheet_of
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction

sys.path.insert(0, str(Path(__file__).parents[2]))
from support import radiance

jax.config.update("jax_enable_x64", True)
PAIRS = 4000


def hemispherical(bsdf: SheetBSDF, path: str, name: str) -> tuple[float, float, float]:
    """The share at the incidence nearest to the normal, the largest, and the largest difference from Radiance's."""
    block = bsdf.blocks[name][0]
    assert block is not None
    arriving = block.incidences()
    shares = block.share(arriving)
    polar = np.degrees(np.pi - arriving[:, 0] if name.endswith("front") else arriving[:, 0])
    azimuth = np.degrees(arriving[:, 1]) + 180
    there = radiance.ask(path, [(t, p, name.split()[0]) for t, p in zip(polar, azimuth, strict=True)]).shares
    return float(shares[np.argmin(arriving[:, 0])]), float(shares.max()), float(np.abs(shares - there).max())


def values(bsdf: SheetBSDF, path: str) -> float:
    """The largest relative difference of f at random pairs."""
    rng = np.random.default_rng(0)
    theta, phi = np.arccos(rng.uniform(-1, 1, (2, PAIRS))), rng.uniform(0, 2 * np.pi, (2, PAIRS))
    wi, wo = (
        Direction(np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)) for t, p in zip(theta, phi, strict=True)
    )
    degrees = np.degrees(np.stack([np.pi - theta[0], phi[0], np.pi - theta[1], phi[1]], axis=-1))
    there = radiance.ask(path, pairs=degrees).values
    return float(np.max(np.abs(np.asarray(evaluate(bsdf, wi, wo))[:, 0] - there) / np.maximum(np.abs(there), 1e-3)))


def radiances_reciprocity(path: str) -> list[str]:
    """The lines on reciprocity of Radiance's own check, where its programs came with its library."""
    spec = importlib.util.find_spec("pyradiance")
    home = Path(spec.origin).parent if spec and spec.origin else Path()
    program = home / "bin" / "checkBSDF"
    if not program.exists():
        return ["checkBSDF is not installed"]
    text = subprocess.run(
        [program, path], env={**os.environ, "RAYPATH": str(home / "lib")}, capture_output=True, text=True
    )
    lines = text.stdout.splitlines()
    first = next((k for k, line in enumerate(lines) if "Reciprocity" in line), len(lines))
    return [" ".join(line.split()) for line in lines[first + 1 :]]


def main() -> None:
    for path in sys.argv[1:]:
        bsdf = sheet_of(read_window_xml(path))
        assert bsdf is not None
        print(f"{path}\n  f: largest relative difference {values(bsdf, path):.1e}")
        pairs = sheet_pairs(bsdf)
        side = np.sign(np.cos(pairs.angles[:, [0, 2]]))
        kinds = {"reflection front": (side == 1).all(axis=1), "reflection back": (side == -1).all(axis=1)}
        for name in BLOCKS:
            normal, largest, difference = hemispherical(bsdf, path, name)
            a, b, *_ = pairs.column(0).rows(kinds.get(name, side.prod(axis=1) < 0))
            seen = (a > 1e-4) & (b > 1e-4)
            unequal = 100 * np.abs(a - b)[seen] / np.maximum(a, b)[seen]
            print(
                f"  {name:18s} at the normal {normal:.9f}, largest {largest:.6f}, from Radiance's {difference:.1e};"
                f" reciprocity {unequal.min():.1f} {unequal.mean():.1f} {unequal.max():.1f} %"
            )
        print("  checkBSDF: " + "; ".join(radiances_reciprocity(path)))


if __name__ == "__main__":
    main()

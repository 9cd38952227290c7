"""RGL files written by gonio, read by Mitsuba's `measured` plugin, against the models that they stand for.

python rgl_written.py [--bytes 16384,262144] [MATERIAL ...]

f·cosθo of every isotropic reference material and of four anisotropic surfaces, at seeded random pairs within 80° of the
normal: "light" where the surface reflects (the light cosine-weighted, the detector by the model's own sampler), "all"
evenly over both hemispheres. Mitsuba computes in single precision (scalar_rgb, or scalar_spectral with four of the
wavelengths). "images": spheres under a sky and a small light.
"""

import argparse
import os
import pathlib
import sys
import tempfile
import time

import jax
import mitsuba as mi
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from gonio.data.subject import load_material, reference_materials
from gonio.exports.convert import convert
from gonio.instrument.scans import is_isotropic
from gonio.models.evaluation import evaluate_in_blocks, sampled_directions
from gonio.models.geometry.directions import Direction
from support.mitsuba_client import f_cosine

WITHIN = np.radians(80.0)
COUNT = 3000
DIMMEST = 1e-8
"""f·cosθo below which no instrument reads anything, and single precision soon ends."""
ANISOTROPIC = (
    "ggx(alpha_x=0.1, alpha_y=0.4)",
    "ggx(alpha_x=0.06, alpha_y=0.35, eta=[0.2, 0.92, 1.1], k=[3.9, 2.45, 2.45])",
    "lambert(rho=0.2) + 0.3 * ward(alpha_x=0.1, alpha_y=0.3)",
    "lambert(rho=[0.1, 0.2, 0.4]) + beckmann(alpha_x=0.2, alpha_y=0.5, eta=1.5)",
)


def pairs(brdf, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """(wi, wo), each (3, n)."""
    rng = np.random.default_rng(0)
    phi = rng.uniform(0, 2 * np.pi, (2, COUNT))
    z = np.cos(WITHIN) + (1 - np.cos(WITHIN)) * rng.random((2, COUNT))
    if kind == "light":
        z[0] = np.sqrt(1 - np.sin(WITHIN) ** 2 * rng.random(COUNT))
    wi, wo = (
        np.array([np.sqrt(1 - c**2) * np.cos(p), np.sqrt(1 - c**2) * np.sin(p), c]) for c, p in zip(z, phi, strict=True)
    )
    if kind == "light":
        wo = np.array(sampled_directions(brdf, Direction(*wi), *rng.random((2, COUNT))))
    kept = wo[2] > np.cos(WITHIN)
    return wi[:, kept], wo[:, kept]


def mitsubas(path: str, wi: np.ndarray, wo: np.ndarray, wavelengths) -> np.ndarray:
    """f·cosθo (n, channels)."""
    mi.set_variant("scalar_rgb" if wavelengths is None else "scalar_spectral")
    bsdf = mi.load_dict({"type": "measured", "filename": path})
    return f_cosine(bsdf, Direction(*wi), Direction(*wo), wavelengths)


def image_is_sound(path: str, spectral: bool) -> bool:
    mi.set_variant("scalar_spectral" if spectral else "scalar_rgb")
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 3, "hide_emitters": True},
            "sensor": {"type": "perspective", "fov": 35,
                       "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0] * 3, [0, 1, 0]),
                       "film": {"type": "hdrfilm", "width": 48, "height": 48, "pixel_format": "rgb"},
                       "sampler": {"type": "independent", "sample_count": 16}},
            "sphere": {"type": "sphere", "bsdf": {"type": "measured", "filename": path}},
            "sky": {"type": "constant"},
            "sun": {"type": "point", "position": [3, 4, 3], "intensity": 20.0},
        }
    )  # fmt: skip
    pixels = np.array(mi.render(scene, seed=0))
    return bool(np.isfinite(pixels).all() and (pixels >= (-1e-3 if spectral else 0)).all())


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser()
    parser.add_argument("materials", nargs="*")
    parser.add_argument("--bytes", default="16384")
    args = parser.parse_args()
    names = args.materials or [*(n for n in reference_materials() if is_isotropic(load_material(n).brdf)), *ANISOTROPIC]
    for channel_bytes in map(int, args.bytes.split(",")):
        print(f"{channel_bytes} bytes of a channel (and azimuth of the light)")
        print(f"{'material':34} light: median, 95 %    all: median, 95 %   below 0, image, MiB, s")
        rows = []
        for name in names:
            rows.append(one(name, channel_bytes))
        print("largest".ljust(34), "  ".join(f"{v:9.1e}" for v in np.max(rows, axis=0)), flush=True)
        print("median".ljust(34), "  ".join(f"{v:9.1e}" for v in np.median(rows, axis=0)), flush=True)


def one(name: str, channel_bytes: int) -> list[float]:
    material = load_material(name)
    wavelengths = material.channels.wavelengths_nm
    with tempfile.TemporaryDirectory() as folder:
        path, began = os.path.join(folder, "m.bsdf"), time.perf_counter()
        convert(material, path, channel_bytes=channel_bytes)
        seconds, size = time.perf_counter() - began, os.path.getsize(path) / (1 << 20)
        errors, negative = [], 0
        for kind in ("light", "all"):
            wi, wo = pairs(material.brdf, kind)
            four = None if wavelengths is None else list(wavelengths[:4])
            read = mitsubas(path, wi, wo, four)
            f_cos = (
                evaluate_in_blocks(material.brdf, Direction(*wi), Direction(*wo))[:, : read.shape[1]] * wo[2][:, None]
            )
            usable = np.broadcast_to(f_cos, read.shape) > DIMMEST
            error = np.abs(read - f_cos)[usable] / np.broadcast_to(f_cos, read.shape)[usable]
            negative += int((read < 0).sum() + np.isnan(read).sum())
            errors += [float(np.median(error)), float(np.quantile(error, 0.95))]
        sound = image_is_sound(path, wavelengths is not None)
    head = "  ".join(f"{v:9.1e}" for v in errors)
    print(
        f"{name[:34]:34} {head}   {negative}  {'sound' if sound else 'BROKEN'}  {size:.2f}  {seconds:.0f}", flush=True
    )
    return errors


if __name__ == "__main__":
    main()

"""The same data in files of several optics programs beside each other, and each file's totals beside our integrals.

    optics_files.py FOLDER

FOLDER has zemax/NAME.bsdf, speos/NAME.anisotropicbsdf and fred/NAME.txt; files of one name are compared at the nodes of
the second, where the first has readings at all four nodes about them. Speos' values are scaled to a total, so f differs
by one factor for each incidence: it is printed, and so is what remains, in per cent and in units of the last of the
four digits of the first file's values. That factor is the vendor's: its converter scales each incidence to the first
file's TIS. So the second file's total by that converter's own quadrature (SciPy's nquad of a bilinear integrand, to
0.1 absolute) is printed over the TIS.
"""

import dataclasses
import pathlib
import sys

import jax
import numpy as np
from scipy.integrate import nquad
from scipy.interpolate import RectBivariateSpline

from gonio.data.flags import Flag
from gonio.data.formats.optics.speos_text import SpeosBlock, read_speos_text
from gonio.data.formats.optics.text_lines import TextLines
from gonio.data.formats.registry import read
from gonio.data.interpolation.multilinear import as_material
from gonio.data.table import Table
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import Direction

jax.config.update("jax_enable_x64", True)
DIGITS = 4


def surrounded(table: Table, wi: Direction, wo: Direction) -> np.ndarray:
    """Whether all nodes about pairs of directions have a reading, and none lies beyond the outermost node."""
    there = dataclasses.replace(table, f=(table.flag == Flag.VALID).astype(float), flag=np.zeros_like(table.flag))
    last = table.layout.axes["theta_m"][-1]
    cosine = -wi.x * wo.x - wi.y * wo.y + wi.z * np.abs(wo.z)
    return (evaluate_in_blocks(as_material(there), wi, wo)[:, 0] > 1 - 1e-9) & (cosine > np.cos(last) + 1e-9)


def unit_of_last_digit(f: np.ndarray) -> np.ndarray:
    """Of numbers printed with so many digits."""
    return 10.0 ** (np.floor(np.log10(f)) - DIGITS + 1)


def compare(first: Table, second: Table) -> None:
    block = second.samples()
    f = evaluate_in_blocks(as_material(first), block.wi, block.wo)[:, 0]
    use = (block.flag[:, 0] == Flag.VALID) & surrounded(first, block.wi, block.wo) & (f > 1e-9)
    theta_i = np.degrees(np.arccos(block.wi.z))
    print("  θi     pairs  factor    rest: median, largest  largest in last digits")
    for angle in np.unique(np.round(theta_i, 6)):
        here = use & (np.abs(theta_i - angle) < 1e-4)
        if not here.any():
            continue
        a, b = f[here], block.f[here, 0]
        factor = float(np.median(b / a))
        rest = np.abs(b / factor - a)
        share, digits = 100 * rest / a, np.max(rest / unit_of_last_digit(a))
        print(
            f"  {angle:5.1f}  {here.sum():5d}  {factor:.6f}  {np.median(share):.5f}, {share.max():.5f} %  {digits:.3f}"
        )


def converters_total(block: SpeosBlock, intensity: bool) -> float:
    """∫ value / π · cosθ dω of a block, as the vendor's converter takes it."""
    theta, phi = np.radians(np.minimum(block.theta, 180 - block.theta)), np.radians(block.phi)
    f = block.values / np.pi
    weight = np.sin(theta) if intensity else np.sin(theta) * np.cos(theta)
    order = np.argsort(theta)
    spline = RectBivariateSpline(theta[order], phi, (f * weight[:, None])[order], kx=1, ky=1)
    limits, options = [[0, np.pi / 2], [0, 2 * np.pi]], [{"epsabs": 0.1}] * 2
    return float(nquad(lambda t, p: float(spline(t, p)[0, 0]), limits, opts=options)[0])


def totals(first: pathlib.Path, second: pathlib.Path) -> None:
    """The totals of the second file's values over the TIS of the first's."""
    lines = TextLines(first, "a Zemax file").text.split("\n")
    tis = [float(line.split()[1]) for line in lines if line.startswith("TIS")]
    text = read_speos_text(second)
    for block, share in zip(text.blocks, tis, strict=True):
        ratio = converters_total(block, text.intensity) / share
        print(f"  θi {block.theta_i:4.1f}°: TIS {share:.7f}, the converter's total of the values over it {ratio:.15f}")


def main(folder: pathlib.Path) -> None:
    tables: dict[str, dict[str, Table]] = {}
    for program, suffix in (("zemax", ".bsdf"), ("speos", ".anisotropicbsdf"), ("fred", ".txt")):
        for path in sorted((folder / program).glob(f"*{suffix}")):
            table = read(path)
            tables.setdefault(path.stem, {})[program] = table
            print(f"{program} {path.name}: {table.layout.name}, {table.counts()['valid']} readings")
            for line in table.provenance.get("totals", []):
                print(f"  {line}")
    for name, of_programs in tables.items():
        first, *others = of_programs.values()
        for program, second in zip(list(of_programs)[1:], others, strict=True):
            print(f"{name}: {next(iter(of_programs))} beside {program}")
            compare(first, second)
            if program == "speos":
                print(f"{name}: zemax with --scale tis beside speos")
                compare(read(folder / "zemax" / f"{name}.bsdf", scale="tis"), second)
                totals(folder / "zemax" / f"{name}.bsdf", folder / "speos" / f"{name}.anisotropicbsdf")


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))

"""Texts of files of optics programs, as these programs write them."""

import itertools

import numpy as np


def row(values):
    return "\t".join(repr(float(v)) for v in np.ravel(values))


def zemax(rotation, incidence, azimuth, radial, values, **words):
    """A Zemax file; values (channel, rotation, incidence, azimuth, radial)."""
    words = {"Symmetry": "Asymmetrical", "ScatterType": "BRDF", "TIS": 0.25} | words
    sections = ["Monochrome"] if len(values) == 1 else ["TristimulusX", "TristimulusY", "TristimulusZ"]
    lines = [*words.get("comments", ["# a comment"]), "Source\tMeasured", f"Symmetry\t{words['Symmetry']}"]
    lines += [f"SpectralContent\t{'Monochrome' if len(values) == 1 else 'XYZ'}", f"ScatterType\t{words['ScatterType']}"]
    lists = {
        "SampleRotation": rotation, "AngleOfIncidence": incidence, "ScatterAzimuth": azimuth, "ScatterRadial": radial
    }  # fmt: skip
    for name, angles in lists.items():
        lines += [f"{name} {len(angles)}", row(angles)]
    lines.append("")
    for section, of_channel in zip(sections, values, strict=True):
        lines += [section, "DataBegin"]
        for r, i in itertools.product(range(len(rotation)), range(len(incidence))):
            lines += [f"TIS {words['TIS']}", *(row(v) for v in of_channel[r][i])]
        lines.append("DataEnd")
    return "\n".join(lines) + "\n"


def speos_block(theta, phi, values):
    rows = [f"{t!r}\t{row(v)}" for t, v in zip(map(float, theta), values, strict=True)]
    return [f"{len(theta)} {len(phi)}", "\t" + row(phi), *rows]


def speos_anisotropic(parts, rotation, incidence, spectra, blocks, bsdf=1):
    """An .anisotropicbsdf file of reflection, transmission or both.

    parts: flags; spectra: for each part ((theta, rotation), [(nm, per cent), ...]); blocks: (theta, phi, values) of
    each part, rotation and incidence.
    """
    lines = ["OPTIS - Anisotropic BSDF surface file v8.0", "0", "Comment", "11", "Description", "0\t1\t0"]
    lines += ["\t".join(map(str, parts)), str(bsdf)]
    for _ in spectra:
        lines += [str(len(rotation)), row(rotation)]
        lines += [str(len(incidence)), row(incidence)] * len(rotation)
    for (theta, turn), totals in spectra:
        lines += [f"{theta} {turn}", "", str(len(totals)), *(f"{nm}\t{percent}" for nm, percent in totals)]
    for block in blocks:
        lines += speos_block(*block)
    return "\n".join([*lines, "End of file"]) + "\n"


def speos_isotropic(parts, incidence, wavelengths, blocks, bsdf=1):
    """A .brdf file; blocks: (per cent, theta, phi, values) of each part, incidence and wavelength."""
    lines = ["OPTIS - brdf surface file v8.0", "0", "Comment", "5", "-----", "\t".join(map(str, parts)), str(bsdf)]
    lines += [f"{len(incidence)}\t{len(wavelengths)}", row(incidence), row(wavelengths)]
    for percent, *block in blocks:
        lines += [str(percent), *speos_block(*block)]
    return "\n".join([*lines, "End of file"]) + "\n"

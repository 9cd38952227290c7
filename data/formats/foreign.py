"""Formats that gonio knows by sight but does not read, so that a file is named as what it is."""

import re

SIGNATURES = (
    (b"MATLAB 5.0 MAT-file", "a MATLAB file (.mat)"),
    (b"MATLAB 7.3 MAT-file", "a MATLAB file (.mat)"),
    (b"\x93NUMPY", "a NumPy array (.npy)"),
    (b"v/1\x01", "an OpenEXR image"),
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"II*\0", "a TIFF image"),
    (b"MM\0*", "a TIFF image"),
    (b"SIMPLE  =", "a FITS file"),
    (b"%PDF", "a PDF"),
    (b"CDF\x01", "a netCDF-3 file"),
    (b"CDF\x02", "a netCDF-3 file"),
    (b"\x0e\x03\x13\x01", "an HDF4 file"),
    (b"\x1f\x8b", "compressed by gzip"),
    (b"BZh", "compressed by bzip2"),
    (b"\xfd7zXZ", "compressed by xz"),
    (b"7z\xbc\xaf", "a 7-Zip archive"),
    (b"\xd0\xcf\x11\xe0", "an old Excel or Word file"),
    (b"PAR1", "a Parquet file"),
    (b"SQLite format 3", "an SQLite data base"),
    (b"{\\rtf", "an RTF document"),
    (b"\x80\x04", "a Python pickle"),
    (b"\x80\x05", "a Python pickle"),
    (b"IESNA", "an IES luminaire file"),
    (b"NVIDIA ARC MBSDF", "a measured BSDF of MDL (.mbsdf)"),
)
"""What a file begins with, and what it then is."""
TEXTS = (
    (r"^\s*<(?:!DOCTYPE html|html)", "an HTML page"),
    (r"^[\s\S]{0,2000}?<(?:\w+:)?CxF[\s>]", "a CxF file of colours (.cxf)"),
    (r"^\s*<\?xml|^\s*<\w+[ >]", "an XML file"),
    (r'^\s*\{[\s\S]*"(?:\$schema|schema)"[^,]{0,300}OpenMATERIAL', "an OpenMATERIAL JSON file"),
    (r"^\s*[\[{]\s*(?:[\"\[{\]}\d-]|$)", "a JSON file"),
    (r"(?m)^[ \t\r]*+(?:ScatterRadial\s++\d|(?:AOI|POI)[ \t]++[\d.]++[ \t\r]*$)", "a LightTools BSDF file"),
    (r"(?m)^Source\s++Measured", "a damaged Zemax BSDF file"),
    (r"(?m)^[ \t\r]*+(?:SIGMAT|SIGMAS)\b", "an Integra scattering file (.ddr, .ddt)"),
    (r"(?m)^[ \t\r]*+VARS\s", "an ASTM file without theta_i and theta_s"),
)
"""What stands in the beginning of a text, and what it then is."""
ENDINGS = {
    ".bsdf180": "a Speos .bsdf180 file",
    ".mbsdf": "a measured BSDF of MDL",
    ".cxf": "a CxF file of colours",
    ".ies": "an IES luminaire file",
    ".ldt": "an EULUMDAT luminaire file",
    ".axf": "an X-Rite AxF file",
    ".abg": "a table of ABg scatter models",
    ".sdr": "an Integra table of specular reflectance",
    ".sdt": "an Integra table of specular transmittance",
    ".rad": "a Radiance scene",
}
"""What a file is by its name alone, where nothing in it tells."""


def foreign_kind(start: bytes, suffix: str = "") -> str | None:
    """What a file is by its beginning, if it is of a known format that gonio does not read; None for others.

    Args:
        start: the first bytes.
        suffix: the ending of its name, small letters.
    """
    if start.startswith(b"PK\3\4"):
        if b"[Content_Types].xml" in start or b"xl/" in start:
            return "an Excel or OpenDocument file (.xlsx)"
        return "a NumPy archive (.npz)" if re.search(rb"\.npy\b", start) else "a ZIP archive"
    for signature, kind in SIGNATURES:
        if start.startswith(signature):
            return kind
    if re.search(rb"#FORMAT[ \t]+binary", start):
        return "an ALTA file in its binary form"
    if b"com.xrite" in start:
        return ENDINGS[".axf"]
    if b"\0" in start:
        return ENDINGS.get(suffix)
    text = start.decode("latin-1").removeprefix("\xef\xbb\xbf")
    return next((kind for pattern, kind in TEXTS if re.search(pattern, text)), ENDINGS.get(suffix))

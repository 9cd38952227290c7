"""A profile as CSV: offset_mm, then R (1/mm²) and perhaps u_R, or R_NAME and u_R_NAME of each channel.

# name = marble
# illuminated_radius_mm = 0.5
# viewed_radius_mm = 0.5
offset_mm,R_450 nm,u_R_450 nm
"""

import csv
import os
import re
from pathlib import Path

import numpy as np

from gonio.data.channels import Channels
from gonio.data.files import input_size, new_file, stem
from gonio.data.flags import Flag
from gonio.data.profile import Profile
from gonio.models.errors import GonioError

OFFSET = "offset_mm"
RADII = ("illuminated_radius_mm", "viewed_radius_mm")
FOREIGN = re.compile(r"\s*offsets?(?![a-z])[^,;\t]*[,;\t]\s*R(?![a-z])", re.IGNORECASE).match
"""A header that means a profile in another unit, or with other separators."""
HEAD = 4096
LARGEST = 16 << 20


def is_profile(path: str | os.PathLike[str]) -> bool:
    """Whether the header of a text file begins with the offset of a profile; False for what is no file."""
    try:
        input_size(path)
        with open(path, "rb") as file:
            start = file.read(HEAD).decode("utf-8-sig", "replace")
    except (GonioError, OSError):
        return False
    return _header(start.splitlines()) is not None


def _header(lines: list[str]) -> int | None:
    """The line whose first column is called an offset, in whatever unit; None where there is none."""
    return next((k for k, line in enumerate(lines) if line.lstrip().startswith(f"{OFFSET},") or FOREIGN(line)), None)


def read_profile(path: str | os.PathLike[str]) -> Profile:
    """The profile of a CSV file. Raises GonioError, naming the file and the line, for anything else."""
    if input_size(path) > LARGEST:
        raise GonioError(f"{path} is larger than any profile; export fewer offsets")
    lines = Path(path).read_text("utf-8-sig", "replace").splitlines()
    comments = [line.lstrip("# ") for line in lines if line.startswith("#")]
    first = _header(lines) or 0
    if not lines[first].lstrip().startswith(f"{OFFSET},"):
        raise GonioError(
            f"{path}: its header is {lines[first].strip()[:80]!r}; a profile's is '{OFFSET},R,u_R', with commas: "
            "offsets in mm, R in 1/mm²; convert and rename the columns"
        )
    try:
        names, *rows = csv.reader(lines[first:])
    except csv.Error as error:
        raise GonioError(f"{path}: its cells cannot be told apart ({error}); write numbers without quotes") from None
    names = [name.strip() for name in names]
    kinds = [re.fullmatch(r"(u_)?R(?:_(.+))?", name) for name in names[1:]]
    if not all(kinds) or len(set(names)) < len(names):
        raise GonioError(
            f"{path}: its columns are {', '.join(names)[:80]}; expected {OFFSET}, R or R_NAME, and u_R beside"
        )
    numbers = []
    for k, row in enumerate(rows):
        if not "".join(row).strip():
            continue
        try:
            numbers.append([float(cell) if cell.strip() else np.nan for cell in row])
        except ValueError:
            raise GonioError(f"{path}: line {first + k + 2} holds no numbers; give mm and 1/mm²") from None
        if len(row) != len(names):
            raise GonioError(f"{path}: line {first + k + 2} has {len(row)} cells, the header {len(names)}")
    return _profile(path, comments, dict(zip(names, np.array(numbers).reshape(-1, len(names)).T, strict=True)))


def _profile(path: str | os.PathLike[str], comments: list[str], columns: dict[str, np.ndarray]) -> Profile:
    values = [name for name in columns if name.startswith("R")]
    value = np.stack([columns[name] for name in values], axis=1) if values else np.zeros((0, 0))
    none = np.full(columns[OFFSET].shape, np.nan)
    u = np.stack([columns.get(f"u_{name}", none) for name in values], axis=1) if values else value
    channels = [name[2:] for name in values]
    lengths = [_wavelength(name) for name in channels]
    radii = dict.fromkeys(RADII, 0.0)
    title = stem(path)
    for comment in comments:
        name, equals, text = (piece.strip() for piece in comment.partition("="))
        if name == "name" and text:
            title = text
        if name in radii and equals:
            try:
                radii[name] = float(text)
            except ValueError:
                raise GonioError(f"{path}: {name} is {text[:40]!r}; give mm") from None
    try:
        known = (
            Channels.grey() if channels == [""]
            else Channels.of_wavelengths([nm for nm in lengths if nm]) if all(lengths) and channels
            else Channels(tuple(channels))
        )  # fmt: skip
        flag = np.where(np.isfinite(value), np.uint8(Flag.VALID), np.uint8(Flag.NOT_MEASURED))
        return Profile(
            columns[OFFSET], value, u, flag, known, radii[RADII[0]], radii[RADII[1]], {"source": "CSV"}, title
        )
    except GonioError as error:
        raise GonioError(f"{path}: {error}") from None


def _wavelength(name: str) -> float | None:
    """The wavelength in nm that names a channel, in nm or µm; None for another name."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?) ?(nm|[uµμ]m)", name)
    if match is None:
        return None
    return float(match[1]) if match[2] == "nm" else round(1000 * float(match[1]), 9)


def write_profile(path: str | os.PathLike[str], profile: Profile, force: bool = False) -> Path:
    """Writes a profile at full precision, whole or not at all; its provenance and its flags are lost."""
    names = profile.channels.names
    suffixes = [""] if len(names) == 1 and profile.channels.wavelengths_nm is None else [f"_{name}" for name in names]
    header = [OFFSET, *(f"{kind}R{suffix}" for suffix in suffixes for kind in ("", "u_"))]
    with new_file(path, force) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        if profile.name.isprintable() and profile.name.strip():
            file.write(f"# name = {profile.name}\n")
        for name, radius in zip(RADII, (profile.illuminated_radius, profile.viewed_radius), strict=True):
            file.write(f"# {name} = {radius!r}\n")
        table = csv.writer(file, lineterminator="\n")
        table.writerow(header)
        for k, offset in enumerate(profile.offsets):
            pairs = zip(profile.value[k], profile.u[k], profile.valid[k], strict=True)
            cells = [repr(float(number)) if there else "" for v, u, there in pairs for number in (v, u)]
            table.writerow([repr(float(offset)), *cells])
    return Path(path)

"""Files that hold a profile of light below a surface: HDF5, or CSV with the column offset_mm."""

import os
from pathlib import Path

from gonio.data.files import input_size
from gonio.data.formats.csv import profile_file
from gonio.data.profile import Profile
from gonio.models.errors import GonioError

CSV, HDF5 = (".csv",), (".h5", ".hdf5", ".nc")


def holds_profile(path: str | os.PathLike[str]) -> bool:
    """Whether a file is one of a profile; False for any other, and for what is no file."""
    if not _is_hdf5(path):
        return profile_file.is_profile(path)
    from gonio.data.hdf5 import reader  # h5py is loaded with the first such file

    return reader.holds_profile(path)


def _is_hdf5(path: str | os.PathLike[str]) -> bool:
    try:
        input_size(path)  # no pipe is waited for
        with open(path, "rb") as start:
            return start.read(4) == b"\x89HDF"
    except (GonioError, OSError):
        return False


def open_profile(path: str | os.PathLike[str]) -> Profile:
    """The profile of a file. Raises GonioError, naming the file and what is wrong, for anything else."""
    if profile_file.is_profile(path):
        return profile_file.read_profile(path)
    from gonio.data.hdf5 import reader

    return reader.open_profile(path)


def profile_of(subject: object) -> Profile | None:
    """The profile that a subject is, or whose file it names; None for anything else."""
    if isinstance(subject, Profile):
        return subject
    return open_profile(subject) if isinstance(subject, str | os.PathLike) and holds_profile(subject) else None


def require_profile_ending(path: str | os.PathLike[str]) -> None:
    """Raises GonioError where a profile is not written under such a name."""
    if Path(path).suffix.lower() not in (*CSV, *HDF5):
        raise GonioError(f"{path} is to hold a profile; give a name that ends in .h5 or .csv")


def write_profile(path: str | os.PathLike[str], profile: Profile, force: bool = False) -> Path:
    """Writes a profile in the format of the path's ending, whole or not at all, and returns the path."""
    from gonio.data.hdf5 import profile_writer

    require_profile_ending(path)
    write = profile_file.write_profile if Path(path).suffix.lower() in CSV else profile_writer.write_profile
    return write(path, profile, force)

"""A profile written as one HDF5 file, laid out as netCDF-4 does."""

import io
import json
import os
from pathlib import Path

import h5py
import numpy as np

from gonio.data.files import new_file
from gonio.data.flags import FLAG_MEANINGS, Flag
from gonio.data.hdf5.schema import GONIO_FORMAT, PROFILE_LAYOUT, channel_scale
from gonio.data.profile import Profile

LONG_NAMES = {
    "R": "mean exitance of the viewed spot per flux of the illuminated one: pi times radiance over flux, at the normal",
    "u_R": "standard uncertainty of the expected reading; 0 exact, NaN unknown",
    "flag": "why a reading has no value",
}


def write_profile(path: str | os.PathLike[str], profile: Profile, force: bool = False) -> Path:
    """Writes a profile, whole or not at all, and returns its path.

    Raises GonioError where `path` exists (unless `force`) or cannot be written.
    """
    content = io.BytesIO()  # HDF5 itself breaks down on a disk that is full; a profile is small
    with h5py.File(content, "w", libver=("earliest", "v110")) as file:
        file.attrs.update(
            {
                "Conventions": "CF-1.10",
                "gonio_format": np.int32(GONIO_FORMAT),
                "layout": PROFILE_LAYOUT,
                "title": profile.name,
                "channel_names": json.dumps(list(profile.channels.names)),
                "provenance": json.dumps(profile.provenance, sort_keys=True),
                "illuminated_radius_mm": float(profile.illuminated_radius),
                "viewed_radius_mm": float(profile.viewed_radius),
            }
        )
        offset = file.create_dataset("offset", data=np.asarray(profile.offsets, float), track_times=False)
        offset.attrs.update({"units": "mm", "long_name": "from the illuminated to the viewed spot, along a line"})
        offset.make_scale("offset")
        scales = offset, channel_scale(file, profile.channels)
        values = {"R": profile.value, "u_R": profile.u, "flag": profile.flag}
        for name, value in values.items():
            node = file.create_dataset(name, data=value, track_times=False)
            node.attrs["long_name"] = LONG_NAMES[name]
            for dimension, scale in zip(node.dims, scales, strict=True):
                dimension.attach_scale(scale)
        file["R"].attrs["units"] = file["u_R"].attrs["units"] = "mm-2"
        file["R"].attrs["ancillary_variables"] = "u_R flag"
        file["flag"].attrs["flag_values"] = np.array([int(v) for v in Flag], np.uint8)
        file["flag"].attrs["flag_meanings"] = " ".join(FLAG_MEANINGS)
    with new_file(path, force) as temporary:
        temporary.write_bytes(content.getvalue())
    return Path(path)

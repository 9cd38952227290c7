"""Tables as xarray datasets: by way of the netCDF file itself, so that names, dimensions and attributes are its own."""

import importlib
import json
import tempfile
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from gonio.data.hdf5.reader import open_table
from gonio.data.hdf5.writer import write_table
from gonio.data.layouts import LAYOUTS
from gonio.data.table import Table
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    import xarray


def to_dataset(table: Table) -> "xarray.Dataset":
    """The dataset that ``xarray.open_dataset(file, engine="h5netcdf")`` gives of the table's file, in memory.

    Raises GonioError where xarray or h5netcdf is not installed.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = write_table(Path(folder, "table.h5"), table)
        return _xarray().load_dataset(path, engine="h5netcdf")


def from_dataset(dataset: "xarray.Dataset") -> Table:
    """The table of a dataset as `to_dataset` makes it. Raises GonioError for one that lacks what a table has."""
    _xarray()
    dataset = _as_written(dataset)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "table.h5")
        try:
            dataset.to_netcdf(path, engine="h5netcdf")
        except (AttributeError, TypeError, ValueError) as error:
            raise GonioError(f"this is no dataset of a table ({error}); give what Table.to_xarray returns") from None
        try:
            table = open_table(path, lazy_bytes=1 << 62)
        except GonioError as error:
            raise GonioError(str(error).replace(str(path), "the dataset")) from None
    if table.u_f is not None and np.isnan(table.u_f).all():  # xarray has no word for unknown everywhere
        table.u_f = None
    return table


def _as_written(dataset: "xarray.Dataset") -> "xarray.Dataset":
    """The dataset with its dimensions in the order of its layout, and the names of its channels by its coordinate."""
    layout = LAYOUTS.get(dataset.attrs.get("layout", ""))
    if layout is None or "channel" not in dataset.coords or "channel" not in dataset.dims:
        return dataset
    order = [kind.name for kind in layout.axis_kinds if kind.name in dataset.dims]
    names = [str(name) for name in dataset["channel"].values]
    return dataset.transpose(..., *order, "channel").assign_attrs(channel_names=json.dumps(names))


def _xarray() -> ModuleType:
    try:
        importlib.import_module("h5netcdf")
        return importlib.import_module("xarray")
    except ImportError as error:
        raise GonioError(f"{error.name} is not installed; install it: pip install xarray h5netcdf") from None

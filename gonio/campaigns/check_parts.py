"""The check of a large table in parts, each a task of its own: put together, the file that one task would write."""

import dataclasses
import os
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from gonio.campaigns import table_parts
from gonio.campaigns.store import PART, Store
from gonio.campaigns.table_parts import LostPart
from gonio.checks.certificate import Certificate
from gonio.checks.certify import CheckSettings
from gonio.checks.shares import Arrays, Share, do_share, is_ordinary, put_together, shares_of
from gonio.data.formats.registry import read
from gonio.data.layouts import Layout
from gonio.data.table import Table
from gonio.models.errors import GonioError


class Size(NamedTuple):
    """What is known of a table before it is read: its layout, and how many channels it has."""

    layout: Layout
    channels: int

    @property
    def is_large(self) -> bool:
        """Whether work on it is cut."""
        return self.layout.size * self.channels >= 2 * table_parts.PART_VALUES


def size_of_file(path: str) -> Size | None:
    """That of a table's file from which the values of a large one can be read in blocks; None for others."""
    import h5py

    try:
        if os.path.getsize(path) < table_parts.PART_VALUES or not h5py.is_hdf5(path):
            return None
        table = read(path, blockwise=True)
    except (OSError, GonioError):  # said by the tasks
        return None
    return Size(table.layout, len(table.channels)) if is_ordinary(table) else None


def check_shares(size: Size | None, options: Mapping[str, Any]) -> list[Share]:
    """The shares of the check of a table that are tasks of their own; none of a small one."""
    if size is None or not size.is_large:
        return []
    return shares_of(size.layout, size.channels, CheckSettings(**options), table_parts.PART_VALUES)


def part_of_check(table: Table, inputs: dict[str, Any]) -> Arrays:
    """What a share of a table's check comes to."""
    return do_share(table, Share(*inputs["share"]), CheckSettings(**inputs["options"]))


def check_of_parts(table: Table, name: str, inputs: dict[str, Any], store: Store) -> Certificate:
    """The certificate of a table whose shares are there. Raises LostPart where one is not."""
    settings = dataclasses.replace(CheckSettings(**inputs["options"]), name=name)
    return put_together(table, settings, _stored(inputs, store))


def _stored(inputs: dict[str, Any], store: Store) -> Iterator[tuple[Share, Arrays]]:
    for share, key in zip(inputs["shares"], inputs["parts"], strict=True):
        try:
            with np.load(store.path(PART, key), allow_pickle=False) as file:
                yield Share(*share), {name: file[name] for name in file.files}
        except FileNotFoundError:
            raise LostPart(f"a part of a check is gone from {store.folder}") from None

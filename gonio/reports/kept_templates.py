"""Compiled templates, kept beside compiled programs: to compile those of a page takes as long as to fill them."""

import functools
import sys
from importlib.metadata import version

from jinja2.bccache import Bucket, BytecodeCache

from gonio.models.compiled import kept


class KeptTemplates(BytecodeCache):
    """Templates as Python's code, by their text and by what compiled them."""

    def load_bytecode(self, bucket: Bucket) -> None:
        """Takes the code of a template from disk, if it is there."""
        if (code := kept.read(_name(bucket))) is not None:
            bucket.bytecode_from_string(code)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keeps the code of a template."""
        kept.write(_name(bucket), bucket.bytecode_to_string())


@functools.cache
def _jinja() -> str:
    return version("jinja2")


def _name(bucket: Bucket) -> str:
    return kept.key("template", _jinja(), sys.version, bucket.key, bucket.checksum)

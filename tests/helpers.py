"""What several tests share: where the witnesses outside the project are."""

import pathlib

import pytest

SHARED = pathlib.Path(__file__).resolve().parents[2] / "shared"


def shared(*parts: str) -> pathlib.Path:
    """A file of the independent data that may stand beside the project; the test is skipped where it is absent."""
    path = SHARED.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"independent data {'/'.join(parts)} not beside the project")
    return path

"""Settings of a test that `make test` leaves to `make thorough`."""

from typing import Any

import pytest


def thorough(*settings: Any) -> list[Any]:
    """Settings of `parametrize` that run in `make thorough` alone: those beside them show the same law.

    Args:
        settings: one for each test; a tuple holds one value for each argument.
    """
    return [pytest.param(*(s if isinstance(s, tuple) else (s,)), marks=pytest.mark.thorough) for s in settings]

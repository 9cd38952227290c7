"""Paths between shots are searched for a shorter time than users wait: what is promised of plans holds for any path."""

import pytest

from gonio.planning import planner


@pytest.fixture(autouse=True, scope="package")
def patience():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planner, "SOLVER_SECONDS", 0.1)
        patch.setattr(planner, "QUICK_SECONDS", 0.05)
        yield

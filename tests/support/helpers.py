"""What several tests share: where the witnesses outside the project are."""

import json
import pathlib
from collections.abc import Iterator

import numpy as np
import pytest

from gonio.models.geometry.directions import Direction

SHARED = pathlib.Path(__file__).resolve().parents[3] / "shared"


def shared(*parts: str) -> pathlib.Path:
    """A file of the independent data that may stand beside the project; the test is skipped where it is absent."""
    path = SHARED.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"independent data {'/'.join(parts)} not beside the project")
    return path


def witnessed(word: str) -> Iterator[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """(expression there, f, wi, wo) of each model of an independent implementation whose expression holds a word.

    wi and wo are (3, n); f has the shape (n, channels), in double precision.
    """
    data = np.load(shared("oracle", "models_double.npz"), allow_pickle=False)
    for spelled, values in zip(data["model"], data["f"], strict=True):
        if word in spelled:
            yield str(spelled), values, data["wi"].T, data["wo"].T


def mitsuba(kind):
    """(name, description, wi, wo, f cosθo, which pairs are above the horizon) of each entry of one type."""
    said = json.loads(shared("oracle", "mitsuba.json").read_text())
    d = np.load(shared("oracle", "mitsuba.npz"))
    for name, v in said.items():
        if v["type"] == kind and f"{name}/wi" in d:
            wi, wo, f_cos = (d[f"{name}/{k}"].astype(float) for k in ("wi", "wo", "f_cos"))
            above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
            yield name, v, Direction(*wi.T), Direction(*wo.T), f_cos, above

"""The charts of speed against accuracy that back the settings: read from a folder that `gonio chart` wrote."""

import base64
import datetime
import json
import os
from pathlib import Path
from typing import Any

from gonio.charts.diagrams import CHARTS, INDEX
from gonio.charts.figure import picture_files
from gonio.charts.point import Point, front, shown
from gonio.data.serialise import plain
from gonio.models.errors import GonioError

LARGEST = 64 << 20
MEDIA = {"svg": "image/svg+xml", "png": "image/png"}


def charts_of(folder: str | os.PathLike[str]) -> list[dict[str, Any]]:
    """Each chart with its title, caption, picture (the address of an image) and the points that no other beats.

    Raises GonioError, in one sentence, for what is no folder of charts, and for one that is damaged.
    """
    path = Path(folder) / INDEX
    if not Path(folder).is_dir():
        raise GonioError(f"{folder} is no folder; give one that 'gonio chart -o FOLDER' wrote")
    if not path.is_file():
        raise GonioError(f"{folder} holds no {INDEX}; make it by 'gonio chart -o {folder}'")
    try:
        if path.stat().st_size > LARGEST:
            raise ValueError
        stored = json.loads(path.read_text(encoding="utf-8"))["charts"]
        charts = [_chart(Path(folder), name, stored[name]) for name in CHARTS if name in stored]
    except (ValueError, KeyError, AttributeError, TypeError, OSError):
        raise GonioError(f"{path} is no list of charts; make it again by 'gonio chart -o {folder} --force'") from None
    if not charts:
        raise GonioError(f"{path} lists no chart; make some by 'gonio chart -o {folder}'")
    return charts


def _chart(folder: Path, name: str, stored: dict) -> dict[str, Any]:
    points = [Point.from_dict(p) for p in stored["points"]]
    cost, error = stored["frames"][0]
    best = [
        {
            "panel": p.panel, "method": p.method, "setting": p.setting, "cost": p.value(cost["key"]),
            "error": shown(p, error["key"]), "bound": p.value("bound"), "note": p.note,
        }
        for panel in dict.fromkeys(p.panel for p in points)
        for p in front([q for q in points if q.panel == panel], cost["key"], error["key"])
    ]  # fmt: skip
    return {
        "name": name,
        **{key: str(stored[key]) for key in ("title", "about", "caption")},
        "made": datetime.datetime.fromisoformat(stored["made"]).isoformat(timespec="seconds"),
        "cost": str(cost["title"]),
        "error": str(error["title"]),
        "claims": any(p.holds is not None for p in points),
        "picture": _picture(folder, name, points, str(stored["caption"])),
        "front": plain(best),
    }


def _picture(folder: Path, name: str, points: list[Point], caption: str) -> str:
    # As an image, in which a browser runs no script and asks for no other file.
    for kind, media in MEDIA.items():
        path = folder / f"{name}.{kind}"
        if path.is_file() and 0 < path.stat().st_size <= LARGEST:
            return f"data:{media};base64,{base64.b64encode(path.read_bytes()).decode()}"
    data = picture_files(CHARTS[name], points, caption)["svg"]
    return f"data:{MEDIA['svg']};base64,{base64.b64encode(data).decode()}"

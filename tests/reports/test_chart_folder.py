"""Charts of speed against accuracy on a page: as images, and their fronts as tables."""

import datetime
import json
import math

import gonio
from gonio.charts import MeasuredChart
from gonio.charts.diagrams import CHARTS
from gonio.charts.point import Point
from gonio.instrument.pace import Pace


def test_charts_back_the_settings(tmp_path, monkeypatch):
    chart = CHARTS["hemisphere"]
    cost, error = (axis.key for axis in chart.frames[0])
    points = tuple(
        Point("α 0.1", f"<b>{k}", str(k), {cost: 10.0**-k, error: 10.0 ** (k - 6), "bound": 1.0}) for k in range(3)
    )
    keys = ("processor", "cores", "device", "gonio", "jax", "numpy", "scipy", "python")
    now = datetime.datetime.now(datetime.UTC)
    measured = MeasuredChart(chart, points, dict.fromkeys(keys, "x"), now, 1.0, True, Pace())
    index = {"gonio_charts": 1, "charts": {"hemisphere": measured.to_dict() | {"recipe": {}}}}
    (tmp_path / "charts.json").write_text(json.dumps(index))
    (tmp_path / "hemisphere.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    gonio.report("perfect_diffuser", tmp_path / "r.html", check=False, chart=tmp_path)
    text, values = (tmp_path / "r.html").read_text(), json.loads((tmp_path / "r.json").read_text())
    assert "data:image/svg+xml;base64," in text and "<b>0" not in text and "claimed bound" in text
    assert len(values["charts"][0]["front"]) == 3 and math.isclose(values["charts"][0]["front"][0]["bound"], 1.0)

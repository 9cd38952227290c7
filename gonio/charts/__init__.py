"""Speed against accuracy, measured here and now: one module a chart."""

from gonio.charts.diagrams import chart as chart
from gonio.charts.point import Axis as Axis
from gonio.charts.point import Chart as Chart
from gonio.charts.point import Point as Point
from gonio.charts.result import MeasuredChart as MeasuredChart
from gonio.instrument.pace import Pace as Pace

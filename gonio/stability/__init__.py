"""The stability atlas: every method over its regimes, against a reference that is not the same code."""

from gonio.stability.outcome import Cell as Cell
from gonio.stability.result import Atlas as Atlas
from gonio.stability.survey import stress as stress

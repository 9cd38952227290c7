"""What interpolation of one side of a table may be off by."""

import math
from typing import NamedTuple

import numpy as np

RECTANGULAR = math.sqrt(3.0)
"""Bounds over their standard uncertainty, where any value within is as likely [JCGM 100:2008, 4.3.7]."""


class Uncertain(NamedTuple):
    """Of n pairs of directions (n, C), 1/sr: what readings' noise leaves in f, and a standard uncertainty of what lies
    between them, infinite where nothing bounds it."""

    noise: np.ndarray
    between: np.ndarray

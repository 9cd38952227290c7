"""Readings that should be equal, compared in one pass over the channels, and judged by what is known of their noise."""

from typing import NamedTuple

import numpy as np

from gonio.checks.certificate import FAIL, UNDECIDED, Property
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.level_tests import LevelTests
from gonio.checks.table.pairs.pairs import Pairs
from gonio.checks.table.regions import judged_by_regions
from gonio.checks.table.significance import judged_by_level
from gonio.checks.table.statistics.differences import Differences

MAY_BE_INTERPOLATION = " Some of that may come of interpolating between readings that are far apart."
BETWEEN_READINGS = " Between readings so far apart f may change by as much: no reading shows a violation."


class Compared(NamedTuple):
    """Pairs of readings that should be equal, and what they differ by; `sign` (n,) that of a violation, 0 unknown."""

    pairs: Pairs
    sign: np.ndarray
    differences: Differences
    tests: LevelTests

    def judged(self, name: str, evidence: TableEvidence, tolerance: float, what: str) -> Property:
        """The property that they are equal: by stated uncertainties at the level of the evidence, else by regions."""
        count, number = self.differences.by_channel, int(np.count_nonzero(self.differences.comparable))
        if self.differences.decided_by_uncertainty:
            return judged_by_level(name, self.tests, tolerance, f"{what} over {number:,} pairs ({self.pairs.how})")
        compared = f"{what} over {count.max():,} pairs ({self.pairs.how})"
        return judged_by_regions(name, evidence, self.pairs, self.sign, count, tolerance, compared)


def compare(evidence: TableEvidence, pairs: Pairs, sign: np.ndarray) -> Compared:
    """One pass over the channels of pairs."""
    differences, tests = Differences(pairs), LevelTests(evidence, pairs, sign)
    for channel, column in enumerate(pairs.columns()):
        differences.add(channel, column)
        tests.add(channel, column)
    return Compared(pairs, sign, differences, tests)


def only_surely(judged: Property, surely: Property, reason: str = BETWEEN_READINGS) -> Property:
    """What fails, unless what it is judged by a second time leaves it open, for a reason."""
    if surely.verdict == FAIL:
        return surely
    judged.verdict = UNDECIDED
    judged.detail += reason
    return judged

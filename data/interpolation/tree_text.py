"""The text of scattering data: numbers between blanks or commas, and trees of them in braces."""

import warnings

import numpy as np

from gonio.data.interpolation.scattering_blocks import Tree
from gonio.models.errors import GonioError

MOST_NODES = 1 << 21
MOST_LEVELS = 12
"""Halvings of the unit cube's side."""


def parse_numbers(text: str, what: str) -> np.ndarray:
    """(n,) the numbers of a text, between blanks or commas. Raises GonioError, naming `what`, for anything else."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            values = np.fromstring(text.replace(",", " "), sep=" ")
        except (DeprecationWarning, ValueError):
            raise GonioError(f"{what}: the scattering data are no list of numbers") from None
    if not values.size or not np.isfinite(values).all():
        raise GonioError(f"{what}: the scattering data are empty or hold values that are not finite")
    return values


def parse_tree(text: str, dimensions: int, what: str) -> Tree:
    """The tree of a text in braces: 2^dimensions branches each, or a leaf of 2^(dimensions·k) numbers.

    Raises GonioError, naming `what`, for braces that do not pair, branches or numbers that are too few or too many, and
    trees too large or too deep.
    """
    raw = np.frombuffer(text.encode("ascii", "replace"), np.uint8)
    brace = np.flatnonzero((raw == ord("{")) | (raw == ord("}")))
    opens = raw[brace] == ord("{")
    if not 2 <= brace.size <= 2 * MOST_NODES:
        raise GonioError(f"{what}: the tensor tree has {brace.size // 2:,} nodes, expected 1 to {MOST_NODES:,}")
    blank = (raw == ord(",")) | (raw <= ord(" ")) | (raw == ord("{")) | (raw == ord("}"))
    starts = ~blank & np.concatenate([[True], blank[:-1]])
    numbers_before = np.cumsum(starts, dtype=np.int32)[brace]
    values = parse_numbers(text.replace("{", " ").replace("}", " "), what)
    if numbers_before[0] or numbers_before[-1] != values.size:
        raise GonioError(f"{what}: numbers stand outside of the braces of the tensor tree")
    builder = _Builder(dimensions, what)
    for k in range(brace.size):
        if not opens[k]:
            builder.close()
        elif k + 1 < brace.size and not opens[k + 1]:
            builder.leaf(int(numbers_before[k]), int(numbers_before[k + 1]))
        else:
            builder.open()
    return builder.tree(values)


class _Builder:
    """A tree as its braces come, one after another. A path is the number whose digits are the branches taken."""

    def __init__(self, dimensions: int, what: str) -> None:
        self.dimensions, self.what, self.branches = dimensions, what, 1 << dimensions
        self.children: list[list[int]] = []
        self.leaves: list[tuple[int, int, int, int]] = []
        """Where the numbers begin, log₂ of the cells along each side, the path, and the nodes above."""
        self.stack: list[tuple[int, int]] = []
        """The number and the path of each open node."""
        self.depth, self.whole, self.in_leaf = 0, False, False

    def _fail(self, text: str) -> GonioError:
        return GonioError(f"{self.what}: {text}")

    def _enter(self, reference: int) -> int:
        """Enters a node or leaf below the last node; its path."""
        if not self.stack:
            if self.whole:
                raise self._fail("numbers or nodes stand behind the tensor tree")
            self.whole = True
            return 0
        node, path = self.stack[-1]
        branch = len(self.children[node])
        if branch >= self.branches:
            raise self._fail(f"a node of the tensor tree has more than {self.branches} branches")
        self.children[node].append(reference)
        return path << self.dimensions | branch

    def open(self) -> None:
        number = len(self.children)
        self.stack.append((number, self._enter(number)))
        self.children.append([])
        self.depth = max(self.depth, len(self.stack))
        if self.depth > MOST_LEVELS:
            raise self._fail(f"the tensor tree is more than {MOST_LEVELS} levels deep")

    def leaf(self, start: int, stop: int) -> None:
        level, rest = divmod((stop - start).bit_length() - 1, self.dimensions)
        if stop == start or rest or (stop - start).bit_count() != 1 or level + self.depth > MOST_LEVELS:
            raise self._fail(f"a leaf of the tensor tree has {stop - start:,} numbers, expected a grid of powers of 2")
        self.leaves.append((start, level, self._enter(-1 - len(self.leaves)), len(self.stack)))
        self.in_leaf = True

    def close(self) -> None:
        if self.in_leaf:
            self.in_leaf = False
        elif not self.stack:
            raise self._fail("a brace of the tensor tree closes that was not open")
        elif len(self.children[self.stack[-1][0]]) != self.branches:
            raise self._fail(f"a node of the tensor tree has fewer than {self.branches} branches")
        else:
            self.stack.pop()

    def tree(self, values: np.ndarray) -> Tree:
        if self.stack or self.in_leaf:
            raise self._fail("a brace of the tensor tree stays open")
        leaves = np.array(self.leaves, np.int64).reshape(-1, 4)
        if int(np.sum(1 << leaves[:, 1] * self.dimensions)) != values.size:
            raise self._fail("numbers stand beside the branches of a node of the tensor tree")
        low, size = np.empty((values.size, self.dimensions)), np.empty(values.size)
        for level in np.unique(leaves[:, 1]):
            start, _, path, above = leaves[leaves[:, 1] == level].T
            cells = np.indices((1 << level,) * self.dimensions).reshape(self.dimensions, -1).T
            side = 0.5 ** (above + level)
            numbers = start[:, None] + np.arange(len(cells))
            low[numbers] = self._corners(path, above)[:, None] + cells * side[:, None, None]
            size[numbers] = side[:, None]
        children = np.array(self.children, np.int32).reshape(-1, self.branches)
        return Tree(values, low, size, children, leaves[:, :2].astype(np.int32), self.depth)

    def _corners(self, path: np.ndarray, above: np.ndarray) -> np.ndarray:
        """(n, dimensions): the least corners of nodes by their paths and the nodes above them."""
        corner = np.zeros((path.size, self.dimensions))
        for k in range(int(above.max(initial=0))):
            # The last branch halves the smallest cube
            half = np.where(k < above, 0.5 ** (above - k), 0.0)
            bits = path[:, None] >> (k * self.dimensions + np.arange(self.dimensions)) & 1
            corner += half[:, None] * bits
        return corner

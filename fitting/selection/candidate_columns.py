"""Where the numbers of a candidate's terms come from: free numbers, those that channels share, and fixed ones."""

import dataclasses
import functools

import numpy as np

from gonio.fitting.problem.parameterisation import Domains, Parameters, domain_kind, parameters
from gonio.fitting.selection.term_spec import Terms, TermSpec, expression_of, kernel_arguments
from gonio.models.expression.builder import Frame
from gonio.models.expression.parser import FACTOR, parse, with_defaults

MIN_WIDTH = 1e-3
USUAL = {"f0": 1.0, "k": 0.0}
"""Shapes that a term has where its expression has none: Schlick's F₀ = 1 is F = 1."""

DIFFUSE = {"lambert": ("rho", True), "lambert_transmission": ("tau", False)}
"""Even diffusers: the name of their share, and whether they reflect, or transmit."""


@functools.lru_cache(maxsize=512)
def candidate_parameters(terms: Terms, channels: int) -> Parameters:
    """The free parameters of a candidate over so many channels, and its fixed values."""
    return parameters(with_defaults(parse(expression_of(terms))), channels)


@functools.lru_cache(maxsize=512)
def candidate_domains(terms: Terms, channels: int) -> Domains:
    """Their closed domains: no lobe is narrower than `MIN_WIDTH`, and scales step in their logarithm."""
    free = candidate_parameters(terms, channels).parameterisation
    kind, low, high = free.domains
    kind = np.where(free.each(lambda g: g.path == FACTOR), domain_kind(0.0, True), kind)
    return Domains(kind, np.where(free.each(lambda g: g.info.role == "width"), MIN_WIDTH, low), high)


def lobe_of(term: TermSpec) -> Frame:
    """A term without its shapes."""
    inside = (("base", (Frame(term.base, (), ()),)),) if term.base else ()
    return Frame(term.model, tuple(sorted(term.options)), inside)


@dataclasses.dataclass(frozen=True)
class TermColumns:
    """Where the shapes and the scale of one term come from, and what the derivatives by its free parameters are.

    Attributes:
        names: the shapes (K,) that its lobe takes.
        known: their fixed values (K,).
        number: the free number (1 or C, K) of each shape in each channel where shapes differ; −1 where it is fixed.
        scale: its fixed value.
        scale_number: the free number (C,) that it is in each channel; None where it is fixed.
        slopes: of each free parameter its index, and the shapes that it is; none of the scale.
    """

    names: tuple[str, ...]
    known: np.ndarray
    number: np.ndarray
    scale: float
    scale_number: np.ndarray | None
    slopes: tuple[tuple[int, tuple[int, ...]], ...]

    def shapes(self, p: np.ndarray) -> np.ndarray:
        """Shapes (S, 1 or C, K) of vectors p (S, P)."""
        return np.where(self.number >= 0, p[:, self.number], self.known)

    def scales(self, p: np.ndarray) -> np.ndarray | float:
        """Scales (S, C) of vectors p (S, P), or the fixed one."""
        return self.scale if self.scale_number is None else p[:, self.scale_number]


@functools.lru_cache(maxsize=512)
def term_columns(terms: Terms, channels: int) -> tuple[TermColumns, ...]:
    """Those of each term."""
    every, fixed, _ = candidate_parameters(terms, channels)
    made = []
    for k, term in enumerate(terms):
        free = {g.path: (index, g) for index, g in enumerate(every.free) if g.term == k}
        shapes = [path for path in (*fixed[k], *free) if path != FACTOR]
        names = (DIFFUSE[term.model][0],) if term.model in DIFFUSE else kernel_arguments(term)
        alike = {"alpha_x": "alpha", "alpha_y": "alpha"} if "alpha" in shapes and "alpha_x" in names else {}
        paths = [alike.get(name, name) for name in names]
        differ = any(g.per_channel for path, (_, g) in free.items() if path != FACTOR)
        number = np.full((channels if differ else 1, len(names)), -1)
        for j, path in enumerate(paths):
            if path in free:
                number[:, j] = every.columns[: len(number), free[path][0]]
        known = [float(fixed[k].get(path, USUAL.get(path, np.nan))) for path in paths]
        scale_number = every.columns[:, free[FACTOR][0]] if FACTOR in free else None
        slopes = tuple(
            (index, () if path == FACTOR else tuple(j for j, of in enumerate(paths) if of == path))
            for path, (index, _) in free.items()
        )
        scale = float(fixed[k].get(FACTOR, 1.0))
        made.append(TermColumns(names, np.array(known), number, scale, scale_number, slopes))
    return tuple(made)

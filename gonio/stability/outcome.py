"""One cell of the atlas: a method, a model, a regime, and the verdict on it."""

import dataclasses

RIGHT, SAYS_SO, SILENT = "right", "says so", "silently wrong"
VERDICTS = (RIGHT, SAYS_SO, SILENT)
METHODS = ("value", "gradient", "sampler", "integral", "fit")
HARD = "hard fits"
"""Stands for the model of fits that are known to be hard, of sums of several lobes."""


@dataclasses.dataclass(frozen=True)
class Cell:
    """The largest error of a method in one regime, with its verdict.

    `row` is the setting of the model (an expression), `column` the rest of the regime (incidence, noise, ...),
    `precision` the floating-point type. `error` is that of the method, `allowed` what its own bound or the
    conditioning of its inputs allows, both in the units that `detail` names.
    """

    method: str
    model: str
    row: str
    column: str
    precision: str
    verdict: str
    error: float
    allowed: float
    detail: str

    @property
    def key(self) -> str:
        """The name by which ``gonio stress --cell`` computes this cell again."""
        return "/".join((self.method, self.row, self.column, self.precision))

    def recipe(self, quick: bool) -> str:
        """The command that computes this cell again."""
        name = f"'{HARD}'" if self.model == HARD else self.model
        return f"gonio stress {name}{' --quick' * quick} --cell '{self.key}'"


def worst(verdicts: list[str]) -> str:
    """The worst of some verdicts; right where there is none."""
    return max(verdicts, key=VERDICTS.index, default=RIGHT)

"""One place of the atlas: a method, a model, a regime, and what was found there."""

import dataclasses

RIGHT, SAYS_SO, SILENT = "right", "says so", "silently wrong"
VERDICTS = (RIGHT, SAYS_SO, SILENT)
METHODS = ("value", "gradient", "sampler", "integral", "fit")


@dataclasses.dataclass(frozen=True)
class Cell:
    """The worst that a method did in one regime.

    `row` is the setting of the model (an expression), `column` the rest of the regime (incidence, noise, ...),
    `precision` the floating-point type. `error` is what the method did, `allowed` what its own bound or the
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
        """The name that ``gonio stress --cell`` takes to do this one again."""
        return "/".join((self.method, self.row, self.column, self.precision))


def worst(verdicts: list[str]) -> str:
    """The worst of some verdicts; right where there is none."""
    return max(verdicts, key=VERDICTS.index, default=RIGHT)

"""Names for people of the numbers of a model: ``ggx.alpha``, ``coat.base.lambert.rho``."""

from gonio.models.expression.builder import Frame


def model_names(frames: tuple[Frame, ...]) -> list[str]:
    """A name for each model of a sum: its own, numbered where a model comes more than once."""
    names = [f.name for f in frames]
    return [n if names.count(n) == 1 else f"{n}{names[: i + 1].count(n)}" for i, n in enumerate(names)]


def number_label(frames: tuple[Frame, ...], term: int, path: str) -> str:
    """The name of the number at a path of a term: 'ggx.alpha', or 'coat.base.lambert.rho' inside another model."""
    words, steps = [model_names(frames)[term]], path.split(".")
    inside = frames[term]
    while len(steps) > 1:
        field, index, *steps = steps
        frames = dict(inside.inside)[field]
        inside = frames[int(index)]
        words += [field, model_names(frames)[int(index)]]
    return ".".join([*words, *steps])

"""The settings of a model that the atlas looks at: its leading parameter over its domain, the others at their edges."""

import numpy as np

from gonio.models.catalog import MODELS
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build
from gonio.models.expression.parser import Call, needed, options_of, submodels_of
from gonio.models.parameters import ParameterInfo, parameters_of

LEADING = 5
"""Values of the leading parameter."""

LEADERS = ("alpha", "n", "sigma", "k", "w", "roughness", "r", "b", "l", "h")
FRESNEL = ("", "f0=0.04", "eta=1.5", "eta=1.000001", "eta=0.2, k=3")


def settings_of(name: str) -> list[str]:
    """Spellings of one model, the leading parameter first; each can be built."""
    known = parameters_of(MODELS[name])
    wanted = list(needed(Call(name, {}, {})))
    base = {n: f"{known[n].start:g}" for n in wanted}
    inside = dict.fromkeys(submodels_of(MODELS[name]), "lambert(rho=0.8)")
    lead = next((n for n in LEADERS if n in wanted), wanted[0] if wanted else None)
    found = [{**base, lead: f"{v:.6g}"} for v in _grid(known[lead])] if lead else [base]
    found += [
        {**base, n: f"{v:.6g}"} for n in known if n in wanted and n != lead for v in (known[n].low, known[n].high)
    ]
    found += [{**base, o: c} for o, choices in options_of(MODELS[name]).items() for c in choices[1:]]
    widths = next((w for w in ("alpha", "n") if f"{w}_x" in known), None)
    if widths:
        both = {k: v for k, v in base.items() if k != widths}
        low, high = ("0.05", "0.4") if widths == "alpha" else ("10", "1000")
        found.append({**both, f"{widths}_x": low, f"{widths}_y": high})
    texts = [_spelled(name, {**inside, **f}) for f in found]
    if "f0" in known and "f0" not in wanted:
        texts += [f"{texts[len(texts) and 2][:-1]}, {said})" for said in FRESNEL if said and _takes(known, said)]
    return [t for t in dict.fromkeys(texts) if _builds(t)]


def _takes(known: dict, said: str) -> bool:
    return all(part.split("=")[0] in known for part in said.split(", "))


def _grid(info: ParameterInfo) -> np.ndarray:
    if not info.log:
        return np.linspace(info.low, info.high, LEADING)
    low = info.low if info.low > 0 else min(1e-3, info.start / 10)
    grid = np.geomspace(low, info.high, LEADING)
    return grid if info.low > 0 else np.concatenate([[info.low], grid[1:]])


def _spelled(name: str, said: dict[str, str]) -> str:
    return f"{name}({', '.join(f'{n}={v}' for n, v in said.items())})"


def _builds(text: str) -> bool:
    # Options that need a certain set of parameters refuse the others, and say so.
    try:
        build(text)
    except (GonioError, ValueError):
        return False
    return True

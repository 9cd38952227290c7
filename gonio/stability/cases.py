"""The settings of a model in the atlas: its leading parameter over its domain, the others at their edges.

They follow from the model's own parameters, options and inner models, so that a new model needs nothing here.
"""

import numpy as np

from gonio.models.catalog import MODELS
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build
from gonio.models.expression.parser import Call, needed, options_of, submodels_of
from gonio.models.parameters import ParameterInfo, parameters_of

LEADING = 5
"""Number of values of the leading parameter."""

LEADING_ROLES = ("width", "inverse_width", "shoulder", "roughness", "exponent", "length", "albedo")
"""The leading parameter is the first of the first of these roles that a model has; else its first."""

ANISOTROPIC = {"alpha": ("0.05", "0.4"), "n": ("10", "1000")}
FRESNEL = ({"f0": "0.04"}, {"eta": "1.5"}, {"eta": "1.000001"}, {"eta": "0.2", "k": "3"})


def settings_of(name: str) -> list[str]:
    """Expressions of one model, the leading parameter first; each can be built."""
    model = MODELS[name]
    known, required = parameters_of(model), list(needed(Call(name, {}, {})))
    base = {n: f"{known[n].start:g}" for n in required}
    inside = dict.fromkeys(submodels_of(model), "lambert(rho=0.8)")
    leading = (n for role in LEADING_ROLES for n in required if known[n].role == role)
    lead = next(leading, required[0] if required else None)
    changes = [{lead: f"{v:.6g}"} for v in _grid(known[lead])] if lead else [{}]
    changes += [{n: f"{v:.6g}"} for n in known if n in required and n != lead for v in (known[n].low, known[n].high)]
    settings = [{**inside, **base, **change} for change in changes]
    choices = [(option, choice) for option, every in options_of(model).items() for choice in every[1:]]
    for option, choice in choices:
        # Parameters that go with a choice come and go with it.
        with_it = needed(Call(name, {}, {option: choice}))
        kept = {n: v for n, v in base.items() if n in with_it or not known[n].only}
        starts = {n: f"{known[n].start:g}" for n in with_it if n not in kept}
        settings.append({**inside, **kept, **starts, option: choice})
    width = next((w for w in ANISOTROPIC if f"{w}_x" in known), None)
    if width:
        both = dict(zip((f"{width}_x", f"{width}_y"), ANISOTROPIC[width], strict=True))
        settings.append({**inside, **{k: v for k, v in base.items() if k != width}, **both})
    if "f0" in known and "f0" not in required:
        settings += [{**settings[min(2, len(settings) - 1)], **f} for f in FRESNEL if f.keys() <= known.keys()]
    texts = (f"{name}({', '.join(f'{n}={v}' for n, v in setting.items())})" for setting in settings)
    return [text for text in dict.fromkeys(texts) if _builds(text)]


def _grid(info: ParameterInfo) -> np.ndarray:
    if not info.log:
        return np.linspace(info.low, info.high, LEADING)
    low = info.low if info.low > 0 else min(1e-3, info.start / 10)
    grid = np.geomspace(low, info.high, LEADING)
    return grid if info.low > 0 else np.concatenate([[info.low], grid[1:]])


def _builds(text: str) -> bool:
    # Options that need a certain set of parameters refuse the others by an error.
    try:
        build(text)
    except (GonioError, ValueError):
        return False
    return True

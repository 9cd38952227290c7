"""What fits say of polarised channels: the models are of the radiance of unpolarised light."""

from collections.abc import Sequence

from gonio.data.polarisation import are_radiances, is_polarised
from gonio.models.display import listed

POLARISED = (
    "the channels are of polarised light, and Fresnel's terms in models of unpolarised light: f0, eta and k are those"
    " that fit each state best, not the material's"
)


def why_no_radiances(names: Sequence[str]) -> str | None:
    """Why no model fits some of the channels; None where all are radiances."""
    radiances = dict(zip(names, are_radiances(names), strict=True))
    first, others = ([name for name in names if radiances[name] == wanted] for wanted in (True, False))
    if not others:
        return None
    return (
        f"{listed(others)} are elements of Mueller matrices or Stokes parameters, which may be negative, and models are"
        f" of radiances; fit {listed(first)} alone (--channel {first[0]!r}; from Python table.only)"
    )


def polarisation_notes(names: Sequence[str]) -> list[str]:
    """That models are of unpolarised light, where the channels are not."""
    return [POLARISED] if is_polarised(names) else []

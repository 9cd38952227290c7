"""What limits the use of a material's values: a fit that was not judged good, a model beyond what it is made for."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from gonio.fitting.judgement import FAILED, GOOD, judge_fit

if TYPE_CHECKING:
    from gonio.data.material import Material


def material_warnings(material: "Material") -> list[str]:
    """The sentences that belong beside any number of a material; none of one that nothing limits.

    Args:
        material: any; a fitted one holds how it was fitted, by which it is judged here.
    """
    return fit_warnings(material) + list(material.brdf.validity_notes)


def fit_warnings(material: "Material") -> list[str]:
    """That a fitted material comes from a fit that was not judged good; nothing of other materials."""
    fit = material.meta.get("fit")
    if not isinstance(fit, Mapping) or "converged" not in fit:  # numbers alone, which say nothing of how they came
        return []
    verdict = judge_fit(fit).verdict
    if verdict == GOOD:
        return []
    use = ": do not use it" if verdict == FAILED else ""
    return [f"{material.name} is a fit that was judged {verdict}{use}; gonio info on its file says why"]

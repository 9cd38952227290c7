"""Every model once more, as its paper prints it, in mpmath numbers of any precision: an independent second opinion."""

from gonio.stability.textbook import (
    diffuse,
    half_vector,
    layered,
    microfacet,
    mirror,
    physical_optics,
    transmission,
    volumetric,
    waves,
)
from gonio.stability.textbook.frame import TextbookForm

TEXTBOOK: dict[str, TextbookForm] = {
    name: form
    for module in (diffuse, volumetric, half_vector, mirror, microfacet, layered, physical_optics, waves, transmission)
    for name, form in vars(module).items()
    if isinstance(form, TextbookForm)
}
"""The forms by the models' names: (params, options, wi, wo) -> f, 1/sr without the cosine, of one channel.

Directions are tuples of three numbers. A form stands in a module under its model's name; `coat` takes one more
argument, base(wi, wo).
"""

"""Terms of candidate models, and the moves from one candidate to larger and smaller ones.

What a step may add is what goniometers see: a diffuser of another shape, a lobe about the mirror direction, back to the
light, along the surface or in direction cosines, and Fresnel's dependence on the angle, of dielectrics and of metals.
"""

import dataclasses
import functools
from collections.abc import Iterator
from typing import NamedTuple

from gonio.models.catalog import MODELS
from gonio.models.expression.parser import FACTOR, numbers, parse, with_defaults
from gonio.models.parameters import parameters_of

MAX_LOBES = 3
WITH_FRESNEL = ("ggx", "beckmann", "std", "abc_microfacet")


class Fresnel(NamedTuple):
    """The Fresnel reflectance of a lobe as arguments of its model, and whether the lobe has a free scale as well."""

    arguments: str = ""
    scaled: bool = True


NO_FRESNEL, SCHLICK, SCHLICK_FREE = Fresnel(), Fresnel("f0=0.04"), Fresnel("f0=?")
GLASS, DIELECTRIC, METAL = Fresnel("eta=1.5"), Fresnel("eta=?", scaled=False), Fresnel("eta=each, k=each", scaled=False)
DIELECTRIC_SCALED = Fresnel("eta=?")

DIFFUSERS = ("eon", "fujii", "minnaert", "burley_diffuse", "white_standard", "lommel_seeliger", "rpv", "hapke")
FACETS = ("beckmann", "std", "phong", "blinn_phong", "abc_microfacet", "ward")
OTHER_LOBES = ("retro", "phong", "charlie", "harvey_shack")


@dataclasses.dataclass(frozen=True)
class TermSpec:
    """One term of a candidate.

    `anisotropic`: two widths; `width_each`: a width for each channel; `shared`: its albedo or scale is one number for
    all channels; `separable`: Smith's masking of the two directions as if they were independent; `base`: the model
    whose lobe goes straight through, of `transmitted`; `beckmann`: Gaussian slopes, of an interface; `dyed`: a free
    scale of what loses nothing without one.
    """

    model: str
    fresnel: Fresnel = NO_FRESNEL
    anisotropic: bool = False
    width_each: bool = False
    shared: bool = False
    separable: bool = False
    base: str = ""
    beckmann: bool = False
    dyed: bool = False

    @property
    def is_lobe(self) -> bool:
        """Whether it is a lobe, not a diffuser."""
        return self.model not in ("lambert", "lambert_transmission", "thin_sheet", *DIFFUSERS)

    @property
    def options(self) -> tuple[tuple[str, str], ...]:
        """The words among the arguments of its model."""
        words = {"distribution": "beckmann"} if self.beckmann else {}
        return tuple((words | ({"smith": "separable"} if self.separable else {})).items())

    @property
    def has_fresnel(self) -> bool:
        """Whether its model knows Fresnel's reflectance."""
        return self.model in WITH_FRESNEL

    @property
    def expression(self) -> str:
        """The term as a user would write it."""
        extent = "each" if self.width_each else "?"
        widths = ("alpha_x", "alpha_y") if self.anisotropic else ("alpha",) if self.width_each else ()
        arguments = [f"base={self.base}"] if self.base else []
        arguments += [f"{name}={extent}" for name in widths]
        arguments += ["eta=?"] if self.model == "rough_slab" else []
        arguments += ["gamma=?"] if self.model == "std" else []
        arguments += [self.fresnel.arguments] if self.fresnel.arguments else []
        arguments += [f'{name}="{word}"' for name, word in self.options]
        known = parameters_of(MODELS[self.model])
        factor = "" if self.fresnel.scaled else "1 * "
        if self.shared and known and not MODELS[self.model].lobe:
            arguments += [f"{name}=shared" for name, info in known.items() if info.per_channel]
        elif self.shared and self.fresnel.scaled:
            factor = "shared * "
        elif self.dyed or (not known and not self.base):
            factor = "? * "
        return factor + self.model + (f"({', '.join(arguments)})" if arguments else "")


Terms = tuple[TermSpec, ...]
LAMBERT = TermSpec("lambert")


def expression_of(terms: Terms) -> str:
    """A candidate as a user would write it."""
    return " + ".join(term.expression for term in terms)


@functools.lru_cache(maxsize=512)
def kernel_arguments(term: TermSpec) -> tuple[str, ...]:
    """Names of the shapes that the program of a term takes: one program for all that differ in what is free only."""
    known = parameters_of(MODELS[term.model])
    names = [n.path for n in numbers(with_defaults(parse(term.expression))[0]) if n.path != FACTOR]
    if "alpha_x" in known:
        names = [n for n in names if not n.startswith("alpha")] + ["alpha_x", "alpha_y"]
    if term.has_fresnel:
        names = [n for n in names if n not in ("f0", "eta", "k")]
        names += ["eta", "k"] if "eta" in term.fresnel.arguments else ["f0"]
    return tuple(names)


def changed(terms: Terms, which: list[int], **fields: str | Fresnel | bool) -> Terms:
    """The terms with some fields of some of them replaced."""
    return tuple(dataclasses.replace(term, **fields) if k in which else term for k, term in enumerate(terms))


def lobes_of(terms: Terms) -> list[int]:
    """Indices of the lobes."""
    return [k for k, term in enumerate(terms) if term.is_lobe]


def is_dear(terms: Terms) -> bool:
    """Whether a term costs hundreds of GGX lobes: a second lobe is then the cheaper number to add to another."""
    return any(term.model == "std" for term in terms)


def steps(terms: Terms, anisotropic: bool, channels: int) -> Iterator[Terms]:
    """A candidate with one more lobe or freedom, all out of GGX's two programs."""
    lobes = lobes_of(terms)
    first = terms[lobes[0]] if lobes else None
    if len(lobes) < MAX_LOBES and not is_dear(terms):
        model = first.model if first and first.has_fresnel else "ggx"
        for fresnel in (NO_FRESNEL, SCHLICK, DIELECTRIC):
            yield (*terms, TermSpec(model, fresnel))
    for k in lobes:
        if terms[k].has_fresnel:
            others = (NO_FRESNEL, SCHLICK, SCHLICK_FREE, DIELECTRIC, METAL)
            yield from (changed(terms, [k], fresnel=f, shared=False) for f in others if f != terms[k].fresnel)
        if anisotropic and "alpha_x" in parameters_of(MODELS[terms[k].model]) and not terms[k].anisotropic:
            yield changed(terms, [k], anisotropic=True)
    wide = [k for k in lobes if "alpha" in parameters_of(MODELS[terms[k].model]) and not terms[k].width_each]
    if channels > 1 and wide:
        yield changed(terms, wide, width_each=True)


def families(terms: Terms) -> Iterator[Terms]:
    """Other families of the field, where what GGX and Lambert leave is not noise: each is a program to compile."""
    lobes = lobes_of(terms)
    for k in (k for k in range(len(terms)) if k not in lobes):
        yield from (changed(terms, [k], model=model) for model in ("lambert", *DIFFUSERS) if model != terms[k].model)
    for k in (k for k in lobes if terms[k].model != "retro"):
        t = terms[k]
        for model in ("ggx", *FACETS):
            if model == t.model or t.anisotropic:
                continue
            if model == "std" and (len(lobes) > 1 or t.width_each or t.fresnel == METAL):
                continue
            keeps = model in WITH_FRESNEL and t.has_fresnel
            width_each = t.width_each and "alpha" in parameters_of(MODELS[model])
            other = TermSpec(model, t.fresnel if keeps else NO_FRESNEL, False, width_each, t.shared and not keeps)
            yield (*terms[:k], other, *terms[k + 1 :])
        if t.has_fresnel:
            yield from (changed(terms, [k], fresnel=f) for f in (GLASS, DIELECTRIC_SCALED) if f != t.fresnel)
        if t.model in ("ggx", "beckmann"):
            yield changed(terms, [k], separable=not t.separable)
    if len(lobes) < MAX_LOBES and not is_dear(terms):
        yield from ((*terms, TermSpec(model)) for model in (*OTHER_LOBES, "ggx", "beckmann"))
    if all(term.is_lobe for term in terms):
        yield (LAMBERT, *terms)


def simpler(terms: Terms, channels: int) -> Iterator[Terms]:
    """A candidate without a term, or with fewer free numbers."""
    lobes = lobes_of(terms)
    diffuse = [k for k in range(len(terms)) if k not in lobes]
    if len(terms) > 1:
        yield from (terms[:k] + terms[k + 1 :] for k in diffuse + lobes[::-1])
    if len(terms) > 1 and not diffuse:
        yield from ((LAMBERT, *terms[:k], *terms[k + 1 :]) for k in lobes)
    for k in lobes:
        t = terms[k]
        fixed = {SCHLICK_FREE: (NO_FRESNEL, SCHLICK), DIELECTRIC_SCALED: (DIELECTRIC, GLASS, SCHLICK)}
        fixed[METAL] = (NO_FRESNEL, DIELECTRIC)
        yield from (changed(terms, [k], fresnel=f) for f in fixed.get(t.fresnel, ()))
        if t.model in ("std", "abc_microfacet"):
            yield from (changed(terms, [k], model=model) for model in ("ggx", "beckmann"))
        if t.anisotropic:
            yield changed(terms, [k], anisotropic=False)
    if each := [k for k in lobes if terms[k].width_each]:
        yield changed(terms, each, width_each=False)
    yield from (changed(terms, [k], model="lambert") for k in diffuse if terms[k].model != "lambert")
    coloured = [k for k, t in enumerate(terms) if not t.shared and t.fresnel.scaled] if channels > 1 else []
    if len(coloured) > 1:
        yield changed(terms, coloured, shared=True)
    yield from (changed(terms, [k], shared=True) for k in coloured)

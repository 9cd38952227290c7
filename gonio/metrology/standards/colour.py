"""Colour of spectra: tristimulus values, L*a*b* and CIEDE2000 [CIE 15:2018]; the CIE's data are colour-science's."""

import dataclasses
import functools
import importlib.util
import warnings
from collections.abc import Callable

import numpy as np

from gonio.data.channels import Channels
from gonio.fitting.residuals.colour_difference import LINEAR_SRGB, ciede2000, to_lab
from gonio.metrology.standards.standard import StandardQuantity
from gonio.models.display import percent
from gonio.models.errors import GonioError

OBSERVERS = {10: "CIE 1964 10 Degree Standard Observer", 2: "CIE 1931 2 Degree Standard Observer"}
ILLUMINANTS = ("D65", "A")
ENDS, WIDEST = (400.0, 700.0), 20.0
"""nm: the range that a spectrum has to cover, beyond which its ends are held [ASTM E308], and its widest step."""
HELD = 1e-3
"""Share of X, Y or Z of white beyond the ends of a spectrum, from which on that is said."""
LAB = ("L*", "a*", "b*")
NAMES, DIFFERENCE = ("X", "Y", "Z", *LAB), "ΔE00"
COORDINATES = (*NAMES, DIFFERENCE)
PACKAGE = "colour needs the package colour-science: pip install 'gonio[colour]'"


@dataclasses.dataclass(frozen=True)
class Viewing:
    """How colours are seen: illuminants, the observer's field in degrees, and whether R, G, B are linear sRGB."""

    illuminants: tuple[str, ...] = ILLUMINANTS
    observer: int = 10
    linear_srgb: bool = False

    def __post_init__(self) -> None:
        for name in self.illuminants:
            if name not in ILLUMINANTS:
                raise GonioError(f"the illuminant is {name!r}; give {' or '.join(ILLUMINANTS)}")
        if self.observer not in OBSERVERS:
            raise GonioError(f"the observer is {self.observer}; give 10 or 2 (degrees)")


@dataclasses.dataclass(frozen=True)
class Weights:
    """Matrices (3, C) from values of the channels to X, Y, Z with the perfect diffuser at Y = 100, by two ways."""

    label: str
    fine: np.ndarray
    rough: np.ndarray

    @property
    def white(self) -> np.ndarray:
        """X, Y, Z of the perfect diffuser."""
        return self.fine.sum(axis=1)


def no_colour(channels: Channels, viewing: Viewing) -> str | None:
    """Why there is no colour of these channels; None where there is."""
    if channels.wavelengths_nm is None:
        if channels.names == ("R", "G", "B"):
            return None if viewing.linear_srgb else "R, G, B are no spectrum; say --linear-srgb where they are that"
        return "it has no spectrum"
    nm = np.sort(channels.wavelengths_nm)
    if (steps := np.diff(nm)).size and steps.min() == 0:
        return f"several of its channels are of {nm[:-1][steps == 0][0]:g} nm; give one of each wavelength"
    if nm[0] > ENDS[0] or nm[-1] < ENDS[1] or np.max(steps, initial=0.0) > WIDEST:
        wanted = f"{ENDS[0]:g} to {ENDS[1]:g} nm in steps of at most {WIDEST:g} nm"
        if nm.size == 1:
            return f"its one wavelength, {nm[0]:g} nm, is not {wanted}"
        read = f"{nm[0]:g} to {nm[-1]:g} nm in steps of up to {steps.max():g} nm"
        return f"its {nm.size} wavelengths, {read}, are not {wanted}"
    return None if importlib.util.find_spec("colour") else PACKAGE


def held_ends(channels: Channels, viewing: Viewing) -> str | None:
    """What is to be said of a spectrum that ends within the visible; None where next to nothing of white is beyond."""
    if channels.wavelengths_nm is None:
        return None
    first, last = min(channels.wavelengths_nm), max(channels.wavelengths_nm)
    most = 0.0
    for name in viewing.illuminants:
        nodes, density = spectral_weights(name, viewing.observer)
        beyond = (nodes < first) | (nodes > last)
        most = max(most, float((density[:, beyond].sum(axis=1) / density.sum(axis=1)).max()))
    if most < HELD:
        return None
    return (
        f"Colours hold the spectrum at its ends beyond {first:g} to {last:g} nm [ASTM E308], of up to "
        f"{percent(most)} of X, Y or Z of white; what it does there is in no uncertainty."
    )


def weights_of(channels: Channels, viewing: Viewing) -> list[Weights]:
    """The matrices of channels that have a colour, for each illuminant; of linear sRGB for its own alone."""
    if channels.wavelengths_nm is None:
        return [Weights("D65/2°, from linear sRGB", 100 * LINEAR_SRGB, 100 * LINEAR_SRGB)]
    from scipy.interpolate import CubicSpline  # loaded where there is a spectrum

    nm = np.asarray(channels.wavelengths_nm)
    order = np.argsort(nm)
    made = []
    for name in viewing.illuminants:
        nodes, density = spectral_weights(name, viewing.observer)
        inside = np.clip(nodes, nm[order][0], nm[order][-1])
        spline = CubicSpline(nm[order], np.eye(nm.size), bc_type="natural")(inside)
        straight = np.stack([np.interp(inside, nm[order], row) for row in np.eye(nm.size)], axis=1)
        fine, rough = (np.zeros((3, nm.size)) for _ in range(2))
        fine[:, order], rough[:, order] = density @ spline, density @ straight
        made.append(Weights(f"{name}/{viewing.observer}°", fine, rough))
    return made


@functools.cache
def spectral_weights(illuminant: str, observer: int) -> tuple[np.ndarray, np.ndarray]:
    """(wavelengths (n,), nm, weights (3, n)) of X, Y, Z: illuminant times colour-matching functions, ΣY = 100."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what this package says of its other parts
        import colour
    functions = colour.MSDS_CMFS[OBSERVERS[observer]]
    light = colour.SDS_ILLUMINANTS[illuminant]
    nodes = np.arange(360.0, 781.0)
    curves = np.stack([np.interp(nodes, functions.wavelengths, c) for c in np.asarray(functions.values).T])
    density = curves * np.interp(nodes, light.wavelengths, light.values)
    return nodes, 100 * density / density[1].sum()


@dataclasses.dataclass(frozen=True)
class Reference:
    """L*a*b* (3,) of another subject and their standard uncertainties (3,)."""

    lab: np.ndarray
    u: np.ndarray


def colours(
    places: list[StandardQuantity], weights: list[Weights], against: dict[str, Reference] | None
) -> list[StandardQuantity]:
    """X, Y, Z, L*, a*, b* at the geometries of reflectance factors, and CIEDE2000 from others' L*a*b*.

    Args:
        places: reflectance factors, of the channels; of the multi-angle set without X, Y, Z.
        weights: of the channels, by illuminant.
        against: of another subject, by the geometry's name and the label of the weights.
    """
    made = []
    for factor in places:
        group = factor.group if factor.group == "multi-angle" else "colour"
        for w in weights:
            for k, name in enumerate(NAMES):
                if group == "colour" or name in LAB:
                    made.append(_value(factor, group, w, name, functools.partial(_component, factor, k)))
            reference = (against or {}).get(f"{factor.name} {w.label}")
            if reference is not None:
                of = functools.partial(_difference, factor, reference.lab)
                entry = _value(factor, group, w, DIFFERENCE, of)
                other = functools.partial(_of_reference, factor, reference, w)
                made.append(dataclasses.replace(entry, other=other))
    return made


def _value(
    factor: StandardQuantity,
    group: str,
    w: Weights,
    name: str,
    of: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
) -> StandardQuantity:
    standard = "CIE 15:2018" if name != DIFFERENCE else "ISO/CIE 11664-6"
    return StandardQuantity(
        name, standard, f"{w.label}; {factor.name}: {factor.geometry}", group, factor.integrals,
        functools.partial(of, w.fine, w.white), functools.partial(of, w.rough, w.white), True, 10.0,
        place=f"{factor.name} {w.label}",
    )  # fmt: skip


def _component(
    factor: StandardQuantity, k: int, matrix: np.ndarray, white: np.ndarray, values: np.ndarray
) -> np.ndarray:
    xyz = matrix @ factor.combine(values)
    return xyz[k] if k < 3 else to_lab(xyz[None], white)[0, k - 3]


def _difference(
    factor: StandardQuantity, reference: np.ndarray, matrix: np.ndarray, white: np.ndarray, values: np.ndarray
) -> np.ndarray:
    lab = to_lab((matrix @ factor.combine(values))[None], white)
    return ciede2000(lab, reference[None])[0]


def _of_reference(factor: StandardQuantity, reference: Reference, w: Weights, values: np.ndarray) -> float:
    """Standard uncertainty of the difference by that of the reference's L*a*b*, taken as independent."""
    lab = to_lab((w.fine @ factor.combine(values))[None], w.white)
    moved = [ciede2000(lab, (reference.lab + step)[None])[0] for step in (*np.diag(reference.u), np.zeros(3))]
    return float(np.linalg.norm(np.array(moved[:3]) - moved[3]))


def flop(factors: list[StandardQuantity], w: Weights) -> StandardQuantity:
    """Flop index 2.69 (L*15 − L*110)^1.11 / L*45^0.86 [Alman 1987] of the multi-angle set (15, 45, 110)."""

    def index(matrix: np.ndarray, values: np.ndarray) -> np.ndarray:
        near, middle, far = to_lab(values @ matrix.T, w.white)[:, 0]
        return 2.69 * np.maximum(near - far, 0.0) ** 1.11 / middle**0.86

    return StandardQuantity(
        "flop index", "Alman 1987", f"{w.label}; L* at 45°:as15°, as45°, as110°", "multi-angle",
        tuple(f.integrals[0] for f in factors), functools.partial(index, w.fine), functools.partial(index, w.rough),
        True, 1.0, place=w.label,
    )  # fmt: skip

"""pbrt-v4: its materials diffuse, conductor, coateddiffuse, dielectric and diffusetransmission, alone or mixed.

Of a coated diffuser what pbrt finds by a random walk between the layers is computed here in closed form: the base is
lit by what passes the rough interface, and by what the interface sends back.
"""

import functools
from typing import Any

import numpy as np

from gonio.exports.forms import Appearance, Form, Number, Values
from gonio.exports.pairs import Pairs
from gonio.exports.renderers.glass import glass
from gonio.exports.renderers.lobes import column, conductor, dielectric, ggx_facets, interface_shares

Said = list[dict[str, Any]]
"""Materials in the order in which they are made, the last one the surface: "type", parameters by their types, and of a
mix the places of its materials in this order."""


def forms(sought: Appearance) -> tuple[Form, ...]:
    """An interface, where the surface is one; else diffusers, coated or not, metals, and their mixes.

    Of what transmits one of a mix is a sheet that diffuses on both sides.
    """
    if sought.interface:
        return (glass(_interface),)
    axes = ("alpha",) if sought.isotropic else ("alpha_x", "alpha_y")
    kinds: list[tuple[str, ...]] = [("diffuse",), ("coated",), ("metal",), ("diffuse", "metal"), ("coated", "metal")]
    kinds += [("diffuse", "coated")]
    if sought.transmits:
        kinds = [("sheet",), ("sheet", "metal"), ("sheet", "coated")]
        kinds += [("sheet", "metal", "metal"), ("sheet", "coated", "metal")] if sought.isotropic else []
    elif sought.isotropic:
        kinds += [("coated", "coated"), ("metal", "metal"), ("diffuse", "coated", "metal")]
        kinds += [(base, "metal", "metal") for base in ("diffuse", "coated")]
    return tuple(_mix(kind, axes) for kind in kinds)


def _interface(v: Values) -> Said:
    return [{"type": "dielectric", **_roughness(v["alpha"], v["alpha"]), "float eta": float(v["eta"])}]


def colour(values: Any) -> list[float]:
    """Red, green and blue."""
    return [float(x) for x in np.broadcast_to(np.asarray(values, float), (3,))]


def _roughness(alpha_x: Any, alpha_y: Any) -> dict[str, Any]:
    each = {"float uroughness": float(alpha_x), "float vroughness": float(alpha_y)}
    return {"bool remaproughness": False, **each}


def _widths(v: Values, axes: tuple[str, ...], suffix: str) -> tuple[Any, Any]:
    return v[f"{axes[0]}{suffix}"], v[f"{axes[-1]}{suffix}"]


NAMES = {"diffuse": "diffuse", "coated": "coateddiffuse", "metal": "conductor", "sheet": "diffusetransmission"}


class _Part:
    """One material of a mix: its numbers, f and parameters."""

    def __init__(self, kind: str, axes: tuple[str, ...], suffix: str) -> None:
        self.kind, self.axes, self.suffix = kind, axes, suffix
        widths = [Number(f"{axis}{suffix}", 1e-4, 1.0, 0.2, log=True, width=True) for axis in axes]
        rho = Number(f"reflectance{suffix}", 0.0, 1.0, 0.4, coloured=True)
        self.numbers = {
            "diffuse": [rho],
            "sheet": [rho, Number(f"transmittance{suffix}", 0.0, 1.0, 0.4, coloured=True)],
            "coated": [rho, *widths, Number(f"eta{suffix}", 1.01, 3.0, 1.5, log=True)],
            "metal": [
                *widths, Number(f"eta{suffix}", 0.02, 10.0, 1.0, coloured=True, log=True),
                Number(f"k{suffix}", 0.0, 20.0, 3.0, coloured=True),
            ],
        }[kind]  # fmt: skip

    def f(self, v: Values, pairs: Pairs) -> np.ndarray:
        s, one = self.suffix, np.ones((pairs.wi.z.size, 1))
        if np.any(pairs.wo.z < 0):
            return one * v[f"transmittance{s}"] / np.pi if self.kind == "sheet" else 0.0 * one
        if self.kind in ("diffuse", "sheet"):
            return v[f"reflectance{s}"] / np.pi * one
        facets = ggx_facets(pairs, *_widths(v, self.axes, s))
        if self.kind == "metal":
            return facets * conductor(pairs.cos_d, v[f"eta{s}"], v[f"k{s}"])
        alpha = float(np.sqrt(np.prod(_widths(v, self.axes, s))))
        below = under_coat(pairs, v[f"reflectance{s}"], alpha, float(v[f"eta{s}"]))
        return facets * dielectric(pairs.cos_d, v[f"eta{s}"]) + below

    def describe(self, v: Values) -> dict[str, Any]:
        s = self.suffix
        if self.kind == "diffuse":
            return {"type": "diffuse", "rgb reflectance": colour(v[f"reflectance{s}"])}
        if self.kind == "sheet":
            shares = ("reflectance", "transmittance")
            return {"type": "diffusetransmission"} | {f"rgb {name}": colour(v[f"{name}{s}"]) for name in shares}
        rough = _roughness(*_widths(v, self.axes, s))
        if self.kind == "metal":
            return {"type": "conductor", **rough, "rgb eta": colour(v[f"eta{s}"]), "rgb k": colour(v[f"k{s}"])}
        return {
            "type": "coateddiffuse", "rgb reflectance": colour(v[f"reflectance{s}"]), **rough,
            "float eta": float(v[f"eta{s}"]), "float thickness": 0.0, "integer maxdepth": 100,
        }  # fmt: skip


COSINES = np.linspace(0, 1, 40) ** 2
"""At which the light that a coat lets through is computed."""


@functools.lru_cache(maxsize=64)
def _coat(alpha: float, eta: float) -> tuple[np.ndarray, float]:
    """(what passes a rough interface from outside at `COSINES`, what it sends back of diffuse light inside)."""
    x, weight = np.polynomial.legendre.leggauss(32)
    mu = (x + 1) / 2
    back = float(np.sum(weight * mu * interface_shares(mu, alpha, 1.0 / eta)[0]))
    return interface_shares(COSINES, alpha, eta)[1], back


def under_coat(pairs: Pairs, rho: np.ndarray, alpha: float, eta: float) -> np.ndarray:
    """f of a Lambertian base under a rough interface: T(μi) T(μo) ρ/(π η² (1 − ρ R)), R what it sends back inside."""
    shares, back = _coat(alpha, eta)
    passed = [column(np.interp(np.sqrt(w.z), np.sqrt(COSINES), shares)) for w in (pairs.wi, pairs.wo)]
    return passed[0] * passed[1] * rho / (np.pi * eta**2 * (1.0 - rho * back))


def _mix(kinds: tuple[str, ...], axes: tuple[str, ...]) -> Form:
    """A material, or a mix of two or three: the first one, and what is mixed of the others."""
    parts = [_Part(kind, axes, str(k) if len(kinds) > 1 else "") for k, kind in enumerate(kinds)]
    numbers = [n for part in parts for n in part.numbers]
    if len(parts) == 1:
        only = parts[0]
        return Form(NAMES[only.kind], tuple(numbers), only.f, lambda v: [only.describe(v)], transmits="sheet" in kinds)
    amounts = ["amount", "amount2"][: len(parts) - 1]

    def f(v: Values, pairs: Pairs) -> np.ndarray:
        mixed = parts[-1].f(v, pairs)
        for part, amount in zip(reversed(parts[:-1]), reversed(amounts), strict=True):
            mixed = (1.0 - v[amount]) * part.f(v, pairs) + v[amount] * mixed
        return mixed

    def describe(v: Values) -> Said:
        described, last = [part.describe(v) for part in parts], len(parts) - 1
        for k in reversed(range(len(amounts))):
            described.append({"type": "mix", "materials": [k, last], "float amount": float(v[amounts[k]])})
            last = len(described) - 1
        return described

    *first, last = (NAMES[kind] for kind in kinds)
    starts = [Number(name, 0.0, 1.0, 0.5) for name in amounts]
    name = f"mix of {', '.join(first)} and {last}"
    return Form(name, (*numbers, *starts), f, describe, transmits="sheet" in kinds)

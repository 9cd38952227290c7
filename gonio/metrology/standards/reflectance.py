"""Reflectance factors of colour measurement and of the sphere, remote sensing's names, and retro-reflection."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from gonio.metrology.standards.apertures import Beam, Rule, band, mirror, pairs, ray, ring, turned_about
from gonio.metrology.standards.standard import Aperture, Hemisphere, StandardQuantity

ANNULUS, NORMAL = (40.0, 50.0), 5.0
"""Polar angles of the annulus, and the half-angle of the cone about the normal, degrees [CIE 15:2018]."""
NEAR_NORMAL = 8.0
PORT = 5.0
"""Half-angle, degrees, of the port that takes the mirrored image out of the sphere, where none is stated."""
ASPECULAR = (15, 25, 45, 75, 110)
"""Degrees from the mirror direction towards the light, which is at 45° [ASTM E2539]."""
OBSERVATION = (0.2, 0.33, 0.5, 1.0)
ENTRANCE = (-4, 30)
"""Degrees [ASTM E808, E810]."""
NEAR_LIGHT = 3.0
"""Degrees from the light within which surfaces may send much more light back."""
SUN = 45.0
FINE, COARSE = (4, 12), (3, 8)
PORT_FINE, PORT_COARSE = (6, 24), (4, 16)
SPHERE, CIE = "CIE 15:2018", "CIE 15:2018, ISO 13655, ASTM E1349"


def single(theta_i: float, theta_o: float, turn: float, factor: float = 1.0) -> Aperture:
    """f at one pair of directions, degrees, times a factor."""
    i, o, d = (math.radians(a) for a in (theta_i, theta_o, turn))
    rule = Rule(ray(i).directions, ray(o, d).directions, np.array([factor]))
    back = turn == 0.0 and abs(theta_i - theta_o) < NEAR_LIGHT
    same = min(abs(theta_i - theta_o), abs(theta_i + theta_o - 180.0)) < 1e-9  # or straight through
    return Aperture(rule, mirror=same and (turn == 180.0 or theta_i == 0), back=back, angles=(i, o, d))


def annular(exchanged: bool) -> Aperture:
    """π ∫∫ f cosθi cosθo dωi dωo / ∫∫ cosθi cosθo dωi dωo of the annulus about 45° and a cone about the normal."""
    low, high = (math.radians(a) for a in ANNULUS)
    return dataclasses.replace(
        _mean_factor(lambda order, turns: band(low, high, order, turns), exchanged), around=not exchanged
    )


def one_sided(exchanged: bool) -> Aperture:
    """The same of a cone about 45° at one azimuth and a cone about the normal."""
    axis, edges = ray(math.radians(45.0)).directions, np.array([0.0, math.radians(NORMAL)])
    return dataclasses.replace(
        _mean_factor(lambda order, turns: turned_about(axis, edges, order, turns), exchanged), around=exchanged
    )


def _mean_factor(inclined: Callable[[int, int], Beam], exchanged: bool) -> Aperture:
    """The mean reflectance factor of light by a rule of some order and turns, and of a cone about the normal."""
    rules = []
    for order, turns in (FINE, COARSE):
        beams = inclined(order, turns), band(0.0, math.radians(NORMAL), order, turns)
        light, detector = beams[::-1] if exchanged else beams
        rule = pairs(light, light.projected, detector, detector.projected)
        rules.append(rule._replace(weight=np.pi * rule.weight / rule.weight.sum()))
    return Aperture(*rules)


def stated(place: str, theta_i: float, theta_o: float, turn: float) -> StandardQuantity:
    """The reflectance factor, or behind the sample the transmittance factor, at one pair of directions, degrees."""
    through = theta_o > 90
    return StandardQuantity(
        "transmittance factor" if through else "reflectance factor",
        ("CIE S 017" if through else "CIE 15:2018") + ", between readings",
        f"θi {theta_i:g}°, θo {theta_o:g}°, Δφ {turn:g}°; single directions",
        "transmission" if through else "reflectance", (single(theta_i, theta_o, turn, math.pi),), place=place,
    )  # fmt: skip


def port(half_angle: float) -> Aperture:
    """What leaves within an angle, degrees, of the mirror direction of light at 8°: the share of the light."""
    light = ray(math.radians(NEAR_NORMAL))
    return around(light, 0.0, half_angle)


def around(light: Beam, inner: float, outer: float, behind: bool = False) -> Aperture:
    """∫ f |cosθo| dωo between two angles, degrees, about the mirror direction, or where light goes straight through."""
    axis = mirror(light.directions)
    if behind:
        axis = axis._replace(z=-axis.z)
    rules = []
    for order, turns in (PORT_FINE, PORT_COARSE):
        beam = ring(axis, math.radians(inner), math.radians(outer), order, turns)
        rules.append(pairs(light, np.ones(1), beam, np.where(beam.directions.z * axis.z > 0, beam.projected, 0.0)))
    image = ((float(np.arccos(light.directions.z[0])), 1.0),) if inner == 0 and not behind else ()
    return Aperture(*rules, images=image, mirror=inner == 0)


def reflectance(port_angle: float) -> list[StandardQuantity]:
    """45a:0, 0:45a, 45x:0, 0:45x, and the sphere's factors R(8°;2π) with the mirrored image and without it."""
    cone, ends = f"within {NORMAL:g}° of the normal", f"{ANNULUS[0]:g}° to {ANNULUS[1]:g}°, all around"
    beam = f"within {NORMAL:g}° of 45° at one azimuth"
    whole, excluded = Hemisphere(math.radians(NEAR_NORMAL)), port(port_angle)
    group = "reflectance"
    return [
        StandardQuantity("45°a:0°", CIE, f"light {ends}; detector {cone}", group, (annular(False),)),
        StandardQuantity("0°:45°a", CIE, f"light {cone}; detector {ends}", group, (annular(True),)),
        StandardQuantity("45°x:0°", CIE, f"light {beam}; detector {cone}", group, (one_sided(False),)),
        StandardQuantity("0°:45°x", CIE, f"light {cone}; detector {beam}", group, (one_sided(True),)),
        StandardQuantity(
            "8°:di", SPHERE, "R(8°;2π): light collimated at 8°, whole hemisphere, mirrored image too", group, (whole,)
        ),
        StandardQuantity(
            "8°:de", SPHERE, f"the same without {port_angle:g}° about the mirror direction", group,
            (whole, excluded), lambda v: v[0] - v[1],
        ),
    ]  # fmt: skip


def multi_angle() -> list[StandardQuantity]:
    """Reflectance factors of the multi-angle set, light at 45°."""
    made = []
    for angle in ASPECULAR:
        side = "" if angle == 45 else " on the mirror side" if angle < 45 else " on the light's side"
        geometry = f"light at 45°, detector at {abs(45 - angle)}°{side}; single directions"
        name, integral = f"45°:as{angle}°", aspecular(angle)
        made.append(StandardQuantity(name, "ASTM E2539", geometry, "multi-angle", (integral,)))
    return made


def aspecular(angle: float) -> Aperture:
    """π f of light at 45° and a detector at an angle, degrees, from the mirror direction towards the light."""
    theta = 45.0 - angle
    return single(45.0, abs(theta), 180.0 if theta >= 0 else 0.0, math.pi)


def retroreflection() -> list[StandardQuantity]:
    """Coefficients of retroreflection R_A = f cosθi cosθo, cd/(lx·m²), at entrance and observation angles."""
    made = []
    for entrance in ENTRANCE:
        for angle in OBSERVATION:
            theta_i, theta_o = abs(float(entrance)), abs(entrance - angle)
            factor = math.cos(math.radians(theta_i)) * math.cos(math.radians(theta_o))
            made.append(
                StandardQuantity(
                    "R_A", "ASTM E810, CIE 54.2",
                    f"entrance {entrance}°, observation {angle:g}°; θo {theta_o:g}°, single directions",
                    "retroreflection", (single(theta_i, theta_o, 0.0, factor),), unit="cd/(lx·m²)",
                    place=f"{entrance}°, {angle:g}°",
                )
            )  # fmt: skip
    return made


def remote_sensing() -> list[StandardQuantity]:
    """Names of Schaepman-Strub et al. 2006: BRF at nadir, and DHR (black-sky albedo), for the sun at 45°."""
    source, group = "Schaepman-Strub et al. 2006", "remote sensing"
    sun = f"sun at {SUN:g}°"
    return [
        StandardQuantity("BRF", source, f"{sun}, nadir view; single directions", group, (single(SUN, 0, 0, math.pi),)),
        StandardQuantity(
            "BRF", source, f"{sun}, hot spot; single directions", group, (single(SUN, SUN, 0, math.pi),),
            place="hot spot",
        ),
        StandardQuantity(
            "DHR", source, f"{sun}, whole hemisphere (black-sky albedo)", group, (Hemisphere(math.radians(SUN)),)
        ),
    ]  # fmt: skip

"""ALTA text: coordinates made here from the vectors of random pairs, by the definitions that ALTA documents."""

import numpy as np
import pytest

from gonio.data.formats.registry import read
from gonio.models.errors import GonioError
from support.closed_form import anisotropic, isotropic, largest_error, pairs, vector


def unit(w):
    return w / np.linalg.norm(w, axis=0)


def polar(w):
    return np.arccos(np.clip(w[2], -1, 1)), np.arctan2(w[1], w[0])


def turned_to_zero(w, azimuth):
    """The vectors with so much taken from their azimuths."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    return np.stack([c * w[0] + s * w[1], c * w[1] - s * w[0], w[2]])


def half_angles(light, view):
    half = unit(light + view)
    theta_h, phi_h = polar(half)
    x, y, z = turned_to_zero(view, phi_h)
    difference = np.stack([x * np.cos(theta_h) - z * np.sin(theta_h), y, x * np.sin(theta_h) + z * np.cos(theta_h)])
    return theta_h, phi_h, *polar(difference)


def projected(light, view):
    theta, phi = polar(turned_to_zero(view, polar(light)[1]))
    return polar(light)[0], theta * np.cos(phi), theta * np.sin(phi)


def about_light(light, view):
    """The viewer's angle from the light, and azimuth about it, 0 towards the normal."""
    light, view = (turned_to_zero(w, polar(light)[1]) for w in (light, view))
    angle = np.arccos(np.clip((light * view).sum(0), -1, 1))
    across = np.stack([-light[2], 0 * angle, light[0]])
    azimuth = np.arctan2(view[1], (view * across).sum(0))
    return polar(light)[0], angle * np.cos(azimuth), angle * np.sin(azimuth)


def about_back(light, view):
    light, view = (turned_to_zero(w, polar(light)[1]) for w in (light, view))
    theta, phi = polar(unit(view + light * np.array([[-1], [-1], [1]])))
    return polar(light)[0], theta * np.cos(phi), theta * np.sin(phi)


def stark(light, view):
    half, back = (light + view) / 2, (light - view) / 2
    azimuth = np.arctan2(back[1], back[0]) - np.arctan2(half[1], half[0])
    return np.hypot(*half[:2]), np.linalg.norm(back, axis=0), azimuth


def neumann(light, view):
    half, back = (light + view) / 2, (light - view) / 2
    azimuth = np.arctan2(back[1], back[0]) - np.arctan2(half[1], half[0])
    return np.hypot(*half[:2]), np.hypot(*back[:2]), azimuth


def difference_vectors(light, view):
    _, _, theta_d, phi_d = half_angles(light, view)
    return *unit(light + view), *vector(theta_d, phi_d)


COORDINATES = {
    "SPHERICAL_TL_PL_TV_PV": lambda light, view: (*polar(light), *polar(view)),
    "CARTESIAN": lambda light, view: (*view, *light),
    "RUSIN_TH_PH_TD_PD": half_angles,
    "RUSIN_VH_VD": difference_vectors,
    "RUSIN_TH_TD_PD": lambda light, view: half_angles(light, view)[:1] + half_angles(light, view)[2:],
    "ISOTROPIC_TV_TL_DPHI": lambda light, view: (polar(view)[0], polar(light)[0], polar(light)[1] - polar(view)[1]),
    "ISOTROPIC_TL_TV_PROJ_DPHI": projected,
    "RETRO_TL_TVL_PROJ_DPHI": about_light,
    "SCHLICK_TL_TK_PROJ_DPHI": about_back,
    "STARK_3D": stark,
    "NEUMANN_3D": neumann,
}


def text(name, coordinates, values, output="INV_STERADIAN", vs="0"):
    rows = np.column_stack([*coordinates, *values])
    head = f"# free\n#DIM {len(coordinates)} 1\n#PARAM_IN {name}\n#PARAM_OUT {output}\n#VS {vs}\n"
    return head + "".join("  ".join(map(repr, row)) + "\n" for row in rows.tolist())


@pytest.mark.parametrize("name", COORDINATES)
def test_every_parametrisation_of_both_directions_gives_them_back(tmp_path, name):
    angles = pairs(60, 3)
    light, view = vector(*angles[:2]), vector(*angles[2:])
    coordinates = COORDINATES[name](light, view)
    brdf = isotropic if len(coordinates) == 3 else anisotropic
    (tmp_path / "a.dat").write_text(text(name, coordinates, [brdf(light, view)]))
    table = read(tmp_path / "a.dat")
    assert largest_error(table, brdf) < 1e-7 and table.f.size == 60


def test_cosine_factors_and_confidence_intervals_are_converted_once(tmp_path):
    angles = pairs(10, 4)
    f = anisotropic(vector(*angles[:2]), vector(*angles[2:]))
    cos = np.cos(angles[2])
    low, high = np.full(10, 0.02) * cos, np.full(10, 0.06) * cos
    made = text("SPHERICAL_TL_PL_TV_PV", angles, [f * cos, low, high], "INV_STERADIAN_COSINE_FACTOR", vs="2")
    (tmp_path / "a.dat").write_text(made)
    table = read(tmp_path / "a.dat", coverage=2)
    assert largest_error(table, anisotropic) < 1e-12
    assert np.allclose(table.u_f, 0.02, rtol=1e-12)
    made = text("SPHERICAL_TL_PL_TV_PV", angles, [np.pi * f, 0 * f + 0.1], "UNKNOWN_OUTPUT", vs="1")
    (tmp_path / "b.dat").write_text(made)
    table = read(tmp_path / "b.dat", quantity="reflectance_factor")
    assert largest_error(table, anisotropic) < 1e-12 and np.allclose(table.u_f, 0.1 / np.pi)


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        ("#DIM 1 1\n#PARAM_IN COS_TH\n0.5 1\n", "cannot be known"),
        ("#DIM 4 1\n#PARAM_IN STEREOGRAPHIC\n0 0 0 0 1\n", "cannot be known"),
        ("#DIM 4 1\n#PARAM_IN CARTESIAN\n0 0 1 0 1\n", "CARTESIAN has 6"),
        ("#DIM x\n#PARAM_IN CARTESIAN\n", "has the dimensions 'x'"),
        ("#DIM 6 1\n#PARAM_IN CARTESIAN\n0 0 2 0 0 1 1\n", "are no directions"),
        ("#DIM 6 1\n#PARAM_IN CARTESIAN\n#PARAM_OUT ENERGY\n0 0 1 0 0 1 1\n", "which is no BRDF"),
        ("#DIM 6 1\n#PARAM_IN CARTESIAN\n#FORMAT binary\n", "binary form"),
    ],
)
def test_what_is_no_brdf_of_two_directions_is_refused(tmp_path, made, expected):
    (tmp_path / "bad.dat").write_text(made)
    with pytest.raises(GonioError, match=expected):
        read(tmp_path / "bad.dat")

"""Brushed samples: their directions are those of the file, or it is said that the file has none."""

from pathlib import Path

import numpy as np
import pytest

import gonio
from gonio.fitting.surface_azimuth import FROM_THE_LIGHT, NO_AZIMUTH

BRUSHED = "ggx(alpha_x=?, alpha_y=?)"
WIDTHS = {"alpha_x": 0.15, "alpha_y": 0.35}


def ggx(theta_i, phi_i, theta_o, phi_o):
    """By the textbook, in NumPy [Walter 2007, eq. 33; Heitz 2014, eq. 99]: height-correlated masking, no Fresnel."""
    wi, wo = (
        np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)])
        for t, p in ((theta_i, phi_i), (theta_o, phi_o))
    )
    a, b = WIDTHS.values()
    h = (wi + wo) / np.linalg.norm(wi + wo, axis=0)
    density = 1 / (np.pi * a * b * ((h[0] / a) ** 2 + (h[1] / b) ** 2 + h[2] ** 2) ** 2)
    masked = sum((np.sqrt(1 + ((a * w[0]) ** 2 + (b * w[1]) ** 2) / w[2] ** 2) - 1) / 2 for w in (wi, wo))
    return density / (1 + masked) / (4 * wi[2] * wo[2])


def written(path: Path, names: str, degrees: list[np.ndarray], f: np.ndarray) -> Path:
    rows = [",".join(f"{x:.10g}" for x in row) for row in zip(*degrees, f, strict=True)]
    path.write_text("\n".join([f"{names},f", *rows]) + "\n", encoding="utf-8")
    return path


def in_planes(turns: list[float]) -> list[np.ndarray]:
    """Scans in the plane of incidence, the light at these azimuths of the sample; degrees."""
    theta_i, signed, phi_i = (a.ravel() for a in np.meshgrid([10, 40, 60], np.r_[-60:71:10], turns, indexing="ij"))
    return [theta_i, phi_i, np.abs(signed), (phi_i + 180.0 * (signed > 0)) % 360]


def widths(result: gonio.FitResult) -> dict[str, float]:
    return {p.name.removeprefix("ggx."): p.value for p in result.parameters if "alpha" in p.name}


@pytest.mark.parametrize("azimuth", [0, 90, 137, 270])
def test_a_scan_in_one_plane_shows_what_a_brushed_sample_scatters_there(azimuth: float, tmp_path: Path) -> None:
    angles = in_planes([azimuth])
    table = gonio.open(written(tmp_path / "t.csv", "theta_i,phi_i,theta_o,phi_o", angles, ggx(*np.radians(angles))))
    valid = table.flag.ravel() == 0
    assert valid.sum() >= angles[0].size
    np.testing.assert_allclose(table.f.ravel()[valid], ggx(*table.layout.angles())[valid], rtol=1e-6)


def test_scans_in_two_planes_tell_both_widths(tmp_path: Path) -> None:
    angles = in_planes([90, 137])
    path = written(tmp_path / "t.csv", "theta_i,phi_i,theta_o,phi_o", angles, ggx(*np.radians(angles)))
    assert widths(gonio.fit(path, BRUSHED, starts=1)) == pytest.approx(WIDTHS, rel=1e-4)


def test_where_no_azimuth_of_the_sample_is_known_it_is_said(tmp_path: Path) -> None:
    theta_i, theta_o, delta = (
        a.ravel() for a in np.meshgrid([10, 40, 60], [0, 20, 40, 60], np.r_[0:360:30], indexing="ij")
    )
    f = ggx(*np.radians([theta_i, 0 * theta_i, theta_o, delta]))
    path = written(tmp_path / "t.csv", "theta_i,theta_o,delta_phi", [theta_i, theta_o, delta], f)
    relative = gonio.fit(path, BRUSHED, starts=1)
    assert FROM_THE_LIGHT in relative.notes and widths(relative) == pytest.approx(WIDTHS, rel=1e-4)
    assert FROM_THE_LIGHT not in gonio.fit(path, "ggx", starts=1).notes
    half = gonio.measure("ggx(alpha=0.2)", scan=gonio.scan("half-difference", step=np.radians(15)))
    assert NO_AZIMUTH in gonio.fit(half, "ggx(alpha_x=0.2, alpha_y=0.3)").notes

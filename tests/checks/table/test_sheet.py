"""Verdicts on a sheet's BSDF in patches: honest ones pass, and each broken law is found."""

import numpy as np
import pytest

import gonio
from gonio.data.interpolation.scattering_blocks import BLOCKS
from support.check_tables import property_of
from support.window_xml import document, numbers, scattering


def certificate(tmp_path, matrices):
    path = tmp_path / "sheet.xml"
    path.write_text(document({name.title(): numbers(m) for name, m in matrices.items()}))
    return gonio.check(path)


def turned():
    """The number of the patch opposite to each, of the Quarter basis."""
    rings = np.split(np.arange(41), np.cumsum([1, 8, 12, 12]))
    return np.concatenate([np.roll(r, len(r) // 2) for r in rings])


def honest():
    """Exchanged directions are the opposite patches of the transposed matrix; through it, of the other side's."""
    back = turned()
    r, t = scattering(0, 0.4), scattering(1, 0.3)
    r = (r + r.T[back][:, back]) / 2
    return {
        "reflection front": r,
        "transmission front": t,
        "transmission back": t.T[back][:, back],
        "reflection back": 0.5 * r,
    }


def broken(name, factor, where=slice(None)):
    matrices = honest()
    matrices[name] = matrices[name].copy()
    matrices[name][where] *= factor
    return matrices


def test_an_honest_sheet_passes(tmp_path):
    c = certificate(tmp_path, honest())
    assert c.overall == "pass"
    assert c["reciprocity"].residual <= 1e-6
    assert c["energy"].residual == pytest.approx(0.7 - 1, abs=0.05)


@pytest.mark.parametrize(
    ("matrices", "law"),
    [
        (broken("transmission back", 1.3), "reciprocity"),
        (broken("reflection front", 1.4, slice(5, 20)), "reciprocity"),
        ({name: np.full((41, 41), 0.51 / np.pi) for name in BLOCKS}, "energy"),
    ],
    ids=["a side lost", "a ring too bright", "more than it receives"],
)
def test_broken_laws_are_found(tmp_path, matrices, law):
    c = certificate(tmp_path, matrices)
    assert c[law].verdict == "fail"


def test_energy_is_that_of_the_worst_incidence(tmp_path):
    """One bright patch of arriving light among 41 is enough, at its own direction, with R and T told apart."""
    matrices = honest()
    matrices["transmission back"] = matrices["transmission back"] * np.where(np.arange(41) == 30, 9.0, 1.0)
    energy = certificate(tmp_path, matrices)["energy"]
    assert energy.verdict == "fail" and energy.where["theta_i"] > 90
    assert "T " in energy.detail and "R " in energy.detail


def test_what_a_file_leaves_out_is_said(tmp_path):
    """Lit from the front alone, the sheet cannot be tested from side to side, and what it lacks is no failure."""
    matrices = {name: m for name, m in honest().items() if name.endswith("front")}
    c = certificate(tmp_path, matrices)
    assert c["energy"].verdict == "pass" and c["reciprocity"].verdict == "not testable"
    assert "behind" in c["reciprocity"].detail
    assert "lacks" in c["energy"].detail and "reflection back" in c["energy"].detail


def test_a_block_that_one_channel_lacks_is_named_in_the_verdict(tmp_path):
    """Its sum is of reflection alone there, which must not pass as R + T."""
    front = {n.title(): numbers(m) for n, m in honest().items() if n.endswith("front")}
    more = document({"Reflection Front": front["Reflection Front"]}, wavelength="Solar")
    layer = more.split("</DataDefinition>")[1].split("</Layer>")[0]
    path = tmp_path / "sheet.xml"
    path.write_text(document(front).replace("</Layer>", layer + "</Layer>"))
    assert "transmission front of Solar" in property_of("energy", path).detail
    path.write_text(document({"Reflection Front": front["Reflection Front"]}))
    assert property_of("energy", path).detail.startswith("The surface reflects no more")

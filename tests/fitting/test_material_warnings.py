"""What limits the use of a material's values is said beside them, by every verb."""

import numpy as np
import pytest

import gonio
from gonio.__main__ import main
from gonio.fitting.material_warnings import material_warnings

WIDE = "rayleigh_rice(wavelength=0.55, eta=1.5, a=0.02, b=50, c=2)"


def _fit_of(f):
    angles = np.meshgrid(np.radians([10.0, 50.0]), [0.0], np.radians(np.arange(0, 80, 10.0)), np.radians([0, 90, 180]))
    wi, wo = angles[0], angles[2]
    return gonio.fit(gonio.Table.from_arrays(*angles, f(np.cos(wi), np.cos(wo), np.cos(angles[3]))), "lambert")


@pytest.fixture
def failed(tmp_path, monkeypatch):
    """The file of a fit of a diffuser to a lobe that it cannot follow."""
    monkeypatch.chdir(tmp_path)
    _fit_of(lambda i, o, c: 0.01 + np.exp(-50 * ((i - o) ** 2 + (1 + c) ** 2))).save("lobe.toml")
    return "lobe.toml"


def test_a_failed_fit_is_called_so_by_every_verb_that_takes_it(failed, capsys):
    words = "lobe is a fit that was judged failed: do not use it"
    commands = (
        ["quantities", failed], ["check", failed], ["eval", failed, "--theta-o", "9"],
        ["eval", failed, "--theta-o", "9", "--values-only"],
        ["convert", failed, "scene.pbrt"], ["plan", failed, "--budget", "1h", "-o", "path.csv"],
        ["measure", failed, "--step", "30", "-o", "table.h5"], ["info", "table.h5"], ["check", "table.h5"],
    )  # fmt: skip
    for command in commands:
        assert main(command) in (0, 1, 3)
        captured = capsys.readouterr()
        assert words in " ".join((captured.out + captured.err).split()), command


def test_a_good_fit_and_a_material_within_its_limits_have_no_warning():
    assert not material_warnings(_fit_of(lambda i, o, c: np.full(i.shape, 0.1)).material)
    assert not material_warnings(gonio.material("gold"))


def test_a_model_beyond_what_it_is_made_for_says_so_beside_its_quantities():
    [note] = material_warnings(gonio.material(WIDE))
    assert "4πσ" in note and note in gonio.quantities(WIDE).notes and note in gonio.check(WIDE).notes

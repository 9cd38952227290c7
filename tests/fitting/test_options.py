"""Options of a fit: ranges, old names, and names that nobody knows."""

import math
import subprocess
import sys

import numpy as np
import pytest

import gonio
from gonio.data.hdf5.writer import write_table
from gonio.fitting.options import FitOptions, FitSettings
from gonio.metrology.fit_with_errors import AllFitOptions
from gonio.models.errors import GonioError
from support.fit_tables import coarse_table_of


@pytest.fixture(scope="module")
def table():
    return coarse_table_of("lambert(rho=0.3)")


def test_keywords_and_settings_are_the_same():
    assert list(FitOptions.__annotations__) == list(FitSettings.__dataclass_fields__)
    assert all(f"    {name}:" in gonio.fit.__doc__ for name in AllFitOptions.__annotations__)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"theta_max": 60}, "60 radians"),
        ({"theta_max": 0.0}, "up to π/2"),
        ({"theta_max": math.nan}, "radians"),
        ({"loss": "squared"}, "known are"),
        ({"loss": "cbtr"}, "did you mean 'cbrt'"),
        ({"weight": "solid"}, "solid-angle"),
        ({"robust": "tuky"}, "tukey"),
        ({"relative_noise": 5.0}, "between 0 and 1"),
        ({"relative_noise": 0.1, "loss": "log"}, "excludes the loss 'log'"),
        ({"bootstrap": 1}, "from 2 to"),
        ({"bootstrap_kind": "wlid"}, "wild"),
        ({"starts": -1}, "0 or more"),
        ({"samples": 0}, "1 or more"),
        ({"scene": "matte_room", "weight": "cosine"}, "give one of them"),
        ({"scene": "mate_room"}, "matte_room"),
    ],
)
def test_what_is_out_of_range_is_one_sentence(table, options, words):
    with pytest.raises(GonioError, match=words) as error:
        gonio.fit(table, "lambert", **options)
    assert "\n" not in str(error.value)


def test_a_right_angle_is_in_range(table):
    assert gonio.fit(table, "lambert", theta_max=np.radians(90)).theta_max == pytest.approx(np.pi / 2)


def test_unknown_options_are_refused_by_name(table):
    with pytest.raises(TypeError, match="'theta_maximum'; did you mean 'theta_max'"):
        gonio.fit(table, "lambert", theta_maximum=1.0)


def test_old_names_work_with_one_warning(table):
    lines = []
    with pytest.warns(DeprecationWarning, match="say is called log") as seen:
        result = gonio.fit(table, "lambert", say=lines.append)
    assert len(seen) == 1 and len(lines) == 1 and lines[0].startswith("lambert: converged")
    with pytest.warns(DeprecationWarning, match="requested") as seen:
        assert result.asked == result.requested == "lambert"
    with pytest.warns(DeprecationWarning, match="expression"):
        assert result.spelling == result.expression
    for old, new in (("residuals", "wild"), ("pairs", "block_pairs")):
        with pytest.warns(DeprecationWarning, match=f"'{old}' is called '{new}'") as seen:
            assert gonio.fit(table, "lambert", bootstrap=2, bootstrap_kind=old).bootstrap["kind"] == new
        assert len(seen) == 1


def test_the_command_line_takes_the_old_values(table, tmp_path):
    write_table(tmp_path / "t.h5", table)
    command = ["-m", "gonio", "fit", "t.h5", "-m", "lambert", "--bootstrap", "2", "--bootstrap-kind", "pairs"]
    run = subprocess.run([sys.executable, *command], cwd=tmp_path, capture_output=True, text=True, timeout=100)
    assert run.returncode == 0 and "bootstrap (block_pairs): 2 refits" in run.stdout


def test_every_subject_is_fitted(table, tmp_path):
    write_table(tmp_path / "t.h5", table)
    expression = gonio.fit(table, "lambert").expression
    with (tmp_path / "t.h5").open("rb") as file:
        for subject in (tmp_path / "t.h5", str(tmp_path / "t.h5"), file):
            assert gonio.fit(subject, "lambert").expression == expression
    with pytest.raises(GonioError, match="is a model, not a table; measure it first"):
        gonio.fit("lambert(rho=0.3)", "lambert")

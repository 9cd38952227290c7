"""What data leave open: named in words that are true, with the readings that would close it."""

import dataclasses

import numpy as np
import pytest

from gonio.fitting.fit_table import fit
from gonio.fitting.problem.parameterisation import Domains
from gonio.fitting.uncertainty.covariance import CovarianceEstimate, beyond_bound, open_from
from gonio.fitting.uncertainty.identifiability import describe_combination, unnamed_numbers
from gonio.fitting.uncertainty.optimum import ParameterEstimate
from support.fit_tables import table_of

FREE = "0.6*ggx(alpha=0.3, f0=0.1)+lambert(rho=.2)"


def words(change, p, names, linear=None):
    p = np.asarray(p, float)
    linear = np.zeros(p.size, bool) if linear is None else np.asarray(linear)
    return describe_combination(np.inf, np.asarray(change, float), p, names, linear)


def test_products_quotients_and_sums_are_named():
    names = ["ggx.alpha", "ggx.f0", "ggx.scale"]
    assert "ggx.f0·ggx.scale is" in words([0, 0.05, -0.3], [0.3, 0.1, 0.6], names)
    assert "ggx.f0/ggx.scale is" in words([0, 0.05, 0.3], [0.3, 0.1, 0.6], names)
    assert "ggx.f0·ggx.scale^2 is" in words([0, 0.1, -0.3], [0.3, 0.1, 0.6], names)  # +100 % and −50 %
    assert "ggx1.scale + ggx2.scale" in words([0.1, -0.1], [0.3, 0.5], ["ggx1.scale", "ggx2.scale"], [True, True])
    assert "ggx2.scale + 2 × ggx1.scale" in words([-0.1, 0.2], [0.3, 0.3], ["ggx1.scale", "ggx2.scale"], [True, True])
    assert words([1e-3, 0.1, 0], [0.3, 0.1, 0.6], names) == "ggx.f0 is not determined by these readings"
    assert "raising" in words([0.1, 0.1, 0.1], [0.3, 0.1, 0.6], names)


def test_channels_that_go_together_are_one():
    names = ["ggx.f0", "ggx.scale[R]", "ggx.scale[G]"]
    assert "ggx.f0·ggx.scale (every channel)" in words([0.1, -0.5, -0.2], [0.1, 0.5, 0.2], names)
    apart = words([0.1, -0.5, 0.0], [0.1, 0.5, 0.2], names)
    assert "ggx.f0·ggx.scale[R]" in apart and "every" not in apart


def test_the_named_product_is_what_stays():
    """Along the change, to first order, a·b^q does not move: the exponent that is said is the right one."""
    for rate in (0.4, -1.3, 2.5):
        text = words([0.01, 0.01 * rate], [1.0, 1.0], ["m.a", "m.b"])
        said = text.split("combination ")[1].split(" is")[0]
        lead, other = ("m.a", "m.b") if abs(rate) < 1 else ("m.b", "m.a")
        q = -1 / rate if abs(rate) < 1 else -rate
        assert said == f"{lead}{'·' if q > 0 else '/'}{other}^{abs(q):.2g}"


def test_angles_that_would_separate_do():
    """Readings up to the angle that is named determine both numbers; those up to 5° less leave them far less known."""
    few = fit(table_of(FREE, noise=0.01), "lambert + ggx(f0=?)", theta_max=np.radians(41), starts=0)
    (said,) = few.undetermined
    assert "ggx.f0·ggx.scale" in said and "these end at 40°" in said
    angle = float(said.split("readings up to ")[1].split("°")[0])
    assert 45 <= angle <= 75
    more = fit(table_of(FREE, noise=0.01), "lambert + ggx(f0=?)", theta_max=np.radians(angle + 1), starts=0)
    assert not more.undetermined
    before, after = (next(p for p in r.parameters if p.name == "ggx.f0") for r in (few, more))
    assert before.status == "undetermined" and after.status == "determined"


def test_what_no_reading_separates_is_said_so():
    twins = "lambert(rho=0.1)+0.3*ggx(alpha=0.2)+0.3*ggx(alpha=0.2)"
    result = fit(table_of(twins), "lambert(rho=.1) + ggx(alpha=.2) + ggx(alpha=.2)", starts=1)
    (said,) = result.undetermined
    assert "ggx2.scale + ggx1.scale" in said.replace("ggx1.scale + ggx2.scale", "ggx2.scale + ggx1.scale")
    assert "no readings would separate them" in said


def test_no_open_number_goesunnamed_numbers():
    """What is a small part of an open combination is a sentence of its own; channels are named all at once or each."""
    numbers = [
        ParameterEstimate(name, channel, 1.0, 9.0, (0.01, 20.0), status, "", 0.0, 50.0)
        for name, channel, status in (
            ("ggx.k", None, "undetermined"),
            ("ggx.eta", None, "undetermined"),
            ("ggx.scale", "R", "undetermined"),
            ("ggx.alpha", None, "determined"),
        )
    ]
    said = ["ggx.k is not determined by these readings; hold it at a known value (name=value)"]
    (more,) = unnamed_numbers(numbers, said)
    assert more.startswith("ggx.eta (95 % interval 0.01 to 20) and ggx.scale[R]") and more.count("ggx.") == 2
    spectral = [dataclasses.replace(numbers[2], channel=c) for c in ("550 nm", "650 nm")]
    (more,) = unnamed_numbers(
        spectral, ["only the combination ggx.scale[550 nm]·ggx.f0 is determined by these readings"]
    )
    assert more.startswith("ggx.scale[650 nm] ") and "550" not in more
    assert (
        unnamed_numbers(numbers[:1], said) == [] == unnamed_numbers(numbers[2:], ["ggx.scale (every channel) is not"])
    )


def test_strong_correlation_alone_is_not_undetermined():
    """Numbers known to 1e-6 are known, however correlated; with ten million times the noise they are not."""
    d = Domains(np.zeros(2, int), np.zeros(2), np.ones(2))
    matrix = np.array([[1.0, 1 - 1e-7], [1 - 1e-7, 1.0]]) * 1e20
    p = np.array([0.5, 0.5])
    good = CovarianceEstimate(matrix, None, 100, d, p).covariance(np.ones(2, bool))
    assert not good.undetermined.any() and not good.combinations
    bad = good.scaled(1e14, d, p)
    assert bad.undetermined.all() and len(bad.combinations) == 1
    change = bad.combinations[0][1]
    assert change[0] == pytest.approx(-change[1])


def test_open_is_a_domain_or_a_factor():
    d = Domains(np.array([0, 0, 1]), np.array([0, 0, 1e-4]), np.array([1.0, 1e6, 1.0]))
    expected = [1.0, 10 * np.tanh(1), 0.2]
    np.testing.assert_allclose(2 * 1.96 * open_from(d, np.array([0.3, 5.0, 0.1])), expected, rtol=1e-3)


def test_limit_at_a_bound():
    """Of a normal law cut off at the bound: by direct sampling, from far beyond it to on it."""
    rng = np.random.default_rng(0)
    for m in (0.0, 0.5, 2.0):
        draws = rng.normal(-m, 1, 4_000_000)
        expected = np.quantile(draws[draws > 0], 0.95)
        beyond, found = beyond_bound(np.eye(1), np.array([m]), np.eye(1), 0, np.array([], int))
        assert beyond == pytest.approx(m) and found == pytest.approx(expected, rel=0.01)
    _, far = beyond_bound(np.eye(1), np.array([40.0]), np.eye(1), 0, np.array([], int))
    assert far == pytest.approx(np.log(20) / 40, rel=0.01)

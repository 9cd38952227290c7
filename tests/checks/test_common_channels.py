"""Two tables of a surface are compared in the channels that both have, whatever their order."""

import numpy as np
import pytest

import gonio

ALBEDO = {450.0: 0.1, 550.0: 0.3, 650.0: 0.6}
NAMES = {"B": 0.1, "G": 0.3, "R": 0.6}


def table(albedos, **channels):
    theta_i, theta_o, phi = (a.ravel() for a in np.meshgrid(*[np.arange(0, 76, 15)] * 2, [0, 90, 180], indexing="ij"))
    f = np.array(list(albedos.values())) / np.pi * np.ones((theta_i.size, 1))
    return gonio.Table.from_arrays(theta_i, 0, theta_o, phi, f, degrees=True, **channels)


def spectrum(*wavelengths):
    return table({w: ALBEDO[round(w, -1)] for w in wavelengths}, wavelengths_nm=wavelengths)


def named(names):
    return table({n: NAMES[n] for n in names}, channels=list(names))


@pytest.mark.parametrize(
    ("one", "other", "lacking"),
    [
        (spectrum(450.0, 550.0, 650.0), spectrum(650.0, 550.0, 450.0), None),
        (named("RGB"), named("BGR"), None),
        (spectrum(550.0), spectrum(450.0, 550.0), None),
        (spectrum(550.0, 650.0), spectrum(549.6, 450.0), "650 nm"),
        (named("RG"), named("BR"), "G"),
    ],
    ids=["wavelengths", "names", "one of several", "some, nearly", "some names"],
)
def test_the_same_channels_are_compared(one, other, lacking):
    judged = gonio.check(one, against=other)["agreement"]
    assert judged.residual < 1e-9
    assert judged.verdict == ("pass" if lacking is None else "undecided")
    assert lacking is None or f"The reference has no {lacking}" in judged.detail
    assert gonio.check(one, against=_brighter(other))["agreement"].verdict == "fail"


def _brighter(other):
    return gonio.Table.from_arrays(
        *other.layout.angles(), 1.2 * np.asarray(other.f).reshape(-1, len(other.channels)),
        channels=other.channels.names, wavelengths_nm=other.channels.wavelengths_nm,
    )  # fmt: skip


def test_other_wavelengths_are_refused_and_grey_is_compared_with_all():
    with pytest.raises(gonio.GonioError, match="none is the same"):
        gonio.check(spectrum(450.0), against=spectrum(650.0))
    assert gonio.check(named("RGB"), against="lambert(rho=[0.6, 0.3, 0.1])")["agreement"].verdict == "pass"
    assert (
        gonio.check(spectrum(450.0, 550.0, 650.0), against="lambert(rho=[0.1, 0.3, 0.6])")["agreement"].verdict
        == "pass"
    )
    assert gonio.check(named("RGB"), against="lambert(rho=0.6)")["agreement"].verdict == "fail"


def test_the_channels_of_a_fit_are_those_of_its_table():
    fitted = gonio.fit(named("RGB"), "lambert")
    assert gonio.check(named("BGR"), against=fitted)["agreement"].verdict == "pass"
    assert gonio.check(fitted, against=named("BGR"))["agreement"].verdict == "pass"
    with pytest.raises(gonio.GonioError, match="give readings of all of them"):
        gonio.check(named("RG"), against=fitted)

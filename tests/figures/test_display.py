"""What notebooks show of public objects, and what `plot` draws."""

import xml.etree.ElementTree

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes

import gonio
from gonio.data.scene import load_scene
from gonio.instrument.scans import scan


@pytest.fixture(scope="module")
def shown():
    material = gonio.material("lambert(rho=0.3) + ggx(alpha=0.3)")
    table = gonio.measure(material, gonio.Instrument(photons=1e6), scan("isotropic", step=np.radians(10)))
    return {
        "material": material,
        "table": table,
        "fit": gonio.fit(table, "lambert + ggx", starts=0),
        "certificate": gonio.check(material),
        "instrument": gonio.Instrument(source_half_angle=0.02),
        "scene": load_scene("low_sun_car"),
        "reduction": gonio.reduce(table, "low_sun_car"),
        "repaired": gonio.repair(table),
    }


KINDS = {
    "material": ("lobe", "slice", "sphere", "albedo"),
    "table": ("lobe", "slice", "sphere", "albedo"),
    "fit": ("lobe", "slice", "sphere", "albedo", "residuals"),
    "certificate": ("albedo",),
    "instrument": ("directions",),
    "scene": ("directions",),
}


def test_a_repr_is_short_and_names_what_counts(shown):
    for name, one in shown.items():
        lines = repr(one).splitlines()
        assert 2 <= len(lines) <= 12 and max(map(len, lines)) <= 100, name
    assert "lambert(rho=0.3) + ggx(alpha=0.3)" in repr(shown["material"])
    assert f"{shown['table'].f.size:,} valid" in repr(shown["table"])
    assert "A POOR FIT" in repr(shown["fit"]) and "ggx.alpha" in repr(shown["fit"])
    assert shown["certificate"].overall.upper() in repr(shown["certificate"])


def test_a_notebook_shows_the_repr_and_a_picture(shown):
    for name, one in shown.items():
        tree = xml.etree.ElementTree.fromstring(one._repr_html_())
        assert tree.find("pre").text == repr(one)
        assert (tree.find("svg") is not None) == (name in KINDS and name != "certificate"), name


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name, kinds in KINDS.items() for kind in kinds])
def test_every_kind_of_plot_draws_on_the_axes_given(shown, name, kind):
    fig, ax = plt.subplots(subplot_kw={"projection": None})
    assert shown[name].plot(kind, ax=ax) is ax
    assert ax.has_data() or ax.patches
    fig.draw_without_rendering()
    plt.close(fig)


def test_without_axes_a_figure_is_made_and_options_reach_the_plot(shown):
    ax = shown["material"].plot(theta_i=np.radians(45), polar=False)
    assert isinstance(ax, Axes) and "45" in ax.get_legend().get_texts()[0].get_text()
    plt.close(ax.figure)


def test_a_kind_that_an_object_lacks_is_refused(shown):
    with pytest.raises(gonio.GonioError, match="no plot 'residual' of a Material"):
        shown["material"].plot("residual")

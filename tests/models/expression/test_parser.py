"""Models in words: what can be said, what is refused and how, and the way back."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gonio.models.brdf import Scaled, Sum, terms
from gonio.models.diffuse.lambert import Lambert
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build, terms_to_expression, to_expression
from gonio.models.expression.parser import parse
from gonio.models.geometry.directions import from_spherical
from gonio.models.microfacet.ggx import GGX

WI, WO = from_spherical(0.7, 0.2), from_spherical(0.5, 2.9)


def test_the_final_spellings():
    brdf = build("lambert(rho=0.3) + ggx(alpha=0.2, f0=0.04)")
    assert isinstance(brdf, Sum) and isinstance(brdf.parts[0], Lambert) and isinstance(brdf.parts[1], GGX)
    brdf = build('ggx(alpha_x=.1, alpha_y=.3, eta=[0.2, 1.1], k=[3, 2e0], smith="separable")')
    assert brdf.smith == "separable" and brdf.eta.shape == (2,) and float(brdf.alpha_y) == 0.3
    scaled = build("0.5 * ggx(alpha=0.1)")
    assert isinstance(scaled, Scaled) and float(scaled.scale) == 0.5
    assert evaluate(build("[1, 0.5, 0] * ggx(alpha=0.1)"), WI, WO).shape == (3,)


def test_brackets_spread_their_factor():
    spread, plain = build("2*(0.5*ggx(alpha=0.3)+lambert(rho=0.2))"), build("1*ggx(alpha=0.3) + 2*lambert(rho=0.2)")
    assert float(evaluate(spread, WI, WO)) == pytest.approx(float(evaluate(plain, WI, WO)), rel=1e-15)


def test_no_fresnel_means_one():
    f = [
        float(evaluate(build(f"ggx(alpha=0.3{e})"), WI, WO)) for e in ("", ", f0=1", ", eta=1.5", ", eta=1.5, k=1e-12")
    ]
    assert f[0] == pytest.approx(f[1], rel=1e-14) and f[2] == pytest.approx(f[3], rel=1e-10) and f[2] < 0.2 * f[0]


def test_what_a_fit_is_told():
    (first, second) = parse("lambert + ~0.4 * ggx(alpha~0.2, f0=?, smith=separable)")
    assert first.call.values == {} and first.scale is None
    assert second.scale.free and second.scale.number == 0.4
    assert second.call.values["alpha"].free and second.call.values["alpha"].number == 0.2
    assert second.call.values["f0"].free and second.call.values["f0"].number is None
    assert parse(terms_to_expression(parse("lambert + ~0.4 * ggx(alpha~0.2, f0=?)"))) == parse(
        "lambert + ~0.4 * ggx(alpha~0.2, f0=?)"
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ggxx(alpha=0.1)", ["ggxx", "ggx"]),
        ("ggx(alfa=0.1)", ["alfa", "alpha"]),
        ("ggx(alpha=2)", ["2", "[0.0001, 1]"]),
        ("ggx(alpha=0)", ["alpha", "0"]),
        ("ggx(alpha=1e999)", ["alpha"]),
        ("ggx(alpha=nan)", ["nan"]),
        ("ggx()", ["alpha"]),
        ("ggx(alpha=?)", ["alpha"]),
        ("? * ggx(alpha=0.1)", ["scale"]),
        ("lambert(rho=0.3", ["','", "the end"]),
        ("lambert(rho=0.3))", ["')'"]),
        ("lambert(rho=0.3) lambert(rho=0.3)", ["lambert"]),
        ("", ["name"]),
        ("lambert(rho=[])", ["number"]),
        ("lambert(rho=[0.1,0.2]) + ggx(alpha=0.1, eta=[1.5,1.5,1.5])", ["2", "3"]),
        ("ggx(alpha=0.1, f0=0.04, eta=1.5)", ["f0", "eta"]),
        ("ggx(alpha=0.1, k=1.5)", ["k", "eta"]),
        ("ggx(alpha=0.1, alpha_x=0.1, alpha_y=0.2)", ["alpha_x"]),
        ("ggx(alpha_x=0.1)", ["alpha_y"]),
        ("ggx(alpha=0.1, alpha=0.2)", ["twice"]),
        ('ggx(alpha=0.1, smith="separabel")', ["separabel", "separable"]),
        ("__import__('os').system('true')", ["__import__"]),
        ("(" * 50 + "lambert(rho=0.1)" + ")" * 50, ["brackets"]),
        ("lambert(rho=0." + "1" * 300_000 + ")", ["characters"]),
        (" + ".join(["lambert(rho=0.01)"] * 60), ["60 models", "32"]),
        ("coat(base=" * 6 + "lambert(rho=0.1)" + ", alpha=0.1, eta=1.5)" * 6, ["4 models stand over one another"]),
        ("x" * 150_000, ["Unknown model"]),
        (f"lambert(rho=[{'0.5,' * 4096}0.5])", ["4097 values"]),
        ("lambert(rho=0.1, \x1b[2J\n\u202e=3)", ["u001b"]),
    ],
)
def test_what_cannot_be_meant_is_one_sentence(text, words):
    with pytest.raises(GonioError) as error:
        build(text)
    said = str(error.value)
    assert "\n" not in said and len(said) < 400
    assert all(w in said for w in words), said


@example("[--0")
@settings(max_examples=200, deadline=None)
@given(st.text(alphabet="lambertgx()[]=,.*+-~?0123456789 \"'e", max_size=40))
def test_any_text_is_a_model_or_a_sentence(text):
    try:
        parse(text)
    except GonioError as error:
        assert "\n" not in str(error)


NUMBER = st.floats(1e-4, 1.0)


@settings(max_examples=60, deadline=None)
@given(NUMBER, NUMBER, NUMBER, st.lists(NUMBER, min_size=3, max_size=3), st.sampled_from(["correlated", "separable"]))
def test_spelling_reads_back_to_the_last_bit(rho, alpha_x, alpha_y, scale, smith):
    brdf = Lambert(rho=rho) + Scaled(jnp.asarray(scale), GGX(alpha_x=alpha_x, alpha_y=alpha_y, eta=1.5, smith=smith))
    back = build(to_expression(brdf))
    first, second = terms(back)
    assert float(first.rho) == rho and np.array_equal(second.scale, scale)
    assert (float(second.base.alpha_x), float(second.base.alpha_y), second.base.smith) == (alpha_x, alpha_y, smith)


def test_what_has_no_spelling_says_so():
    class Mine(Lambert):
        pass

    with pytest.raises(GonioError, match="Mine"):
        to_expression(Mine(rho=0.1))

"""Relative numbers for people."""

import math
import re

import hypothesis.strategies as st
from hypothesis import given

from gonio.models.display import percent


@given(st.floats(allow_nan=True), st.integers(1, 4))
def test_a_share_is_a_plain_number_or_a_word(share, digits):
    text = percent(share, digits)
    number = re.fullmatch(r"(-?\d{1,4}(?:\.\d{1,9})?) %", text)
    if number is None:
        assert text == ("not known" if not math.isfinite(share) else "more than 1000 %" if abs(share) > 1 else text)
        assert math.isfinite(share) is False or text in ("more than 1000 %", "below 0.0001 %")
    else:
        assert math.isclose(float(number[1]), 100 * share, rel_tol=0.5001 * 10 ** (1 - digits), abs_tol=1e-12)


def test_no_digits_that_nobody_needs():
    assert [percent(x) for x in (1.1, 0.05, 0.0052341, 9.127e14)] == ["110 %", "5 %", "0.52 %", "more than 1000 %"]

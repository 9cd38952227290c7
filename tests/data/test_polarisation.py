"""What names of channels say of polarisation."""

import pytest

from gonio.data.polarisation import Element, Polarised, shown_channel, states_of

MUELLER = [f"m{r}{c}" for r in range(4) for c in range(4)]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["550 nm s to p"], [Polarised("550 nm", "s", "p")]),
        (["s", "p"], [Polarised("", "s", "u"), Polarised("", "p", "u")]),
        (["u to u", "R"], [None, None]),
        (["s"], [None]),
        (["M11", "M12"], [Element("", 0, 0), Element("", 0, 1)]),
        (["m01", "m02"], [None, None]),
        (["S0", "S1"], [None, None]),
        (["S0", "S1", "S2"], [Element("", 0, 0), Element("", 1, 0), Element("", 2, 0)]),
        (["a I", "a Q", "a U", "b I"], [Element("a", 0, 0), Element("a", 1, 0), Element("a", 2, 0), None]),
        (["I", "R", "G"], [None, None, None]),
    ],
)
def test_states_are_told_by_names(names, expected):
    assert states_of(names) == expected


def test_pictures_show_a_radiance():
    assert shown_channel(MUELLER) == 0 and shown_channel(["R", "G", "B"]) == 1
    both = [f"{w} nm {name}" for w in (450, 550) for name in MUELLER]
    assert both[shown_channel(both)] == "550 nm m00"

"""Old names keep working, with one warning that points to the caller's line."""

import warnings

import pytest

from gonio.models.deprecation import renamed, renamed_attribute, renamed_options


class Thing:
    expression = "lambert"
    spelling = renamed_attribute("spelling", "expression")


def test_an_old_attribute_warns_once_at_the_callers_line():
    with pytest.warns(DeprecationWarning, match="spelling is called expression now") as caught:
        assert Thing().spelling == "lambert"
    assert len(caught) == 1 and caught[0].filename == __file__


def test_a_loop_over_one_call_site_warns_once():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        for _ in range(3):
            assert renamed("say", "log") == "log"
    assert len(caught) == 1


def test_old_options_are_handed_on_under_their_new_names():
    with pytest.warns(DeprecationWarning, match="say is called log now"):
        assert renamed_options({"say": print, "level": 2}, {"say": "log"}) == {"log": print, "level": 2}
    with pytest.raises(TypeError, match="give one of them"):
        renamed_options({"say": print, "log": print}, {"say": "log"})

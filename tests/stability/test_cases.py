"""The settings of a model: whatever its parameters are, each can be built."""

import pytest

from gonio.models.catalog import MODELS
from gonio.models.expression.builder import build
from gonio.stability.cases import settings_of


@pytest.mark.parametrize("name", MODELS)
def test_every_model_has_settings_that_can_be_built(name):
    settings = settings_of(name)
    assert settings and len(set(settings)) == len(settings)
    for expression in settings[:2]:
        build(expression)

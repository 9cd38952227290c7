import pkgutil

import pytest

from gonio.checks.properties import PROPERTIES


@pytest.mark.parametrize(("name", "spec"), PROPERTIES.items(), ids=PROPERTIES)
def test_the_named_checks_of_every_property_are_there(name, spec):
    for kind in ("model", "table"):
        path = getattr(spec, kind)
        assert path is None or callable(pkgutil.resolve_name(f"gonio.checks.{path}"))
        assert getattr(spec, f"{kind}_tolerance") > 0
    assert spec.counts in ("always", "strict", "never")

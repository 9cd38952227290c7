"""Compiled templates on disk: taken from there, and made anew when their text is another or what is kept is damaged."""

import jinja2
import pytest

from gonio.reports.kept_templates import KeptTemplates


def rendered(text: str, monkeypatch: pytest.MonkeyPatch, compiles: bool) -> str:
    environment = jinja2.Environment(loader=jinja2.DictLoader({"page": text}), bytecode_cache=KeptTemplates())
    if not compiles:
        monkeypatch.setattr(environment, "_generate", None)
    return environment.get_template("page").render(name="gold")


def test_templates_are_compiled_once(tmp_path, monkeypatch):
    monkeypatch.setenv("GONIO_PROGRAMS_DIR", str(tmp_path))
    assert rendered("Of {{ name }}.", monkeypatch, compiles=True) == "Of gold."
    assert rendered("Of {{ name }}.", monkeypatch, compiles=False) == "Of gold."
    assert rendered("About {{ name }}.", monkeypatch, compiles=True) == "About gold."
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:-1])
    assert rendered("Of {{ name }}.", monkeypatch, compiles=True) == "Of gold."

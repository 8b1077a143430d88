"""The public names: where each is from, for Python and for editors."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import torquebench


def test_the_stub_says_where_each_public_name_is_from():
    """``__init__.pyi`` is what ``scripts/public_names.py`` writes."""
    path = Path(__file__).parents[1] / "scripts" / "public_names.py"
    spec = importlib.util.spec_from_file_location("public_names", path)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    assert script.STUB.read_text(encoding="utf-8") == script.stub()


def test_each_public_name_is_listed_once():
    """No name has two homes."""
    listed = [name for names in torquebench._HOMES.values() for name in names]
    assert len(set(listed)) == len(listed)
    assert sorted(torquebench.__all__) == dir(torquebench)

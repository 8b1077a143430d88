"""The libraries of the pages are those of the lock, with their licences, and name nothing of who bundled them."""

import json
import re

import pytest

from tests.source_tree import SOURCE

WEB = SOURCE / "report" / "web"
LIBRARIES = WEB / "libraries"
SCRIPTS = SOURCE.parents[1] / "scripts" / "web"


@pytest.mark.parametrize(("name", "said"), [("uplot", r"uPlot \(v([\d.]+)\)"), ("three", r"three\.js ([\d.]+), MIT")])
def test_a_library_is_the_locked_one_and_has_its_licence(name, said):
    """The version in the file's first line is that of the lock and of package.json; the MIT text stands beside it."""
    lock = json.loads((SCRIPTS / "package-lock.json").read_text())["packages"]
    wanted = json.loads((SCRIPTS / "package.json").read_text())["devDependencies"][name]
    first = (LIBRARIES / f"{name}.js").read_text().splitlines()[0]
    assert re.search(said, first)[1] == wanted == lock[f"node_modules/{name}"]["version"]
    licence = (LIBRARIES / f"{name}.LICENSE").read_text()
    assert "The MIT License" in licence
    assert "Permission is hereby granted, free of charge" in licence


def test_the_lock_names_no_registry_but_the_public_one():
    """Every package has a checksum, and an address, where it has one, of registry.npmjs.org."""
    packages = json.loads((SCRIPTS / "package-lock.json").read_text())["packages"]
    for name, package in packages.items():
        if name:
            assert package["integrity"].startswith("sha512-"), name
            assert package.get("resolved", "https://registry.npmjs.org/").startswith("https://registry.npmjs.org/"), (
                name
            )


@pytest.mark.parametrize("path", sorted(WEB.rglob("*.js")), ids=lambda path: path.stem)
def test_a_script_can_stand_in_a_page_and_asks_for_nothing(path):
    """It does not end its element, and neither fetches, nor evaluates text, nor talks to the console by itself."""
    text = path.read_text()
    assert "</script" not in text.lower()
    assert "<!--" not in text
    if path.parent == WEB:
        assert not re.search(r"\b(fetch|XMLHttpRequest|WebSocket|import|eval|Function|innerHTML|console)\b", text)

"""What no file of the package may do: print, eval, pickle, assert, swallow errors; and no clock in what computes."""

from __future__ import annotations

import ast
import re

import pytest

from tests.source_tree import ALL, FILES, SOURCE, imports, tree_of

OUTER = (
    "experiment/",
    "report/",
    "check",
    "cli/",
    "sweep/",
    "view/",
    "kernel/cache.py",
    "sim/sandbox.py",  # which waits for a law only so long
    "sim/sandboxed.py",  # where all of them are taken away from a law
    "__init__.py",
    "__main__.py",
)
"""Where the time of day and temporary names have their place."""
CLOCKS = {"time", "datetime", "random", "secrets", "uuid"}
"""What would make a run depend on more than its inputs."""


def test_no_clock_and_no_global_randomness_below_the_experiment() -> None:
    """Laws, plants and metrics depend on their inputs alone: no wall clock, no random numbers but keyed ones."""
    inner = [name for name in ALL if not name.startswith(OUTER)]
    assert len(inner) > 100
    assert [name for name in inner if {module for module, _ in imports(tree_of(name))} & CLOCKS] == []
    # annotations may name the generator, and a generator may be made from a seed
    other = re.compile(r"np\.random\.(?!Generator\b|default_rng\(\w)")
    drawing = {name for name in inner if other.search(FILES[name].read_text(encoding="utf-8"))}
    assert drawing <= {"disturbances/streams.py"}


FORBIDDEN_CALLS = {"print", "eval", "exec", "compile", "__import__", "breakpoint", "input"}
FORBIDDEN_MODULES = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib"}


def sins(tree: ast.AST) -> list[str]:
    """Return what a file does that no file may do."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in FORBIDDEN_CALLS:
            found.append(f"{node.lineno}: {node.func.id}()")
        elif isinstance(node, ast.Assert):
            found.append(f"{node.lineno}: assert")
        elif isinstance(node, ast.ExceptHandler) and node.type is None:
            found.append(f"{node.lineno}: bare except")
        elif isinstance(node, ast.ExceptHandler) and all(isinstance(s, ast.Pass) for s in node.body):
            found.append(f"{node.lineno}: swallowed exception")
        elif isinstance(node, ast.keyword) and node.arg == "allow_pickle" and getattr(node.value, "value", 1):
            found.append(f"{node.value.lineno}: allow_pickle")
    found += [f"{line}: {m}" for m, line in imports(tree) if m.split(".")[0] in FORBIDDEN_MODULES]
    return found


def test_no_print_eval_pickle_assert_or_bare_except() -> None:
    """Output goes through one function of the command line, errors are raised, and stored data are never code."""
    assert {name: found for name in ALL if (found := sins(tree_of(name)))} == {}


@pytest.mark.parametrize(
    "text",
    [
        "print(1)",
        "eval('1')",
        "exec('1')",
        "import pickle",
        "from pickle import load",
        "assert x",
        "np.load(f, allow_pickle=True)",
        "try:\n    x\nexcept:\n    y",
        "try:\n    x\nexcept OSError:\n    pass",
        "def f():\n    import marshal",
    ],
)
def test_the_sin_check_catches(text: str) -> None:
    """Each forbidden construct is found."""
    assert len(sins(ast.parse(text))) == 1


def test_python_is_parsed_in_one_place() -> None:
    """Threads that check laws at once take turns at Python's parser, which 3.11 ends with a SystemError otherwise."""
    assert [name for name in ALL if "ast.parse(" in FILES[name].read_text(encoding="utf-8")] == ["syntax.py"]


def test_no_file_holds_the_marks_of_a_merge() -> None:
    """No line of any text of the project is a conflict mark."""
    root = SOURCE.parents[1]
    kinds = ("*.py", "*.md", "*.yaml", "*.toml", "*.xml", "*.json", "*.j2", "*.js", "*.css")
    folders = [root / name for name in ("src", "tests", "docs", "configs", "models", "scripts")]
    files = [path for folder in folders for kind in kinds for path in folder.rglob(kind)] + list(root.glob("*.md"))
    assert len(files) > 300
    marks = ("<" * 7 + " ", ">" * 7 + " ")
    marked = [path.name for path in files if any(x.startswith(marks) for x in path.read_text("utf-8").splitlines())]
    assert marked == []


def test_what_is_used_side_by_side_has_names_of_its_own() -> None:
    """No public class of `video` is called like one of `view`: the command that replays a run uses both."""
    names = {
        unit: {
            node.name
            for name in ALL
            if name.startswith(f"{unit}/")
            for node in tree_of(name).body
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
        }
        for unit in ("video", "view")
    }
    assert len(names["video"]) >= 5
    assert names["view"]
    assert names["video"] & names["view"] == set()

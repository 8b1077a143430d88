"""The package's architecture: who imports whom, which third-party package lives where, and how modules are written."""

from __future__ import annotations

import ast
import itertools
import json
import re
import subprocess
import sys
from collections.abc import Iterator

import pytest

from tests.source_tree import ALL, imports, tree_of

LAYERS = (
    ("begun", "errors", "plain", "syntax"),
    ("shipped",),
    ("registry", "timing"),
    ("figures", "keys"),
    ("kernel",),
    ("fuzzy", "robot"),
    ("references", "disturbances"),
    ("chain", "tuning"),
    ("laws",),
    ("dialect",),
    ("sim", "beliefs"),
    ("check_cases", "comparison"),
    ("check",),
    ("metrics", "statistics"),
    ("certificates", "describing"),
    ("experiment", "scene"),
    ("sweep", "diagnosis"),
    ("preflight",),
    ("report",),
    ("video", "results", "audit"),
    ("sweeps",),
    ("audits", "falsification", "tunings", "arena"),
    ("arenas", "diffs", "gym"),
    ("view",),
    ("cli",),
    ("__main__",),
)
"""From the bottom up; a unit imports itself and units below, never one beside or above it."""
RANK = {unit: rank for rank, units in enumerate(LAYERS) for unit in units}

HOMES = {
    "mujoco": ("robot/mjcf", "robot/importing/", "scene/", "sim/plants/", "video/", "view/"),
    "glfw": ("video/", "view/"),
    "OpenGL": ("video/",),
    "imageio_ffmpeg": ("video/",),
    "PIL": ("video/",),
    "subprocess": ("video/", "sim/sandbox.py"),
    "matplotlib": (
        "report/",
        "audit/",
        "video/",
        "results.py",
        "sweeps.py",
        "audits.py",
        "falsification.py",
        "tunings.py",
        "arena",
    ),
    "jinja2": ("report/",),
    "scipy": ("chain/", "diagnosis/poles.py", "statistics.py", "arena/", "sweep/", "robot/inverse_kinematics.py"),
    "skfuzzy": ("fuzzy/",),
    "pydantic": ("experiment/",),
    "pydantic_core": ("experiment/",),
    "pandas": (
        "experiment/",
        "sweep/",
        "report/",
        "audit/",
        "results.py",
        "sweeps.py",
        "audits.py",
        "tunings.py",
        "arenas.py",
    ),
    "numba": ("kernel/", "dialect.py", "check.py", "sim/"),
    "llvmlite": ("kernel/", "sim/"),
    "click": ("cli/",),
    "rich": ("cli/",),
    "gymnasium": ("gym.py",),
    "cma": ("sweep/search.py",),
    "optuna": ("sweep/search.py",),
    "distributed": ("sweep/",),
    "dask": ("sweep/",),
    "yaml": ("robot/", "experiment/", "cli/completion.py"),
    "tqdm": (),
    "argparse": (),
}
"""Package -> the beginnings of the names of the only files that may import it."""


def unit_of(name: str) -> str:
    """Return the layer unit of a file (``sim/job.py`` -> ``sim``) or of a dotted name (``torquebench.sim.job``)."""
    return name.removeprefix("torquebench.").replace("/", ".").removesuffix(".py").split(".")[0]


def upward(name: str, tree: ast.AST) -> list[str]:
    """Return the imports of a file that go sideways or up."""
    own = unit_of(name)
    wrong = []
    for module, line in imports(tree):
        if module.startswith("torquebench."):
            other = unit_of(module)
            if other != own and RANK[other] >= RANK[own]:
                wrong.append(f"{name}:{line}: {own} imports {module}")
    return wrong


def test_every_unit_has_a_layer() -> None:
    """A new top-level module or package must be given its place before it is used."""
    assert {unit_of(name) for name in ALL} - {"__init__"} == set(RANK)


def test_imports_go_down() -> None:
    """No file imports a unit beside or above its own in LAYERS, be it inside a function or for type checking only."""
    assert [fault for name in ALL if name != "__init__.py" for fault in upward(name, tree_of(name))] == []


def test_the_direction_check_catches_an_import_upwards() -> None:
    """Seeded imports from each unit to the one above it, in a function too, are found; downward ones are not."""
    for low, high in itertools.pairwise(LAYERS):
        for text in (f"import torquebench.{high[0]}", f"def f():\n    from torquebench import {high[0]}"):
            assert upward(f"{low[0]}/x.py", ast.parse(text)), (low, high)
        assert not upward(f"{high[0]}/x.py", ast.parse(f"from torquebench.{low[0]} import y"))
    assert upward("references.py", ast.parse("from torquebench import disturbances"))


def test_the_top_level_imports_nothing_when_imported() -> None:
    """``torquebench/__init__.py`` names its homes lazily: its only imports outside TYPE_CHECKING are the standard's."""
    for node in tree_of("__init__.py").body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            assert not any(module.startswith("torquebench") for module, _ in imports(node))


def test_heavy_packages_stay_in_their_places() -> None:
    """MuJoCo, matplotlib, pydantic, numba and the others are imported only where `HOMES` has a place for them."""
    found = [
        f"{name}:{line} imports {module}"
        for name in ALL
        for module, line in imports(tree_of(name))
        if not name.startswith(HOMES.get(module.split(".")[0], ""))
    ]
    assert found == []


def test_modules_say_what_they_are() -> None:
    """Every file's first line is a sentence that says what the file is."""
    lines = {name: (ast.get_docstring(tree_of(name)) or "").partition("\n")[0] for name in ALL}
    assert [name for name, line in lines.items() if not line.endswith((".", ":"))] == []


def public(tree: ast.Module) -> Iterator[tuple[str, ast.AST, ast.AST]]:
    """Every public class, function and method: its name, itself, and what carries its docstring."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield node.name, node, node
            for item in node.body:
                if isinstance(item, ast.FunctionDef):
                    if item.name == "__init__":
                        yield f"{node.name}.__init__", item, node
                    elif not item.name.startswith("_"):
                        yield f"{node.name}.{item.name}", item, item
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_") and not is_overload(node):
            yield node.name, node, node


def is_overload(node: ast.FunctionDef) -> bool:
    """Whether a function only states another type of the one that follows it, which has the docstring."""
    return any(isinstance(d, ast.Name) and d.id == "overload" for d in node.decorator_list)


def is_described_elsewhere(node: ast.AST) -> bool:
    """Whether a function is a law, whose arguments `Law` describes, or a command, whose options have a help each."""
    calls = [d.func for d in getattr(node, "decorator_list", []) if isinstance(d, ast.Call)]
    return any(isinstance(f, ast.Name) and f.id in ("controller", "command") for f in calls)


TERSE = {
    "draw",
    "fill_bias",
    "fill_centrifugal",
    "fill_coriolis",
    "fill_mass_matrix",
    "finish_page",
    "inertia_tensor",
    "pose_angles",
    "velocity_products",
}
"""Functions whose parameters are what their names and annotations say; this list may shrink, not grow."""


def described(doc: str) -> set[str] | None:
    """Return the names that a docstring's Args section describes, or None when it has none."""
    section = re.search(r"^Args:\n((?:[ ]+.*\n?|\n)+)", doc, flags=re.MULTILINE)
    if section is None:
        return None
    entries = re.findall(r"^    (\w+(?:, \w+)*):", section.group(1), flags=re.MULTILINE)
    return {name for entry in entries for name in entry.split(", ")}


def undocumented(tree: ast.Module) -> list[str]:
    """Return public things without a docstring, and parameters that no docstring describes.

    An Args section describes every parameter and nothing else. Without one, a function of more than three
    parameters names each of them in its own docstring, its class's or its module's.
    """
    found = []
    for name, node, carrier in public(tree):
        doc = ast.get_docstring(carrier)  # type: ignore[arg-type]
        if not doc:
            found.append(f"{name}: no docstring")
            continue
        if not isinstance(node, ast.FunctionDef) or is_described_elsewhere(node):
            continue
        a = node.args
        parameters = [
            x.arg
            for x in filter(None, (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg))
            if x.arg not in ("self", "cls")
        ]
        given = described(doc)
        if given is not None and given != set(parameters):
            found.append(f"{name}: Args are {sorted(given)}, parameters {sorted(parameters)}")
        elif given is None and len(parameters) > 3 and "rguments as" not in doc and name not in TERSE:
            words = doc + (ast.get_docstring(tree) or "")
            missing = [p for p in parameters if not re.search(rf"\b{re.escape(p)}\b", words)]
            if missing:
                found.append(f"{name}: does not say what {', '.join(missing)} is")
    return found


def test_public_things_are_documented() -> None:
    """Every public class and function has a docstring, and every parameter of a long signature is described."""
    assert {name: found for name in ALL if (found := undocumented(tree_of(name)))} == {}


@pytest.mark.parametrize(
    "text",
    [
        "def f(): ...",
        "class C: ...",
        "class C:\n    '''C.'''\n    def m(self): ...",
        "def f(a, b, c, d):\n    '''Add a, b and c.'''",
        "def f(a, b):\n    '''Add.\n\n    Args:\n        a: One.\n    '''",
        "def f(a, b):\n    '''Add.\n\n    Args:\n        a, b, c: Three.\n    '''",
    ],
)
def test_the_documentation_check_catches(text: str) -> None:
    """A missing docstring and a parameter that is not named are found."""
    assert len(undocumented(ast.parse(text))) == 1


HELP = """
from torquebench.cli.app import main
try:
    main({arguments})
except SystemExit:
    pass
"""
LOADED = """
import json, sys
{statement}
print()
print(json.dumps(sorted({{name.split('.')[0] for name in sys.modules}})))
"""


@pytest.mark.parametrize(
    "statement",
    [
        "import torquebench",
        "import torquebench; dir(torquebench); torquebench.__version__",
        *(
            HELP.format(arguments=arguments)
            for arguments in (
                ["--help"],
                ["run", "--help"],
                ["compare", "--help"],
                ["fuzzy", "--help"],
                ["check", "--help"],
                ["video", "--help"],
                ["run", "no-such-file.yaml"],
                ["fuzzy", "no-such-file.yaml"],
                ["run", "fig9", "--duration", "2"],
                ["completion", "bash"],
                ["completion", "zsh", "--json"],
            )
        ),
    ],
    ids=[
        "import",
        "dir",
        "help",
        "run help",
        "compare help",
        "fuzzy help",
        "check help",
        "video help",
        "missing config",
        "missing config of fuzzy",
        "mistyped option",
        "completion",
        "completion as JSON",
    ],
)
def test_help_and_import_are_light(statement: str) -> None:
    """Neither importing the package nor asking for help loads numpy, numba, MuJoCo, matplotlib or pydantic.

    Nor ``email``, which the metadata of packages need, nor ``webbrowser``: together a third of what ``--help`` took.
    """
    command = [sys.executable, "-c", LOADED.format(statement=statement)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    loaded = set(json.loads(done.stdout.splitlines()[-1]))
    assert "torquebench" in loaded
    heavy = {"numba", "mujoco", "matplotlib", "pydantic", "numpy", "yaml", "skfuzzy", "dask", "pandas", "rich"}
    assert loaded & (heavy | {"email", "webbrowser"}) == set()


def test_the_public_names_are_all_there() -> None:
    """Every name of ``__all__`` can be had, from the module that is named for it."""
    import torquebench

    assert len(set(torquebench.__all__)) == len(torquebench.__all__)
    for name in torquebench.__all__:
        assert getattr(torquebench, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        torquebench.simulat  # noqa: B018

"""Arms by the names that the package ``robot_descriptions`` gives them, from its cache on disk; nothing is fetched.

The package's own modules fetch a repository when they are imported. So they are read instead: each says by a few
constants in which repository, and where in it, the arm's file is.
"""

from __future__ import annotations

import ast
import importlib.util
import os
from pathlib import Path

from torquebench.errors import ModelError
from torquebench.syntax import parse_python

PACKAGE = "robot_descriptions"
CACHE = "ROBOT_DESCRIPTIONS_CACHE"
"""Environment variable that moves the package's cache."""
FILES = ("MJCF_PATH", "URDF_PATH")
"""What a module calls the path of its arm's file; the first that there is."""


def described_arm(name: str) -> Path | None:
    """Return the file of an arm such as ``panda_mj_description``; None where the package does not know the name.

    Raises:
        ModelError: the package knows it, but has not fetched it yet; says how to.
    """
    spec = importlib.util.find_spec(PACKAGE) if name.endswith("_description") else None
    folders = [Path(folder) for folder in (spec.submodule_search_locations or ())] if spec else []
    module = next((folder / f"{name}.py" for folder in folders if (folder / f"{name}.py").is_file()), None)
    if module is None:
        return None
    caches = _caches(module.with_name("_repositories.py"))
    paths = dict[str, str]()
    for node in parse_python(module.read_text(encoding="utf-8")).body:
        target = node.target if isinstance(node, ast.AnnAssign) else None
        if isinstance(target, ast.Name) and isinstance(node, ast.AnnAssign) and isinstance(node.value, ast.Call):
            paths[target.id] = _path(node.value, paths, caches)
    path = next((Path(paths[key]) for key in FILES if paths.get(key)), None)
    if path is None:
        raise ModelError(f"{name} of {PACKAGE} is no MJCF or URDF but a xacro: expand it, and name that file")
    if not path.is_file():
        how = f"python -c 'import {PACKAGE}.{name}' fetches it from its repository"
        raise ModelError(f"{name} of {PACKAGE} is not in its cache ({path}): {how}")
    return path


def _caches(repositories: Path) -> dict[str, str]:
    """Return repository -> its folder in the cache, from the file that lists them."""
    found = dict[str, str]()
    for node in ast.walk(parse_python(repositories.read_text(encoding="utf-8"))):
        for key, value in zip(node.keys, node.values, strict=True) if isinstance(node, ast.Dict) else ():
            keywords = value.keywords if isinstance(value, ast.Call) else []
            for keyword in keywords:
                if isinstance(key, ast.Constant) and keyword.arg == "cache_path":
                    found[str(key.value)] = str(ast.literal_eval(keyword.value))
    return found


def _path(call: ast.Call, known: dict[str, str], caches: dict[str, str]) -> str:
    """Return the path that a call stands for: a repository's folder, or parts joined; an empty one for another."""
    parts = [known.get(part.id, "") if isinstance(part, ast.Name) else ast.literal_eval(part) for part in call.args]
    if isinstance(call.func, ast.Attribute) and call.func.attr == "join":
        return os.path.join(*parts) if all(parts) else ""
    cache = Path(os.environ.get(CACHE) or "~/.cache/robot_descriptions").expanduser()
    return str(cache / caches[parts[0]]) if parts and parts[0] in caches else ""

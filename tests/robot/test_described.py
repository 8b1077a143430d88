"""Arms of the package robot_descriptions: found in its cache without importing it, and never fetched."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

from torquebench import load_model, run_experiment
from torquebench.errors import ModelError

ARM = """<mujoco><worldbody><body><inertial mass="2" pos="0.3 0 0" diaginertia="0.02 0.03 0.03"/>
<joint name="a" axis="0 1 0"/></body></worldbody><actuator><motor joint="a" ctrlrange="-60 60"/></actuator></mujoco>"""
MODULE = """from os import getenv as _getenv
from os import path as _path

from ._cache import clone_to_cache as _clone_to_cache

REPOSITORY_PATH: str = _clone_to_cache(
    "menagerie",
    commit=_getenv("ROBOT_DESCRIPTION_COMMIT", None),
)

PACKAGE_PATH: str = _path.join(REPOSITORY_PATH, "makers", "arm")

MJCF_PATH: str = _path.join(PACKAGE_PATH, "arm.xml")
"""
REPOSITORIES = """class Repository: ...
REPOSITORIES = {"menagerie": Repository(url="https://nowhere", commit="abc", cache_path="mujoco_menagerie")}
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package laid out as version 3.3 of robot_descriptions is, which fails if it is imported, and its cache."""
    package = tmp_path / "site" / "robot_descriptions"
    package.mkdir(parents=True)
    for name in ("__init__.py", "_cache.py"):
        (package / name).write_text("raise AssertionError('imported')")
    (package / "_repositories.py").write_text(REPOSITORIES)
    (package / "arm_mj_description.py").write_text(MODULE)
    monkeypatch.syspath_prepend(package.parent)
    importlib.invalidate_caches()
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "mujoco_menagerie" / "makers" / "arm"


def test_an_arm_of_the_cache_is_an_arm_by_its_name(cache: Path, tmp_path: Path) -> None:
    """From Python and from a config, whose folder keeps it; what is not in the cache is told with how to fetch it."""
    with pytest.raises(ModelError, match=r"is not in its cache .*: python -c 'import robot_descriptions.arm_mj_desc"):
        load_model("arm_mj_description")
    cache.mkdir(parents=True)
    (cache / "arm.xml").write_text(ARM)
    assert load_model("arm_mj_description").joint_names == ("a",)
    config = {
        "name": "x",
        "plant": {"model": "arm_mj_description"},
        "controllers": [{"law": "pd", "gains": {"lam": 10, "kv": 20}}],
        "reference": {"kind": "step", "target": 0.5, "at": 0.1},
        "run": {"duration": 2.5},
    }
    run_experiment(config, folder=tmp_path / "run")
    assert (tmp_path / "run" / "arm.xml").read_text() == ARM


def test_other_names_are_the_library_s_own(cache: Path) -> None:
    """A name that neither knows is answered as without the package."""
    assert cache.parts
    with pytest.raises(ModelError, match="unknown model 'no_such_description'"):
        load_model("no_such_description")

"""A small experiment and the command line, for the tests of this folder."""

import shutil

import pytest

from torquebench.cli.app import main

QUICK = """\
name: quick
plant: {engine: mujoco, model: puma560}
model: {structure: corrected, constants: printed}
controllers:
  - {name: conventional, law: smc, switching: sign, gains: {lam: 10, k: 0.3}}
  - {name: linear-band, law: linear-band-smc, gains: {lam: 10, k: 0.3, phi: 0.3, kv: 20}}
reference: {kind: sine, amplitude: 0.8, frequency_hz: 1.0}
run: {duration: 0.8, metrics_from: 0.2}
"""


@pytest.fixture
def quick(tmp_path, monkeypatch):
    """Path of a small experiment, in a folder that is also the current one."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "quick.yaml"
    path.write_text(QUICK)
    return path


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """Return the folder of a finished run, which tests copy."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "quick.yaml").write_text(QUICK)
    assert main(["run", str(folder / "quick.yaml"), "--out", str(folder / "one"), "--quiet"]) == 0
    return folder / "one"


@pytest.fixture
def run(quick, finished):
    """Return the folder of a finished run."""
    return shutil.copytree(finished, quick.parent / "one")

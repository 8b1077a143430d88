"""One run for the tests of this folder, from the objects of an experiment of two controllers."""

import pytest

from torquebench.experiment import load_experiment
from torquebench.experiment.build import build
from torquebench.experiment.run import run_experiment

CONFIG = """\
name: view-test
plant: {engine: mujoco, model: puma560}
model: {structure: corrected, constants: printed}
controllers:
  - {name: conventional, law: smc, switching: sign, gains: {lam: 10, k: 0.3}}
  - {name: pd, law: pd, gains: {lam: 5, kv: 20}}
reference: {kind: step, target: 0.6, at: 0.1}
run: {duration: 1.004, metrics_from: 0.2}
"""


@pytest.fixture(scope="session")
def experiment(tmp_path_factory):
    """A step of 0.6 rad on the PUMA, 1.004 s: the last frame is shorter than the others."""
    path = tmp_path_factory.mktemp("view") / "view.yaml"
    path.write_text(CONFIG)
    return load_experiment(path)


@pytest.fixture(scope="session")
def result(experiment):
    """What came out of it."""
    return run_experiment(experiment, build(experiment))

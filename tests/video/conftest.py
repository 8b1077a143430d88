"""One stored run for the tests of this folder, and the rule for back ends that do not draw."""

import os

import pytest

from torquebench.cli.app import main
from torquebench.video.opengl import probe

CONFIG = """\
name: film-test
plant: {engine: mujoco, model: puma560}
model: {structure: corrected, constants: printed}
controllers:
  - {name: conventional, law: smc, switching: sign, gains: {lam: 10, k: 0.3}}
  - {name: linear-band, law: linear-band-smc, gains: {lam: 10, k: 0.3, phi: 0.3, kv: 20}}
reference: {kind: sine, amplitude: 0.8, frequency_hz: 0.6}
run: {duration: 1.2, metrics_from: 0.2}
"""
TWO_LINK = """\
name: two-link-film
plant: {engine: mujoco, model: two-link}
controllers: [{name: pd, law: pd, gains: {lam: 5, kv: 10}}]
reference: {kind: sine, amplitude: 0.8, frequency_hz: 0.6}
run: {duration: 0.8, metrics_from: 0.2}
"""


def _run(folder, text):
    (folder / "config.yaml").write_text(text)
    assert main(["run", str(folder / "config.yaml"), "--out", str(folder / "run"), "--no-figures"]) == 0
    return folder / "run"


@pytest.fixture(scope="session")
def stored(tmp_path_factory):
    """Folder of a finished run of two controllers on the PUMA, 1.2 s; films are kept elsewhere or in a copy."""
    return _run(tmp_path_factory.mktemp("film"), CONFIG)


@pytest.fixture(scope="session")
def stored_two_link(tmp_path_factory):
    """Folder of a finished run on an arm without a look of its own, 0.8 s."""
    return _run(tmp_path_factory.mktemp("film"), TWO_LINK)


@pytest.fixture(scope="session")
def must_draw():
    """Skip a test whose back end does not draw here; fail it where TORQUEBENCH_RENDER=required, as in CI."""
    found = {}

    def check(name):
        backend = found.setdefault(name, probe(name))
        if not backend.ok:
            said = f"{name} does not draw here: {backend.why}; {backend.install}"
            if os.environ.get("TORQUEBENCH_RENDER") == "required":
                pytest.fail(f"TORQUEBENCH_RENDER=required, but {said}")
            pytest.skip(said)

    return check

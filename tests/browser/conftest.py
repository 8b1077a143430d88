"""A browser, stored runs to look at, and where pictures of pages are kept."""

import os
import shutil
from pathlib import Path

import pytest

from tests.browser import chromium
from tests.browser.chromium import WEBGL, Chromium, Page
from torquebench.cli.app import main
from torquebench.registry import restored

CONFIG = """\
name: browser-test
plant: {engine: mujoco, model: puma560}
controllers:
  - {name: conventional, law: smc, switching: sign, gains: {lam: 10, k: 0.3}}
  - {name: breaks, law: breaks, gains: {kp: 300}, expect: failed}
reference: {kind: step, target: 0.6, at: 0.1}
run: {duration: 1.2, metrics_from: 0.2}
"""
TWO_LINK = """\
name: two-link-test
plant: {engine: mujoco, model: two-link}
controllers:
  - {name: conventional, law: smc, switching: sign, gains: {lam: 10, k: 0.3}}
  - {name: band, law: linear-band-smc, gains: {lam: 10, k: 0.3, phi: 0.3, kv: 20}}
reference: {kind: step, target: 0.6, at: 0.1}
run: {duration: 1.2, metrics_from: 0.2}
"""
"""Two joints, two controllers that complete."""
LAW = '''\
"""A law that fails."""

from typing import Annotated, NamedTuple

from torquebench import Array, Gain, controller


class Gains(NamedTuple):
    kp: Annotated[Array, Gain("stiffness", "N m/rad")]


@controller("breaks", gains=Gains)
def breaks(gains, model, t, q, qd, ref, memory, tau):
    """tau = kp e - 0.1 kp qd, and an exception at 0.8 s."""
    if t >= 0.8:
        raise RuntimeError("out of order")
    for i in range(len(tau)):
        tau[i] = gains.kp[i] * (ref.q[i] - q[i]) - 0.1 * gains.kp[i] * qd[i]
'''


@pytest.fixture(scope="package")
def browse(tmp_path_factory):
    """Open tabs of a browser with WebGL, or without; skip where there is no browser, but fail where it is required."""
    if chromium.program() is None:
        said = "no Chromium here; apt-get install --no-install-recommends chromium"
        if os.environ.get("TORQUEBENCH_RENDER") == "required":
            pytest.fail(f"TORQUEBENCH_RENDER=required, but {said}")
        pytest.skip(said)
    started = {}

    def tab(webgl=True, **options):
        if webgl not in started:
            flag = WEBGL if webgl else "--disable-3d-apis"
            started[webgl] = Chromium(tmp_path_factory.mktemp("chromium") / "profile", flag)
        return Page(started[webgl], **options)

    yield tab
    for browser in started.values():
        browser.__exit__()


@pytest.fixture(scope="session")
def replayed(tmp_path_factory):
    """Folder of a finished run on the PUMA of two controllers, the second of which fails at 0.8 s."""
    folder = tmp_path_factory.mktemp("browser")
    (folder / "config.yaml").write_text(CONFIG)
    (folder / "law.py").write_text(LAW)
    with restored():
        command = ["run", str(folder / "config.yaml"), "--plugin", str(folder / "law.py"), "--out", str(folder / "run")]
        assert main([*command, "--no-figures"]) == 0
    return folder / "run"


@pytest.fixture(scope="session")
def reported(tmp_path_factory):
    """Folder with a finished run, a copy of it, and a page of both side by side."""
    folder = tmp_path_factory.mktemp("browser")
    (folder / "config.yaml").write_text(TWO_LINK)
    assert main(["run", str(folder / "config.yaml"), "--out", str(folder / "one"), "--no-figures"]) == 0
    shutil.copytree(folder / "one", folder / "two")
    runs = [str(folder / "one"), str(folder / "two")]
    assert main(["report", *runs, "--out", str(folder / "comparison.html")]) == 0
    return folder


@pytest.fixture
def keep(tmp_path):
    """Where a picture of a name goes: the test's own folder, or TORQUEBENCH_ARTIFACTS where that is set."""
    folder = Path(os.environ.get("TORQUEBENCH_ARTIFACTS") or tmp_path)
    folder.mkdir(parents=True, exist_ok=True)
    return lambda name: folder / f"{name}.png"

"""An arm with joints that slide, from its file to the terminal: m and N where they belong."""

import json

import numpy as np
import pytest

from tests.sim.arm_files import SLIDES, _arm
from torquebench import load_trajectory
from torquebench.metrics import METRICS, Metric
from torquebench.report.tables import joint_row
from torquebench.video.film import read_footage

CONFIG = """\
name: rail
plant: {engine: mujoco, model: rail, friction: {viscous: 1}}
controllers:
  - {name: weak, law: smc, switching: sign, gains: {lam: 10, k: 0.01}}
  - {name: pd, law: pd, gains: {lam: 10, kv: 20}}
reference: {kind: sine, amplitude: 0.1, frequency_hz: 1.0}
disturbances: [{kind: bias, channel: torque, value: 1}]
chain: {encoder_noise: 0.0001}
run: {duration: 0.8, metrics_from: 0.2}
"""
SLIDE = np.array([True, False, True, False])
"""The joints from the base: s1, a, s2, b."""


@pytest.fixture
def rail(tmp_path, monkeypatch):
    """A config with an arm of two slides and two hinges, in a data folder of its own."""
    folder = tmp_path / "models" / "rail"
    folder.mkdir(parents=True)
    (folder / "rail.xml").write_text(_arm(SLIDES, "s1 a s2 b"))
    monkeypatch.setenv("TORQUEBENCH_DATA", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rail.yaml").write_text(CONFIG)
    return tmp_path


def test_errors_in_mrad_and_in_mm(rail, command):
    """Each kind of joint has its columns, computed here from the trajectory; forces are in N; so it is on the page."""
    status, out, err = command("run", "rail.yaml", "--out", "out", "--no-figures")
    assert status == 0, err
    lines = out.splitlines()
    rule = next(i for i, line in enumerate(lines) if line.startswith("---"))
    # of "RMSE [mrad]" the unit tells the kind
    titles = [title.strip() for title in lines[rule - 1].replace("] ", "]  ").split("  ") if title.strip()]
    cells = dict(zip(titles, lines[rule + 2].split(), strict=True))
    run = load_trajectory("out/pd/trajectory.npz")
    error = np.abs((run.q_ref - run.q)[run.t > 0.2 - 1e-9])
    for unit, joints in (("mrad", ~SLIDE), ("mm", SLIDE)):
        own = 1e3 * error[:, joints]
        assert float(cells[f"RMSE [{unit}]"]) == pytest.approx(np.sqrt(np.mean(own**2)), rel=1e-3)
        assert float(cells[f"max [{unit}]"]) == pytest.approx(own.max(), rel=1e-3)
    note = next(shot.note for shot in read_footage(rail / "out").shots if shot.name == "pd")
    for unit in ("mrad", "mm"):
        assert f"RMSE {float(cells[f'RMSE [{unit}]']):.3g} {unit}" in note
    text = " ".join(out.split())
    assert "constant force or torque 1 N or N m" in text
    assert "viscous 1 N s/m or N m s/rad" in text
    assert "noise 0.1 mm or mrad" in text
    facts = json.loads((rail / "out" / "certificates.json").read_text())["weak"]["worst_margin"]
    unit = "N" if SLIDE[facts["joint"] - 1] else "N m"
    assert f"{facts['value']:.4g} {unit}" in text
    assert "s2 needs K >" in err or "s1 needs K >" in err
    assert " N, has" in err
    page = (rail / "out" / "report.html").read_text()
    assert "RMSE [mm]" in page
    assert "rad, m" in page


@pytest.mark.parametrize(
    ("slides", "unit", "value"),
    [
        ((False, False), "rad", "0.5"),
        ((True, True), "m", "0.5"),
        ((True, False), "rad, m", "-"),
    ],
)
def test_joints_of_two_kinds_have_no_headline_in_common(slides, unit, value):
    """A mean over rad and m is no number."""
    info = METRICS["rmse"]
    assert joint_row(info, Metric(0.5, (0.5, 0.5), 2), slides)[1:3] == [unit, value]


def test_the_puma_turns(quick, command):
    """No column in mm where nothing slides."""
    assert command("run", quick, "--out", "out", "--no-figures")[1].count("mm]") == 0

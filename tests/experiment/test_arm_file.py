"""An arm by the path of its file: where it may be, what is kept of it, and what a run says of its joints' ranges."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from torquebench import load_experiment, load_result, run_experiment, run_sweep
from torquebench.audits import read_audit, run_audit
from torquebench.cli.app import main
from torquebench.errors import ConfigError
from torquebench.experiment import load_experiment as load_file
from torquebench.experiment.arm import limit_remarks
from torquebench.experiment.build import build
from torquebench.experiment.certify import planned_torque

ARM = """<mujoco><compiler angle="radian"/><asset><mesh name="m" file="link.stl"/></asset><worldbody>
<body><inertial mass="2" pos="0.3 0 0" diaginertia="0.02 0.03 0.03"/>
<joint name="a" axis="0 1 0" damping="1.5" frictionloss="0.4" range="-0.3 2"/>
<geom type="mesh" mesh="m" contype="0" conaffinity="0"/></body></worldbody>
<actuator><motor joint="a" ctrlrange="-60 60"/></actuator></mujoco>"""
CONFIG = """name: mine
plant: {model: arms/my-arm.xml}
controllers: [{law: pd, gains: {lam: 10, kv: 20}}]
reference: {kind: step, target: -0.5, at: 0.1}
run: {duration: 2.5}
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A config in a folder of its own, with an arm below it and one beside it."""
    (tmp_path / "work" / "arms").mkdir(parents=True)
    (tmp_path / "work" / "arms" / "my-arm.xml").write_text(ARM)
    (tmp_path / "far.xml").write_text(ARM.replace('damping="1.5"', 'damping="3"'))
    path = tmp_path / "work" / "mine.yaml"
    path.write_text(CONFIG)
    return path


def files_of(folder: Path) -> dict[str, bytes]:
    """Return the content of each file below a folder, but for the manifest, which has the time in it."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != "manifest.json")
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def test_a_run_s_folder_stands_alone(config: Path, tmp_path: Path) -> None:
    """With the arm's file gone, the run is read, and run again from its folder, to the same bytes."""
    run_experiment(config, folder=tmp_path / "one")
    (config.parent / "arms" / "my-arm.xml").unlink()
    assert "model: my-arm.xml" in (tmp_path / "one" / "experiment.yaml").read_text()
    run_experiment(tmp_path / "one" / "experiment.yaml", folder=tmp_path / "two")
    assert files_of(tmp_path / "one") == files_of(tmp_path / "two")  # the page too, which says what was left out
    found = load_result(tmp_path / "one")
    assert not found.numbers.arm_changed
    assert found.report()
    assert any("left out, as they only look: mesh m" in flag for flag in found.flags)


def test_a_changed_copy_of_the_arm_is_noticed(config: Path, tmp_path: Path) -> None:
    """The arm in the folder is one of the run's files: a run with another one is refused."""
    run_experiment(config, folder=tmp_path / "one")
    kept = tmp_path / "one" / "my-arm.xml"
    kept.write_text(kept.read_text().replace('mass="2"', 'mass="3"'))
    with pytest.raises(Exception, match=r"my-arm.xml: missing or changed"):
        load_result(tmp_path / "one")


@pytest.mark.parametrize("model", ["../far.xml", "{far}", "arms/link.xml"])
def test_a_config_reaches_no_file_outside_its_folder(config: Path, model: str, tmp_path: Path) -> None:
    """Neither by dots, nor by a whole path, nor by a link; a person may allow it, or name the file themselves."""
    (config.parent / "arms" / "link.xml").symlink_to(tmp_path / "far.xml")
    named = model.format(far=tmp_path / "far.xml")
    config.write_text(CONFIG.replace("arms/my-arm.xml", named))
    with pytest.raises(ConfigError, match=r"mine.yaml:2:16: plant.model: .*is outside the folder of the config"):
        load_file(config)
    assert load_file(config, outside=True).plant.model.name == Path(named).stem  # type: ignore[union-attr]
    config.write_text(CONFIG)
    chosen = load_experiment(config, {"plant.model": tmp_path / "far.xml"})
    assert chosen == load_file(config, [f"plant.model={tmp_path / 'far.xml'}"])
    assert chosen.plant.model.name == "far"  # type: ignore[union-attr]


def test_what_is_no_file_is_told_with_its_folder(config: Path) -> None:
    """The place in the config, the folder that was searched, and the nearest file."""
    config.write_text(CONFIG.replace("my-arm.xml", "my-amr.xml"))
    with pytest.raises(ConfigError, match=r"there is no file arms/my-amr.xml in .*work.*did you mean '.*my-arm.xml'"):
        load_file(config)


def test_every_reason_against_an_arm_is_a_mistake_of_its_own(config: Path) -> None:
    """A file that cannot be taken, nor imported, gives one message for each reason, all at the same key."""
    arm = config.parent / "arms" / "my-arm.xml"
    arm.write_text(ARM.replace("<asset>", '<size memory="9T"/><extension/><asset>').replace('mass="2"', 'mass="-2"'))
    with pytest.raises(ConfigError) as refused:
        load_file(config)
    assert {problem.key for problem in refused.value.problems} == {"plant.model"}
    assert len(refused.value.problems) == 3


def test_an_experiment_with_an_arm_survives_python(config: Path) -> None:
    """As plain values and back it is equal; one with another arm of the same name is not."""
    experiment = load_file(config)
    assert type(experiment).from_dict(experiment.to_dict()) == experiment
    arm = config.parent / "arms" / "my-arm.xml"
    arm.write_text(ARM.replace('mass="2"', 'mass="3"'))
    assert load_file(config) != experiment


@pytest.mark.parametrize("engine", ["mujoco", "analytic"])
def test_a_joint_that_leaves_its_range(config: Path, engine: str) -> None:
    """warn: a remark with joint, time and distance, the numbers as with ignore; stop: the run ends there."""
    arm = config.parent / "arms" / "my-arm.xml"
    arm.write_text(ARM.replace("-0.3 2", "-0.3 0.5"))
    runs = {}
    for word in ("warn", "stop", "ignore"):
        changes = {"plant.limits": word, "plant.engine": engine, "reference.target": 0.45}
        runs[word] = run_experiment(load_experiment(config, changes))
    q, t = runs["warn"].trajectories["pd"].q[:, 0], runs["warn"].trajectories["pd"].t
    first = int(np.argmax(q > 0.5))
    (remark,) = [flag for flag in runs["warn"].flags if "leaves its range" in flag]
    assert remark.startswith(f"controller 'pd': a leaves its range, -0.3 to 0.5 rad, at {t[first]:.4g} s")
    assert f"up to {q.max() - 0.5:.3g} rad beyond it" in remark
    asked = run_experiment(load_experiment(config, {"plant.engine": engine}))
    (said,) = [flag for flag in asked.flags if "leaves its range" in flag]
    assert said.startswith("the reference: a leaves its range, -0.3 to 0.5 rad, at 0.1 s and goes up to 0.2 rad beyond")
    nearly = run_experiment(load_experiment(config, {"plant.engine": engine, "reference.target": 0.50009}))
    assert not any(flag.startswith("the reference: a leaves") for flag in nearly.flags)
    assert runs["ignore"].trajectories["pd"].digest() == runs["warn"].trajectories["pd"].digest()
    assert not any("leaves its range" in flag for flag in runs["ignore"].flags)
    stopped = runs["stop"].trajectories["pd"]
    assert (stopped.outcome.name, stopped.failed_at) == ("OUT_OF_RANGE", first - 1)
    assert stopped.q.tobytes() == runs["warn"].trajectories["pd"].q[:first].tobytes()
    assert "joint 1" in stopped.detail


def test_a_joint_that_is_faster_than_its_limit(config: Path, tmp_path: Path, capsys: Any) -> None:
    """Told with joint, time and speed: the reference's where it asks for that, else the run's; report says so too."""
    arm = config.parent / "arms" / "my-arm.xml"
    arm.write_text(ARM.replace("<actuator>", '<custom><numeric name="speed_limits" data="1.5"/></custom><actuator>'))
    folder = tmp_path / "one"
    assert main(["run", str(config), "--out", str(folder)]) == 0
    told = capsys.readouterr().err
    run = load_result(folder)
    qd, t = np.abs(run.trajectories["pd"].qd[:, 0]), run.trajectories["pd"].t
    first = int(np.argmax(qd > 1.5))
    text = f"a exceeds its speed limit, 1.5 rad/s, at {t[first]:.4g} s and reaches {qd.max():.4g} rad/s"
    assert f"controller 'pd': {text}" in run.flags
    assert main(["report", str(folder)]) == 0
    again = capsys.readouterr().err
    assert text in told
    assert [line.partition(": ")[2] for line in again.splitlines()] == [f"{folder}: {flag}" for flag in run.flags]
    sine = {"reference": {"kind": "sine", "amplitude": 0.2, "frequency_hz": 4.0}}
    flags = run_experiment(load_experiment(config, sine)).flags
    assert any(flag.startswith("the reference: a exceeds its speed limit, 1.5 rad/s, at ") for flag in flags), flags
    assert not any("'pd': a exceeds" in flag for flag in flags)
    ignored = run_experiment(load_experiment(config, {"plant.limits": "ignore"}))
    assert not any("exceeds its speed limit" in flag for flag in ignored.flags)


def test_both_paths_stop_alike(config: Path) -> None:
    """Compiled and interpreted, the run ends at the same instant with the same bytes."""
    experiment = load_experiment(config, {"plant.limits": "stop"})
    runs = [run_experiment(experiment, path=path).trajectories["pd"] for path in ("native", "python")]  # type: ignore[arg-type]
    assert runs[0].digest() == runs[1].digest()


def test_friction_of_the_file_can_be_replaced_or_switched_off(config: Path) -> None:
    """Left out it is the arm's own; none is the arm without it; the conditions of the run say which it is."""
    own, none, same = (
        run_experiment(load_experiment(config, changes))
        for changes in ({}, {"plant.friction": "none"}, {"plant.friction": {"viscous": 1.5, "coulomb": 0.4}})
    )
    assert own.trajectories["pd"].digest() == same.trajectories["pd"].digest()
    assert own.trajectories["pd"].digest() != none.trajectories["pd"].digest()
    assert "the arm's own friction viscous 1.5 N m s/rad, Coulomb 0.4 N m" in own.conditions
    assert "no friction" in none.conditions
    assert none.experiment.to_dict()["plant"]["friction"] == "none"
    assert own.experiment.to_dict()["plant"].get("friction") is None


def test_a_speed_alone_is_that_of_the_file_s_friction(config: Path) -> None:
    """The run is that of the same numbers written out; its conditions say whose they are, and the speed is kept."""
    own, same = (
        run_experiment(load_experiment(config, {"plant.friction": {**numbers, "speed": 0.5}}))
        for numbers in ({}, {"viscous": 1.5, "coulomb": 0.4})
    )
    assert own.trajectories["pd"].digest() == same.trajectories["pd"].digest()
    assert "the arm's own friction viscous 1.5 N m s/rad, Coulomb 0.4 N m" in own.conditions
    assert own.experiment.to_dict()["plant"]["friction"]["speed"] == 0.5


def test_a_sweep_over_arms_stands_alone(config: Path, tmp_path: Path, capsys: Any) -> None:
    """Its folder keeps them: rows, told with their keys, and the sweep run again without the files it was given."""
    config.write_text(CONFIG + "sweep: {grid: {plant.model: [arms/my-arm.xml, arms/b.xml]}}\n")
    (config.parent / "arms" / "b.xml").write_text(ARM.replace('mass="2"', 'mass="3"'))
    sweep = run_sweep(config, workers=1, folder=tmp_path / "s")
    assert sorted(path.name for path in (tmp_path / "s" / "arms").iterdir()) == ["b.xml", "my-arm.xml"]
    assert "arms/b.xml" in json.loads((tmp_path / "s" / "manifest.json").read_text())["files"]
    for path in (config.parent / "arms").iterdir():
        path.unlink()
    assert main(["run", "--from-sweep", str(tmp_path / "s"), "--index", "1", "--out", str(tmp_path / "row")]) == 0
    assert f"row 1 of {tmp_path / 's'}: plant.model=arms/b.xml; draw 0, controller " in capsys.readouterr().out
    assert (tmp_path / "row" / "b.xml").read_bytes() == (tmp_path / "s" / "arms" / "b.xml").read_bytes()
    again = run_sweep(tmp_path / "s" / "sweep.yaml", workers=1)
    assert again.to_dataframe().equals(sweep.to_dataframe())
    experiment: Any = load_result(tmp_path / "row").experiment
    assert run_sweep(experiment, workers=1).to_dataframe()["rmse"][0] == sweep.to_dataframe()["rmse"][1]


def test_model_takes_any_arm_on_the_command_line(config: Path, tmp_path: Path) -> None:
    """An arm of another folder, and a URDF, by --model, for a run and for a sweep."""
    urdf = tmp_path / "pendulum.urdf"
    urdf.write_text(
        '<robot name="p"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 0.4"/><mass value="1.5"/>'
        '<inertia ixx="0.05" iyy="0.05" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="swing" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>'
        '<limit effort="40" velocity="5" lower="-3" upper="3"/></joint></robot>'
    )
    for arm in (tmp_path / "far.xml", urdf):
        out = tmp_path / f"run-{arm.stem}"
        assert main(["run", str(config), "--model", str(arm), "--out", str(out)]) == 0
        assert (out / f"{arm.stem}.xml").is_file()
        assert load_result(out).joints.names == (("swing",) if arm is urdf else ("a",))
    out = tmp_path / "sweep"
    assert main(["sweep", str(config), "--model", str(urdf), "--set", "sweep.draws=1", "--out", str(out)]) == 0
    assert main(["run", "--from-sweep", str(out), "--index", "0", "--out", str(tmp_path / "row")]) == 0


def test_what_the_arm_cannot_do_of_its_reference_is_said_before_the_run(config: Path, capsys: Any) -> None:
    """Range and torque of the motion that is asked for: joint, time and number, once, whatever the law.

    A sine of 1 rad leaves the range. The torque is I qdd - m g c cos q + b qd +- 0.4 N m, with I = 0.03 + 2 x 0.3^2.
    """
    config.write_text(
        CONFIG.replace("{kind: step, target: -0.5, at: 0.1}", "{kind: sine, amplitude: -1, frequency_hz: 2}")
    )
    flags = run_experiment(load_experiment(config, {"run.duration": 1.5})).flags
    (said,) = [flag for flag in flags if "leaves its range" in flag]
    assert said.startswith("the reference: a leaves its range, -0.3 to 2 rad, at ")
    config.write_text(
        config.read_text().replace("frequency_hz: 2", "frequency_hz: 4.5").replace("}\nrun", ", origin: 1}\nrun")
    )
    experiment = load_experiment(config, {"run.duration": 1.5})
    (said,) = [flag for flag in run_experiment(experiment).flags if "more torque" in flag]
    t = np.arange(0.0, 1.5, 0.001)
    q, qd, qdd = (build(experiment).reference[i][:, 0] for i in range(3))
    needed = np.abs(0.21 * qdd - 2 * 9.81 * 0.3 * np.cos(q) + 1.5 * qd + 0.4 * np.clip(qd / 1e-9, -1, 1))
    assert f"a {needed.max():.3g}"[:4] in said
    assert f"at {t[needed.argmax()]:.4g} s" in said
    assert "limit is 60 N m" in said
    k = int(needed.argmax())
    parts = {"gravity": -2 * 9.81 * 0.3 * np.cos(q), "inertia": 0.21 * qdd, "friction": 1.5 * qd + 0.4 * np.sign(qd)}
    sign = np.sign(sum(parts.values())[k])  # one link has no velocity terms, and friction is small where it turns round
    told = dict(part.rsplit(" ", 1) for part in said.partition("(")[2].rstrip(")").split(", "))
    assert set(told) == {name for name, x in parts.items() if abs(x[k]) > 0.005 * needed[k]} >= {"gravity", "inertia"}
    for name, text in told.items():
        assert float(text) == pytest.approx(sign * parts[name][k], rel=6e-3), name  # three digits


@pytest.mark.parametrize(("limit", "told"), [(5.5, True), (6.5, False)])
def test_an_arm_that_cannot_hold_itself_is_told_so(config: Path, limit: float, told: bool) -> None:
    """Gravity at the start, m g c cos 0 = 5.886 N m, against the limit; the line is there where it is more."""
    config.write_text(CONFIG)
    arm = config.parent / "arms" / "my-arm.xml"
    arm.write_text(arm.read_text().replace("60", f"{limit}"))
    experiment = load_experiment(config)
    lines = [line for line in planned_torque(experiment, build(experiment)) if "hold itself" in line]
    assert [f"gravity alone needs 5.886 N m of a, its limit is {limit} N m" in line for line in lines] == [True] * told


@pytest.mark.parametrize(("own", "told"), [("", True), ('armature="0.001" ', False)])
def test_a_light_joint_without_a_rotor_is_told_so(config: Path, own: str, told: bool) -> None:
    """60 N m on 0.03 + 2 x 0.3^2 = 0.21 kg m^2 change 0.29 rad/s in 1 ms, in 50 ms 14.3: then a line is there."""
    config.write_text(CONFIG)
    arm = config.parent / "arms" / "my-arm.xml"
    arm.write_text(arm.read_text().replace("<joint name", f"<joint {own}name"))
    for period, is_long in ((1e-3, False), (50e-3, True)):
        experiment = load_experiment(config, {"run.control_period": period})
        lines = [line for line in planned_torque(experiment, build(experiment)) if "no armature" in line]
        assert [" of a by 14.3 rad/s in 50 ms" in line for line in lines] == [True] * (told and is_long)


def test_limits_that_no_controller_comes_near_are_asked_about() -> None:
    """1.5 of 100 N m is 1.5 %; one that uses 3 % of another joint's, or one that failed, keeps the question back."""
    small, more = (SimpleNamespace(completed=True, tau=np.array([[1.5, x]])) for x in (0.0, 1.5))
    limits, failed = (100.0, 50.0), SimpleNamespace(completed=False, tau=np.zeros((1, 2)))
    assert limit_remarks({"a": small}, limits) == [
        "no controller uses more than 1.5 % of a torque limit: are the limits right?"
    ]
    assert limit_remarks({"a": small, "b": more}, limits) == limit_remarks({"a": small, "b": failed}, limits) == []


@pytest.mark.parametrize(
    ("model", "words"),
    [
        ("arms/", r"arms/ is a folder \(did you mean '.*my-arm.xml'\?\)"),
        ("ok.yaml", r"got the text 'ok.yaml', wanted .*\(.xml, .urdf\)"),
    ],
)
def test_a_folder_and_another_file_are_no_arms(config: Path, model: str, words: str) -> None:
    """The arm's file in a folder is suggested; a file of another kind is told what is wanted."""
    config.write_text(CONFIG.replace("arms/my-arm.xml", model))
    with pytest.raises(ConfigError, match=words):
        load_file(config)


def test_a_mistake_of_an_option_is_called_by_it(config: Path, capsys: Any) -> None:
    """``--model nosuch.xml`` is answered with --model, not with the key that it sets."""
    assert main(["run", str(config), "--model", "nosuch.xml"]) == 2
    said = capsys.readouterr().err
    assert "--model nosuch.xml" in said
    assert "--set" not in said


def test_an_audit_judges_an_arm_by_its_file(config: Path, tmp_path: Path) -> None:
    """Its folder stands alone: with the arm's file gone it is read, and judged to the same values."""
    study = CONFIG.replace("target: -0.5", "target: 0.5") + (
        "audit:\n  conditions: {burden: {none: {}, some: {plant.payload: {mass: 0.5}}}}\n  claims:\n    good:\n"
        "      says: It follows.\n      where: here\n      implied: here\n      pairs: {pd: pd}\n"
        "      measures: [{figure: rmse, below: 1, why: A radian}]\n      under: {burden: all}\n"
    )
    config.write_text(study)
    done = run_audit(config, folder=tmp_path / "out", workers=1, figures=False)
    assert [str(claim.verdict) for claim in done.claims] == ["holds"]
    (config.parent / "arms" / "my-arm.xml").unlink()
    again = read_audit(tmp_path / "out")
    assert again.to_dataframe().equals(done.to_dataframe())

"""``torquebench run``: what is written, what is refused, and how it ends."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from torquebench import load_trajectory
from torquebench.cli.app import Ending, Terminated, guarded, main
from torquebench.disturbances import Stream, generator
from torquebench.errors import UNCHECKED, ConfigError, ResultError
from torquebench.experiment import load_experiment
from torquebench.experiment.store import check_run, claim_folder
from torquebench.robot import load_model
from torquebench.robot.library import data_root
from torquebench.robot.perturbation import draw_factors
from torquebench.sim.trajectory import SIGNALS


def test_a_run_directory_is_complete_and_checks_out(quick, command):
    """Every file of the design is there, the manifest's checksums hold, and the summary names every controller."""
    status, out, err = command("run", quick, "--out", "result")
    folder = quick.parent / "result"
    assert (status, err) == (0, "")
    manifest = check_run(folder)
    expected = {"experiment.yaml", "metrics.json", "certificates.json", "report.html"}
    expected |= {f"{name}/trajectory.npz" for name in ("conventional", "linear-band")}
    assert set(manifest["files"]) == expected
    assert {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()} == expected | {"manifest.json"}
    assert manifest["outcomes"]["conventional"]["outcome"] == "COMPLETED"
    assert {"torquebench", "mujoco", "numpy", "python"} <= set(manifest["software"])
    for word in ("conventional", "linear-band follows best", "RMSE", "HF", "disturbance: none", "metrics from 0.2 s"):
        assert word in out
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["controllers"]["linear-band"]["hf"]["value"] < metrics["controllers"]["conventional"]["hf"]["value"]
    assert metrics["conditions"]["noise"] == "none"


def test_a_run_loads_only_what_it_uses(quick):
    """Without a fuzzy part and figures there is no skfuzzy, networkx or matplotlib; pandas and scipy.stats never."""
    quick.write_text(quick.read_text().replace("engine: mujoco", "engine: analytic"))
    heavy = {"skfuzzy", "networkx", "matplotlib", "pandas", "scipy.stats", "scipy.special", "scipy.signal"}
    code = (
        "import sys; from torquebench.cli.app import main; print("
        f"main(['run', 'quick.yaml', '--out', 'result', '-q']), sorted({heavy} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "0 []"


def test_the_stored_trajectory_has_every_signal(quick, command):
    """trajectory.npz loads without pickle, holds each signal (N, n) at t = k T, and has the manifest's digest."""
    command("run", quick, "--out", "result", "--no-figures")
    folder = quick.parent / "result"
    with np.load(folder / "conventional" / "trajectory.npz", allow_pickle=False) as stored:
        assert {"t", "outcome", "failed_at", *SIGNALS} <= set(stored.files)
    run = load_trajectory(folder / "conventional" / "trajectory.npz")
    assert np.array_equal(run.t, np.arange(800) * 0.001)
    assert all(getattr(run, name).shape == (800, 6) for name in SIGNALS)
    assert run.digest() == check_run(folder)["outcomes"]["conventional"]["digest"]


def test_the_resolved_experiment_repeats_the_run_byte_for_byte(quick, command):
    """Running the stored experiment.yaml gives the same trajectories and the same config hash."""
    command("run", quick, "--out", "first", "--no-figures", "--set", "controllers.linear-band.gains.phi=0.5")
    command("run", "first/experiment.yaml", "--out", "second", "--no-figures")
    manifests = [check_run(quick.parent / name) for name in ("first", "second")]
    assert manifests[0]["files"] == manifests[1]["files"]
    assert manifests[0]["config_sha256"] == manifests[1]["config_sha256"]
    changed = load_experiment(quick.parent / "second" / "experiment.yaml").controllers[1]
    assert changed.gains["phi"] == 0.5


def test_noise_is_keyed_by_seed_and_draw(quick, command):
    """The same seed and draw give the same bytes; another draw gives others; both controllers get the same noise."""
    noise = "disturbances=[{kind: band-limited-noise, channel: torque, sigma: 1.0}]"
    digests = []
    for index, draw in enumerate((0, 0, 1)):
        command("run", quick, "--out", f"r{index}", "--no-figures", "--set", noise, "--set", f"run.draw={draw}")
        digests.append(check_run(quick.parent / f"r{index}")["outcomes"]["conventional"]["digest"])
    assert digests[0] == digests[1] != digests[2]
    a, b = (load_trajectory(quick.parent / "r0" / n / "trajectory.npz") for n in ("conventional", "linear-band"))
    # (tau + d) - tau loses d's last bits, hence not exactly equal
    assert np.allclose(a.tau_applied - a.tau, b.tau_applied - b.tau, atol=1e-12)


def test_a_folder_that_is_not_empty_is_refused(quick, command):
    """Exit 2, nothing written, nothing lost."""
    (quick.parent / "full").mkdir()
    (quick.parent / "full" / "keep.txt").write_text("mine")
    status, out, err = command("run", quick, "--out", "full")
    assert (status, out) == (2, "")
    assert "not empty" in err
    assert [p.name for p in (quick.parent / "full").iterdir()] == ["keep.txt"]


def test_default_folder_is_named_after_the_experiment(quick, command):
    """Without --out results go to runs/NAME-UTC, and a second run gets another folder."""
    for _ in range(2):
        assert command("run", quick, "--no-figures")[0] == 0
    folders = sorted(p.name for p in (quick.parent / "runs").iterdir())
    assert len(folders) == 2
    assert all(name.startswith("quick-20") for name in folders)


def test_a_motion_beyond_all_numbers_is_bad_input(quick, command):
    """A frequency whose square overflows is answered before anything is written."""
    status, out, err = command("run", quick, "--set", "reference.frequency_hz=1e200", "--out", "result")
    assert (status, out) == (2, "")
    assert "reference: its acceleration is beyond" in err
    assert not (quick.parent / "result").exists()


SCENARIO = (
    "plant.payload={mass: 2, at: 0.3, offset: [0, 0, 0.1]}",
    "plant.friction={viscous: 1}",
    "plant.perturb.relative=0.1",
    "model.structure=exact",
    "model.constants=fitted",
    "model.mismatch.tolerance=0.3",
    "chain={encoder_noise: 0.0001, quantisation: 0.0002, velocity: differentiated, measurement_delay: 0.002, "
    "actuator_lag: 0.001}",
    "disturbances=[{kind: bias, channel: torque, value: 1}, {kind: sinusoid, channel: torque, amplitude: 2}]",
)


def test_what_was_done_to_plant_and_model_is_told(quick, command):
    """The terminal names every part of a scenario; the manifest holds what was drawn, as Python draws it again."""
    edits = [word for edit in SCENARIO for word in ("--set", edit)]
    status, out, _ = command("run", quick, "--out", "result", "--no-figures", *edits)
    assert status == 0
    for words in (
        "links perturbed up to 10 %",
        "payload 2 kg at 0 0 0.1 m from 0.3 s",
        "friction viscous 1 N m s/rad",
        "constants drawn within 0.3 tolerances",
        "noise 0.1 mrad, encoder step 0.2 mrad, velocity differentiated",
        "measurement delay 2 ms, actuator lag 1 ms",
        "constant torque 1 N m; sinusoidal torque, amplitude 2 N m, 1 Hz",
        "draw 0",
    ):
        assert words in " ".join(out.split()), words
    manifest = check_run(quick.parent / "result")
    assert manifest["scenario"]["payload_step"] == 300
    factors = np.array(list(manifest["scenario"]["plant_factors"].values())).T
    seed = load_experiment(quick).run.seed
    assert np.array_equal(factors, draw_factors(6, 0.1, generator(seed, 0, Stream.PERTURBATION)))
    masses, nominal = manifest["scenario"]["model_links"]["mass"], load_model("puma560").flat.mass
    moved = np.abs(np.array(masses) - nominal) > 1e-9
    assert moved.tolist() == [False, True, True, True, True, True]  # no constant depends on the mass of link 1
    assert manifest["seeds"]["streams"]["perturbation"] == 3
    changed = ["--set", "model.mismatch.constants={g1: 1.3}"]
    command("run", quick, "--out", "other", "--no-figures", *changed)
    constants = check_run(quick.parent / "other")["scenario"]["model_constants"]
    assert constants["g1"] == pytest.approx(1.3 * -37.2)
    command("run", quick, "--out", "plain", "--no-figures")
    assert check_run(quick.parent / "plain")["scenario"] == {}


def test_constants_without_a_model_are_bad_input(quick, command):
    """Exit 2 and nothing written when no mass matrix or no rigid body has what was asked for."""
    status, out, err = command("run", quick, "--set", "model.mismatch.constants={I1: -5}", "--out", "result")
    assert (status, out) == (2, "")
    assert "model.mismatch: with these constants the mass matrix has an eigenvalue of -" in err
    assert not (quick.parent / "result").exists()


def test_friction_too_steep_for_the_time_step_is_bad_input(quick, command):
    """Exit 2 and nothing written; the message names the key and what would help."""
    friction = "plant.friction={coulomb: [26, 14, 6.5, 1, 1.3, 0.7], speed: 0.001}"
    status, out, err = command("run", quick, "--set", friction, "--out", "result")
    assert (status, out) == (2, "")
    assert "plant.friction: friction near standstill" in err
    assert "a shorter time step" in err
    assert not (quick.parent / "result").exists()


def test_bad_configs_are_refused_with_every_mistake_and_nothing_written(quick, command):
    """Exit 2, one line a mistake with file:line:col and the nearest name, no traceback, no folder."""
    quick.write_text(
        quick.read_text().replace("lam: 10, k: 0.3}", "lamb: 10, k: -1}").replace("kind: sine", "kind: sin")
    )
    status, out, err = command("run", quick, "--out", "result")
    *lines, last = err.splitlines()
    assert (status, out) == (2, "")
    assert (len(lines), last) == (3, UNCHECKED)
    assert all(line.startswith(f"{quick}:") for line in lines)
    assert "did you mean 'lam'?" in err
    assert "did you mean 'sine'?" in err
    assert not (quick.parent / "result").exists()
    assert not (quick.parent / "runs").exists()


FAILING_LAW = '''
from typing import Annotated, NamedTuple
from torquebench import Gain, controller

class Gains(NamedTuple):
    at: Annotated[object, Gain("time of the failure", "s")]

@controller("fails-later", gains=Gains)
def fails_later(gains, model, t, q, qd, ref, memory, tau):
    """Zero torque until gains.at, then NaN."""
    for i in range(len(tau)):
        tau[i] = 0.0 if t < gains.at[i] else float("nan")
'''


def with_failing_law(quick, expect=""):
    """Add a law that fails at 0.1 s to the experiment; return the plugin's path."""
    plugin = quick.parent / "my_law.py"
    plugin.write_text(FAILING_LAW)
    line = f"  - {{name: broken, law: fails-later, gains: {{at: 0.1}}{expect}}}\n"
    quick.write_text(quick.read_text().replace("reference:", line + "reference:"))
    return plugin


@pytest.mark.usefixtures("registries")
def test_a_failed_run_has_an_outcome_and_no_metrics(quick, command):
    """Exit 1; the others are complete; the failed one is truncated at its step and has no metrics."""
    plugin = with_failing_law(quick)
    status, out, err = command("run", quick, "--out", "result", "--plugin", plugin)
    assert status == 1
    assert "broken" in err
    assert "bad torque at 0.1 s" in out
    manifest = check_run(quick.parent / "result")
    assert manifest["outcomes"]["broken"]["outcome"] == "BAD_TORQUE"
    assert manifest["outcomes"]["broken"]["failed_at"] == 100
    assert json.loads((quick.parent / "result" / "metrics.json").read_text())["controllers"]["broken"] is None
    assert len(load_trajectory(quick.parent / "result" / "broken" / "trajectory.npz").t) == 101


@pytest.mark.usefixtures("registries")
def test_an_expected_failure_is_no_failure(quick, command):
    """With `expect: failed` the exit status is 0; a law that then completes gives 1."""
    plugin = with_failing_law(quick, ", expect: failed")
    assert command("run", quick, "--out", "a", "--plugin", plugin, "--no-figures")[0] == 0
    text = quick.read_text().replace("at: 0.1", "at: 5.0")
    quick.write_text(text)
    assert command("run", quick, "--out", "b", "--no-figures")[0] == 1


@pytest.mark.usefixtures("registries")
def test_the_manifest_knows_which_code_and_which_arm(quick, command):
    """Plug-ins and model files are in the manifest by name and checksum, so that a result can be reproduced."""
    plugin = with_failing_law(quick, ", expect: failed")
    command("run", quick, "--out", "result", "--no-figures", "--plugin", plugin)
    manifest = check_run(quick.parent / "result")
    assert set(manifest["plugins"]) == {"my_law.py"}
    assert {"puma560.xml", "links.yaml", "constants.yaml"} <= set(manifest["model_files"])
    assert not (quick.parent / "result" / "unfinished").exists()


ALONE = "controllers=[{name: pd, law: pd, gains: {lam: 10, kv: 20}}]"
BRIEF = ("--set", "run.duration=0.5", "--set", "run.metrics_from=0", "--set", ALONE)
"""Of a run that is started in a process of its own: no longer than it must be."""


def test_runs_started_together_do_not_share_a_folder(quick):
    """Two runs at once: without --out each has its own folder; with the same --out one wins and the other says so."""
    start = [sys.executable, "-m", "torquebench", "run", "quick.yaml", "--no-figures", *BRIEF]

    def all_at_once(*more):
        processes = [
            subprocess.Popen([*start, *more], cwd=quick.parent, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
            for _ in range(2)
        ]
        return [(p.communicate(timeout=300)[1].decode(), p.returncode) for p in processes]

    assert [status for _, status in all_at_once()] == [0] * 2
    folders = list((quick.parent / "runs").iterdir())
    assert len(folders) == 2
    for folder in folders:
        check_run(folder)
    outcomes = all_at_once("--out", "same")
    assert sorted(status for _, status in outcomes) == [0, 2]
    assert all("--out" in err for err, status in outcomes if status == 2)
    check_run(quick.parent / "same")


def test_each_run_is_on_disk_before_the_next_begins(quick, command):
    """A law that ends the program still leaves the runs before it, and no manifest."""
    plugin = quick.parent / "kill.py"
    plugin.write_text(FAILING_LAW.replace('float("nan")', "__import__('os')._exit(9)"))
    line = "  - {name: killer, law: fails-later, gains: {at: 0.1}}\n"
    quick.write_text(quick.read_text().replace("reference:", line + "reference:"))
    start = [sys.executable, "-m", "torquebench", "run", "quick.yaml", "--out", "result", "--plugin", str(plugin)]
    assert subprocess.run(start, cwd=quick.parent, check=False, capture_output=True).returncode == 9
    folder = quick.parent / "result"
    assert load_trajectory(folder / "conventional" / "trajectory.npz").completed
    assert (folder / "unfinished").exists()
    assert not (folder / "manifest.json").exists()


@pytest.mark.parametrize(
    ("redirect", "status"),
    [("| head -c 1 > /dev/null; exit ${PIPESTATUS[0]}", 141), (">&-", 0), ("> /dev/full", 3), ("2>&-", 0)],
)
def test_output_that_goes_nowhere(quick, redirect, status):
    """A closed pipe, no standard output at all, a full device: no traceback, and the status says it."""
    line = f"{sys.executable} -m torquebench run quick.yaml --no-figures {shlex.join(BRIEF)} {redirect}"
    done = subprocess.run(["bash", "-c", line], cwd=quick.parent, capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    assert done.returncode == status or (status == 141 and done.returncode == 0)  # all was written before head left


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("raise SystemExit(0)\n", "SystemExit"),
        ("x = 1\n", "registers no law"),
        ("raise RuntimeError('boom')\n", "RuntimeError: boom"),
        ("def f(:\n", "SyntaxError"),
        (None, "no such file"),
    ],
)
def test_a_plugin_that_cannot_be_used_is_bad_input(quick, command, content, message):
    """Exit 2 and one line saying why."""
    plugin = quick.parent / "plugin.py"
    if content is not None:
        plugin.write_text(content)
    status, _, err = command("run", quick, "--plugin", plugin)
    assert status == 2
    assert message in err
    assert len(err.splitlines()) == 1


def test_a_changed_or_missing_file_is_noticed(quick, command):
    """check_run refuses a directory whose files are not those of its manifest, and one without a manifest."""
    command("run", quick, "--out", "result", "--no-figures")
    folder = quick.parent / "result"
    metrics = folder / "metrics.json"
    metrics.write_text(metrics.read_text() + " ")
    with pytest.raises(ResultError, match=r"metrics\.json"):
        check_run(folder)
    (folder / "manifest.json").unlink()
    with pytest.raises(ResultError, match="the run has not finished"):
        check_run(folder)


def test_the_analytic_plant_needs_no_mujoco(quick):
    """`engine: analytic` runs from YAML to manifest in a process where `import mujoco` fails."""
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from torquebench.cli.app import Terminated, main\n"
        "sys.exit(main(['run', 'quick.yaml', '--out', 'analytic', '--no-figures', '--set', 'plant.engine=analytic']))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=quick.parent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    check_run(quick.parent / "analytic")


ENDLESS_LAW = '''
from pathlib import Path
from typing import NamedTuple
from torquebench import controller

class Gains(NamedTuple):
    pass

@controller("endless", gains=Gains)
def endless(gains, model, t, q, qd, ref, memory, tau):
    """Say that the loop has begun, then never finish."""
    Path("begun").touch()
    while True:
        pass
'''


def test_a_thread_that_a_law_started_and_that_never_ends_does_not_keep_the_process(quick):
    """The command ends with its own status some seconds after its work, and names the thread."""
    law = quick.parent / "starts_thread.py"
    law.write_text(
        ENDLESS_LAW + "\nimport threading, time\n"
        "threading.Thread(target=lambda: [time.sleep(0.1) for _ in iter(int, 1)], name='busy').start()\n"
    )
    line = [sys.executable, "-m", "torquebench", "run", "quick.yaml", "--plugin", str(law), "--show-config"]
    done = subprocess.run(line, capture_output=True, text=True, timeout=60, cwd=quick.parent)
    assert done.returncode == 0, done.stderr
    assert done.stderr.endswith("the process is ended although threads still run: 'busy'\n")


@pytest.mark.parametrize(
    ("number", "status", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_interrupting_leaves_no_manifest(quick, number, status, word):
    """Ctrl-C and SIGTERM end with their status, one line and no manifest, so that it cannot pass for a finished run."""
    (quick.parent / "endless.py").write_text(ENDLESS_LAW)
    alone = "controllers=[{name: endless, law: endless, gains: {}}]"
    arguments = ["run", "quick.yaml", "--out", "result", "--plugin", "endless.py", "--set", alone]
    process = subprocess.Popen(
        [sys.executable, "-m", "torquebench", *arguments], cwd=quick.parent, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 120
    while not (quick.parent / "begun").exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == status, err
    assert f"torquebench: {word}; result is unfinished\n" in err
    assert "Traceback" not in err
    assert not (quick.parent / "result" / "manifest.json").exists()


def test_an_interrupted_command_names_a_folder_only_where_it_began_one(tmp_path, capsys):
    """Nothing is said of folders by a command that has begun none, whatever an earlier one left."""

    def stop(begin=False):
        if begin:
            claim_folder(tmp_path / "begun", "any")
        raise KeyboardInterrupt

    for begin, told in ((True, f"; {tmp_path / 'begun'} is unfinished"), (False, "")):
        assert guarded(lambda begin=begin: stop(begin), Ending()) == 130
        assert capsys.readouterr().err == f"torquebench: interrupted{told}\n"


EARLY = """
import runpy, sys

class Interrupted:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupted())
sys.argv = ["torquebench", "doctor"]
runpy.run_module("torquebench", run_name="__main__")
"""


@pytest.mark.parametrize("name", ["torquebench.cli.app", "click", "torquebench.cli.doctor"])
def test_interrupting_while_it_starts(name):
    """Ctrl-C while modules are still being read: status 130 and one line, no traceback."""
    done = subprocess.run([sys.executable, "-c", EARLY.format(name=name)], capture_output=True, text=True, check=False)
    assert done.returncode == 130
    assert len(done.stderr.splitlines()) == 1
    assert "interrupted" in done.stderr


WRAPPED = {
    "as Python 3.11 does": "try:\n    raise Kind\nexcept BaseException as error:\n    raise RuntimeError from error",
    "while another is handled": "try:\n    raise Kind\nexcept BaseException:\n    raise ConfigError([])",
    "twice": "try:\n    try:\n        raise Kind\n    except BaseException as error:\n"
    "        raise OSError from error\nexcept OSError as error:\n    raise ValueError from error",
}


@pytest.mark.parametrize("code", WRAPPED.values(), ids=WRAPPED)
@pytest.mark.parametrize(("kind", "status"), [(KeyboardInterrupt, 130), (Terminated, 143)])
def test_an_interrupt_that_something_wrapped(code, kind, status, monkeypatch, command):
    """Ctrl-C and SIGTERM are told from an internal error and from bad input whatever was made of them on the way."""

    def fail(_wish):
        exec(code, {"Kind": kind, "ConfigError": ConfigError})

    monkeypatch.setattr("torquebench.cli.doctor.findings", fail)
    found, _, err = command("doctor")
    assert found == status
    assert len(err.splitlines()) == 1
    assert "internal error" not in err


def test_a_loop_of_causes_ends(monkeypatch, command):
    """An error that is its own cause is an internal error."""

    def fail(_wish):
        error, other = RuntimeError("one"), RuntimeError("other")
        error.__cause__, other.__cause__ = other, error
        raise error

    monkeypatch.setattr("torquebench.cli.doctor.findings", fail)
    status, _, err = command("doctor")
    assert (status, err.startswith("torquebench: internal error: RuntimeError: one")) == (3, True)
    assert "Traceback" in command("doctor", "--verbose")[2]


def test_sigterm_is_left_as_it_was(quick, command):
    """After a command, and in a thread, which cannot have signals, the handler is the caller's."""
    before = signal.getsignal(signal.SIGTERM)
    assert command("compare", "mujco:x", "y")[0] == 2
    assert signal.getsignal(signal.SIGTERM) is before
    thread = threading.Thread(target=main, args=(["compare", "mujco:x", "y"],))
    thread.start()
    thread.join()
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_disk_that_refuses_is_status_3(quick, command, monkeypatch):
    """An error of the file system is reported in one line, status 3, and no manifest is left."""

    def refuse(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", refuse)
    status, _, err = command("run", quick, "--out", "result", "--no-figures")
    assert status == 3
    assert "No space left" in err
    assert not list((quick.parent / "result").rglob("*.tmp"))
    assert not (quick.parent / "result" / "manifest.json").exists()


SHIPPED = sorted((data_root() / "configs").rglob("*.yaml"))
SWEEPS = [path for path in SHIPPED if "\nsweep:" in path.read_text(encoding="utf-8")]
AUDITS = [path for path in SHIPPED if "\naudit:" in path.read_text(encoding="utf-8")]
SEARCHES = [
    path for path in SHIPPED if re.search(r"^(falsify|tune|arena):", path.read_text(encoding="utf-8"), re.MULTILINE)
]
CONFIGS = [path for path in SHIPPED if path not in (*SWEEPS, *AUDITS, *SEARCHES)]


@pytest.mark.parametrize("path", CONFIGS, ids=lambda p: p.stem)
def test_every_config_that_ships_runs(path, tmp_path, command):
    """Each config loads as it is, and 1.2 s of it complete (its metrics' window moved to fit).

    What shakes on purpose is told to be unstable, or faster than the arm; no reference is too fast.
    """
    load_experiment(path)
    short = ("--set", "run.duration=1.2", "--set", "run.metrics_from=0.2")
    status, _, err = command("run", path, "--out", tmp_path / "out", "--no-figures", *short)
    meant = re.compile(
        r"cannot meet its reaching condition|is unstable at its control period|joints that give: certificates"
        r"|^torquebench: controller .* exceeds its speed limit"
        r"|^torquebench: controller '(m-no-linear|policy|stiff|conventional-strong)' "  # fail on purpose, and say why
    )
    remarks = [line for line in err.splitlines() if not meant.search(line)]
    assert (status, remarks) == (0, [])


LONG = ("regime", "robustness")
"""Sweeps whose cases, or the few loops that are timed, take long; that they are valid is tried with -m slow."""


@pytest.mark.parametrize(
    "path", [pytest.param(path, id=path.stem, marks=[pytest.mark.slow] * (path.stem in LONG)) for path in SWEEPS]
)
def test_every_sweep_that_ships_is_one(path, command):
    """Each case of each sweep's file is an experiment; nothing is run but the few loops that are timed."""
    status, out, err = command("sweep", path, "--dry-run", "--set", "run.duration=2.5")
    assert (status, err) == (0, "")
    assert "runs, " in out


def test_output_that_nobody_reads(quick):
    """The status is that of a program that SIGPIPE ends, and the run is complete."""
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb") as output:
        arguments = [sys.executable, "-m", "torquebench", "run", str(quick), "--out", "unread", *BRIEF]
        done = subprocess.run(arguments, stdout=output, stderr=subprocess.PIPE, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (141, "")
    check_run(quick.parent / "unread")


def test_a_folder_that_cannot_be_made_for_its_name(quick, command):
    """A name of 300 letters is bad input, told as that of --out."""
    status, _, err = command("run", quick, "--out", "n" * 300)
    assert status == 2
    assert err.startswith("--out: cannot make ")
    assert "File name too long" in err


def test_a_full_disk_is_told_with_the_file(quick, command, monkeypatch):
    """What could not be written is named."""

    def full(_file):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    status, _, err = command("run", quick, "--out", "r")
    assert status == 3
    assert "No space left on device: 'r/experiment.yaml'" in err


def test_the_config_that_is_shown_is_the_one_that_would_be_stored(quick, command):
    """It is experiment.yaml to the byte, runs again to the same numbers, and nothing is run or written to show it."""
    quick.with_name("short.yaml").write_text(f"extends: {quick.name}\ncontrollers: [linear-band]\n")
    before = sorted(quick.parent.iterdir())
    status, shown, err = command("run", "short.yaml", "--show-config", "--set", "run.seed=3")
    assert (status, err) == (0, "")
    assert sorted(quick.parent.iterdir()) == before
    assert json.loads(command("run", "short.yaml", "--show-config", "--json")[1])["experiment"]["name"] == "short"
    assert command("run", "short.yaml", "--set", "run.seed=3", "--out", "one")[0] == 0
    assert (quick.parent / "one" / "experiment.yaml").read_text() == shown
    quick.with_name("shown.yaml").write_text(shown)
    assert command("run", "shown.yaml", "--out", "two")[0] == 0
    assert check_run(quick.parent / "one")["files"] == check_run(quick.parent / "two")["files"]

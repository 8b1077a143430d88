"""``torquebench sweep`` and ``run --from-sweep``: what is told, stored, refused and continued, and how it ends."""

from __future__ import annotations

import csv
import errno
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.sweep.examples import BASE, SMALL, user_law
from torquebench import load_trajectory
from torquebench.cli.app import main
from torquebench.experiment.store import check_run
from torquebench.metrics import applicable
from torquebench.registry import restored
from torquebench.sweep.folder import decisive_versions, open_sweep
from torquebench.sweep.plan import Plan, Source
from torquebench.sweep.run import state_of
from torquebench.sweeps import load_sweep

THREADS = ("--executor", "threads", "--workers", "2")


@pytest.fixture
def small(tmp_path, monkeypatch):
    """Path of the small sweep, in a folder that is also the current one."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "small.yaml"
    path.write_text(SMALL)
    return path


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    """The small sweep's folder, run once; not to be changed."""
    folder = tmp_path_factory.mktemp("once")
    (folder / "small.yaml").write_text(SMALL)
    here = Path.cwd()
    os.chdir(folder)
    try:
        assert main(["sweep", "small.yaml", "--out", "s", *THREADS]) == 0
    finally:
        os.chdir(here)
    return folder / "s"


@pytest.fixture
def swept(small, once):
    """Path of the small sweep, with its results beside it in the folder s."""
    shutil.copytree(once, "s")
    return small


def table_of(folder):
    """The final table, opened as the documentation says."""
    return dict(np.load(Path(folder) / "results.npz"))


def files_of(folder):
    """Content of both final tables."""
    return [(Path(folder) / name).read_bytes() for name in ("results.npz", "results.csv")]


def test_a_sweep_tells_its_work_runs_and_stores_its_table(small, command):
    """Runs, steps, time, memory and disk first; then a manifest whose checksums hold, and one row for each loop."""
    status, out, err = command("sweep", small, "--out", "s", *THREADS)
    assert (status, err) == (0, "")
    assert out.splitlines()[0] == "small: 6 cases x 6 draws x 2 controllers"
    assert "72 runs, 43,200 steps: about " in out
    assert "of memory, " in out
    assert " on disk" in out
    manifest = check_run(small.parent / "s")
    files = {"sweep.yaml", "plan.json", "results.npz", "results.csv", "summary.json", "sensitivity.json", "report.html"}
    assert set(manifest["files"]) == files
    assert manifest["outcomes"] == {"band": {"COMPLETED": 36}, "sign": {"COMPLETED": 36}}
    table = table_of("s")
    keys = ["plant.payload.mass", "controllers.*.gains.phi", "controllers.*.gains.lam"]
    metrics = [info.key for info in applicable(tool=False)]
    assert list(table) == ["index", "case", "draw", "controller", "outcome", "failed_at", *keys, *metrics]
    assert table["index"].tolist() == list(range(72))
    assert table["controller"].tolist() == ["band", "sign"] * 36
    assert np.all(np.isfinite(table["rmse"]))
    assert np.all(np.isnan(table["rise_time"]))  # a sine has none
    for word in ("Least error: ", "None of 72 runs failed.", "band", "sign", "RMSE [mrad]", "results: s"):
        assert word in out


def test_the_csv_file_has_the_same_numbers(swept, command):
    """Every number of results.csv reads back as the one in results.npz, to the last bit."""
    table = table_of("s")
    with open("s/results.csv", encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == list(table)
    for i, name in enumerate(header):
        if table[name].dtype.kind == "f":
            read = np.array([float(row[i]) for row in rows])
            assert read.tobytes() == np.where(np.isnan(table[name]), math.nan, table[name]).tobytes()
        else:
            assert [row[i] for row in rows] == [str(x) for x in table[name].tolist()]


def test_a_row_run_alone_has_the_metrics_of_the_table(swept, command):
    """Run --from-sweep: the row's experiment, trajectory and metrics, equal in every bit; its file repeats it too."""
    table = table_of("s")
    for index in (5, 70):
        status, _, _ = command("run", "--from-sweep", "s", "--index", index, "--out", f"r{index}", "--no-figures")
        assert status == 0
        (name,) = json.loads(Path(f"r{index}/metrics.json").read_text())["controllers"]
        found = json.loads(Path(f"r{index}/metrics.json").read_text())["controllers"][name]
        assert name == table["controller"][index]
        for info in applicable(tool=False):
            value = found[info.key]["value"]
            assert np.float64(math.nan if value is None else value).tobytes() == table[info.key][index].tobytes()
        again = command("run", f"r{index}/experiment.yaml", "--out", f"again{index}", "--no-figures")
        assert again[0] == 0
        runs = [load_trajectory(f"{folder}{index}/{name}/trajectory.npz") for folder in ("r", "again")]
        assert runs[0].digest() == runs[1].digest()


def test_tables_are_equal_in_every_byte_whoever_makes_them(small, once, command):
    """One thread, two, four, and two processes."""
    for name, how in (("a", ("threads", 1)), ("b", ("threads", 4)), ("c", ("processes", 2))):
        assert command("sweep", small, "--out", name, "--executor", how[0], "--workers", how[1])[0] == 0
        assert files_of(name) == files_of(once)


@pytest.mark.parametrize("count", [1, 9, 19, 20, 21])
def test_a_full_disk_is_reported_and_the_rest_can_be_run(small, once, command, monkeypatch, count):
    """Whichever write fails, exit 3 and how to go on; then the tables are those of an undisturbed sweep."""
    real, calls = os.fsync, []

    def full(file):
        calls.append(file)
        if len(calls) == 2 * count + 3:  # each file and its folder; the first are the claim's and the plan's
            raise OSError(errno.ENOSPC, "No space left on device")
        real(file)

    monkeypatch.setattr(os, "fsync", full)
    status, _, err = command("sweep", small, "--out", "s", *THREADS)
    monkeypatch.undo()
    monkeypatch.chdir(small.parent)
    assert status == 3
    assert "No space left on device" in err
    assert "torquebench sweep --resume s" in err
    assert not Path("s/manifest.json").exists()
    assert command("sweep", "--resume", "s", *THREADS)[0] == 0
    assert files_of("s") == files_of(once)


def damage(folder):
    """Alter a bit of a shard, cut off another, and remove a third; remove the final table."""
    shards = sorted(Path(folder, "shards").iterdir())
    content = bytearray(shards[2].read_bytes())
    content[len(content) // 2] ^= 1
    shards[2].write_bytes(content)
    shards[5].write_bytes(shards[5].read_bytes()[:1000])
    shards[7].unlink()
    for name in ("manifest.json", "results.npz", "results.csv"):
        Path(folder, name).unlink()


def test_damaged_shards_are_run_again(swept, command):
    """They are counted, and only they and the missing one are run."""
    before = files_of("s")
    damage("s")
    status, out, _ = command("sweep", "--resume", "s", *THREADS)
    assert status == 0
    assert "15 of 18 shards are there, 2 damaged; 3 to run" in out
    assert "3 shards run, 15 were there" in out
    assert files_of("s") == before


def test_a_finished_sweep_is_not_run_again(swept, command):
    """Its files are verified; one that was altered is an error, and of a shard that was it is told."""
    status, out, _ = command("sweep", swept, "--resume", "s", *THREADS)
    assert status == 0
    assert "finished already: 18 of 18 shards are there" in out
    (first, second, *_) = sorted((swept.parent / "s" / "shards").iterdir())
    whole = first.read_bytes(), second.read_bytes()
    first.write_bytes(whole[0][:-1] + bytes([whole[0][-1] ^ 1]))
    second.unlink()
    status, out, err = command("sweep", "--resume", "s", *THREADS)
    assert (status, "finished already: 16 of 18 shards" in out) == (0, True)
    assert "1 of 18 shards are damaged, 1 missing" in err
    first.write_bytes(whole[0])
    second.write_bytes(whole[1])
    with open("s/results.csv", "a", encoding="utf-8") as file:
        file.write("\n")
    status, _, err = command("sweep", "--resume", "s", *THREADS)
    assert status == 3
    assert "results.csv: missing or changed" in err


CHANGES = [
    ("{uniform: [8, 12]}", "{uniform: [8, 13]}", "sweep.random.'controllers.*.gains.lam'.uniform: was [8, 12] when"),
    ("draws: 6", "draws: 7", "sweep.draws: was 6 when the sweep began, is 7 now"),
    ("phi: 0.3, kv: 20", "phi: 0.3, kv: 30", "controllers.band.gains.kv: was 20 when the sweep began, is 30 now"),
    (
        "chain: {encoder_noise: 0.0001}\n",
        "",
        "chain.encoder_noise: was 0.0001 when the sweep began, is (not given) now",
    ),
    ("seed: 3", "seed: 3, initial_q: 0.1", "run.initial_q: was (not given) when the sweep began, is 0.1 now"),
]


@pytest.mark.parametrize(("old", "new", "message"), CHANGES)
def test_a_changed_file_is_refused(swept, command, old, new, message):
    """Exit 2 and each changed key with its old and new value; what is stored stays as it is."""
    before = files_of("s")
    damage("s")
    swept.write_text(SMALL.replace(old, new))
    status, out, err = command("sweep", swept, "--resume", "s", *THREADS)
    assert (status, out) == (2, "")
    assert err.startswith(f"--resume: {message}")
    assert len(err.splitlines()) == 1
    swept.write_text("# other words, the same meaning\n" + SMALL)
    assert command("sweep", swept, "--resume", "s", *THREADS)[0] == 0
    assert files_of("s") == before


def test_numbers_of_other_software_may_be_read(swept, command, monkeypatch):
    """What is stored can be looked at with other versions, since reading computes nothing; going on is refused."""
    other = decisive_versions() | {"mujoco": "99.0"}
    monkeypatch.setattr("torquebench.sweep.folder.decisive_versions", lambda: other)
    assert len(load_sweep("s").to_dataframe()) == json.loads(Path("s/plan.json").read_text())["rows"]
    status, _, err = command("sweep", "--resume", "s", *THREADS)
    assert status == 2
    assert 'software.mujoco: was "' in err
    assert 'when the sweep began, is "99.0" now' in err


def test_draws_that_are_all_the_same_are_said(swept, command):
    """Without noise, mismatch, perturbation and random keys each draw is one and the same run."""
    text = "name: calm\nplant: {engine: analytic, model: two-link}\n"
    text += "reference: {kind: sine, amplitude: 1, frequency_hz: 1}\n"
    text += "controllers: [{name: pd, law: pd, gains: {lam: 10, kv: 20}}]\nrun: {duration: 0.6, metrics_from: 0.1}\n"
    Path("calm.yaml").write_text(text + "sweep: {draws: 4}\n")
    status, _, err = command("sweep", "calm.yaml", "--dry-run", *THREADS)
    assert status == 0
    assert "nothing is random: all 4 draws are the same run" in err
    noisy = text + "chain: fast\nsweep: {draws: 4}\n"
    Path("noisy.yaml").write_text(noisy)
    assert "nothing is random" not in command("sweep", "noisy.yaml", "--dry-run", *THREADS)[2]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("sweep",), "CONFIG: missing"),
        (("sweep", "small.yaml", "--workers", "0"), "--workers: got 0"),
        (("sweep", "--resume", "nowhere"), "--resume: nowhere: there is no such folder"),
        (("sweep", "--resume", "s", "--out", "t"), "--out: has no effect"),
        (("sweep", "--resume", "s", "--set", "sweep.draws=3"), "--set: has no effect"),
        (
            ("sweep", "small.yaml", "--set", "sweep.draws=0"),
            "--set sweep.draws=0: sweep.draws: got 0, wanted at least 1",
        ),
        (("sweep", "base.yaml"), "base.yaml:1:1: sweep: missing"),
        (("run", "small.yaml"), "small.yaml:12:1: sweep: is for many runs, wanted torquebench sweep FILE"),
        (("run",), "CONFIG: missing"),
        (("run", "small.yaml", "--index", "3"), "--index: has no effect without --from-sweep"),
        (("run", "--from-sweep", "s"), "--index: missing"),
        (("run", "--from-sweep", "s", "--index", "72"), "--index: got 72, wanted 0 to 71"),
        (("run", "--from-sweep", "s", "--index", "-1"), "--index: got -1, wanted 0 or more"),
        (
            ("run", "--from-sweep", "s", "--index", "1", "--set", "run.duration=2"),
            "--set: has no effect with --from-sweep",
        ),
        (("run", "base.yaml", "--from-sweep", "s", "--index", "1"), "CONFIG: has no effect with --from-sweep"),
    ],
)
def test_what_makes_no_sense_is_refused(swept, command, arguments, words):
    """Exit 2, one line that says what was wanted, and nothing written."""
    Path("base.yaml").write_text(BASE)
    before = sorted(Path().rglob("*"))
    status, _, err = command(*arguments)
    assert status == 2
    assert err.startswith(words), err
    assert len(err.splitlines()) == 1
    assert sorted(Path().rglob("*")) == before


def test_absurd_work_is_refused_unless_asked_for(small, command, monkeypatch):
    """A cap on steps: exit 2 with the reason and the flag, nothing written; with the flag it is run."""
    from torquebench.sweep import estimate

    monkeypatch.setattr(estimate, "MOST_STEPS", 20_000)
    status, out, err = command("sweep", small, "--out", "s", *THREADS)
    assert status == 2
    assert "43,200 steps" in out
    assert err == "sweep: needs 4.32e+04 steps, at most 2e+04 are run: --no-cap lifts the caps\n"
    assert not Path("s").exists()
    assert command("sweep", small, "--out", "s", "--no-cap", *THREADS)[0] == 0
    monkeypatch.setattr(estimate, "MOST_STEPS", 1000)
    assert command("sweep", small, *THREADS)[:2] == (2, "")


@pytest.mark.parametrize("quantity", ["MOST_HOURS", "MEMORY_SHARE", "DISK_SHARE"])
def test_every_cap_acts(small, command, monkeypatch, quantity):
    """Time, memory and disk have caps of their own."""
    from torquebench.sweep import estimate

    monkeypatch.setattr(estimate, quantity, 0.0)
    status, _, err = command("sweep", small, "--out", "s", *THREADS)
    assert status == 2
    assert len(err.splitlines()) == 1
    words = {"MOST_HOURS": "h are spent", "MEMORY_SHARE": "of memory", "DISK_SHARE": "are free"}
    assert words[quantity] in err


def test_a_dry_run_writes_nothing(small, command):
    """It checks and estimates only."""
    status, out, _ = command("sweep", small, "--dry-run")
    assert status == 0
    assert "72 runs" in out
    estimate = json.loads(command("sweep", small, "--dry-run", "--json")[1])["estimate"]
    assert (estimate["runs"], estimate["steps"]) == (72, 43_200)
    assert estimate["seconds"] > estimate["so_far"] + estimate["running"] > 0.0
    assert sorted(Path().iterdir()) == [Path("small.yaml")]


def test_rows_that_never_ran_are_no_worst_runs(small, command):
    """Of models drawn so far off that some are no arm, the trajectories kept are of runs that there were."""
    random = "sweep.random={model.mismatch.constants.I5: {uniform: [1, 40]}}"
    wild = ("--set", "model.mismatch={constants: {I5: 1}}", "--set", random, "--set", "sweep.keep={worst: 2}")
    assert command("sweep", small, "--out", "s", *wild, *THREADS)[0] == 1
    refused = table_of("s")["outcome"] == "REFUSED"
    worst = json.loads(Path("s/manifest.json").read_text())["worst"]
    assert refused.any()
    assert len(worst) == 4
    assert not refused[worst].any()
    assert len(list(Path("s/trajectories").iterdir())) == 4


def test_a_sweep_whose_runs_all_fail_ends_with_outcomes(small, command):
    """Exit 1, every outcome in the table, no metric; with expect: failed it is 0."""
    pushed = "disturbances=[{kind: bias, channel: torque, value: 1e9}]"
    shaken = ("--set", pushed, "--set", "sweep.draws=2")
    expected = ("--set", "controllers.band.expect=failed", "--set", "controllers.sign.expect=failed")
    status, out, err = command("sweep", small, "--out", "s", *shaken, *THREADS)
    table = table_of("s")
    assert set(table["outcome"]) == {"DIVERGED"}
    assert status == 1
    assert "controller 'band': 12 diverged; the file expects: completed" in err
    assert all(np.all(np.isnan(table[info.key])) for info in applicable(tool=False))
    assert np.all(table["failed_at"] == 0)  # the push acts from the first instant
    assert "24 of 24 runs failed: band 12, sign 12." in out
    assert command("sweep", small, "--out", "t", *shaken, *expected, *THREADS)[0] == 0


def test_the_worst_trajectories_are_kept(small, command):
    """keep: {worst: 2, by: hf}: the two rows of each controller with the largest HF, each the trajectory of its row."""
    command("sweep", small, "--out", "s", "--set", "sweep.keep={worst: 2, by: hf}", *THREADS)
    table, manifest = table_of("s"), check_run(small.parent / "s")
    for i, name in enumerate(("band", "sign")):
        own = np.flatnonzero(table["controller"] == name)
        assert manifest["worst"][2 * i : 2 * i + 2] == own[np.argsort(-table["hf"][own])[:2]].tolist()
    names = {p.name for p in Path("s/trajectories").iterdir()}
    assert names == {f"{index}-{table['controller'][index]}.npz" for index in manifest["worst"]}
    index = manifest["worst"][0]
    command("run", "--from-sweep", "s", "--index", index, "--out", "r", "--no-figures")
    kept = load_trajectory(f"s/trajectories/{index}-band.npz")
    assert kept.digest() == load_trajectory("r/band/trajectory.npz").digest()


def test_every_trajectory_is_kept_when_asked_for(small, command):
    """keep: all: as many files as rows."""
    command("sweep", small, "--out", "s", "--set", "sweep.keep=all", *THREADS)
    assert len(list(Path("s/trajectories").iterdir())) == 72
    assert len(check_run(small.parent / "s")["files"]) == 79


PLUGIN = user_law("swept-law")


def test_laws_of_the_user_are_swept_and_must_be_there_again(small, command):
    """In processes too; a plug-in that is missing, or that has changed, is refused when the sweep goes on."""
    Path("law.py").write_text(PLUGIN)
    own = (
        "--set",
        "controllers=[{name: own, law: swept-law, gains: {k: 1}}]",
        "--set",
        "sweep.grid={}",
        "--set",
        "sweep.random={controllers.*.gains.k: {uniform: [1, 2]}}",
    )
    for name, how in (("s", THREADS), ("t", ("--workers", 1))):
        with restored():
            status = command("sweep", small, "--out", name, "--plugin", "law.py", *own, *how)[0]
            assert status == 0
    assert files_of("s") == files_of("t")
    Path("s/manifest.json").unlink()
    status, _, err = command("sweep", "--resume", "s")
    assert status == 2
    assert "law.py: wanted --plugin with each of these files" in err
    Path("law.py").write_text(PLUGIN.replace("10.0", "12.0"))
    with restored():
        status, _, err = command("sweep", "--resume", "s", "--plugin", "law.py")
    assert status == 2
    assert "plugins.'law.py': was" in err


def alive(group):
    """Whether a group of processes still has one."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize(
    ("number", "status", "word"),
    [
        (signal.SIGINT, 130, "interrupted"),
        pytest.param(signal.SIGTERM, 143, "terminated", marks=pytest.mark.slow),
    ],
)
def test_an_interrupted_sweep_says_how_to_go_on(small, number, status, word):
    """Ctrl-C and SIGTERM: their status, one line with the command that goes on, finished shards whole, no manifest.

    No process is left. The document says why the command ended.
    """
    long = SMALL.replace("duration: 0.6", "duration: 6")
    small.write_text(long)
    alone = ("--workers", "1", "--json")
    command = [sys.executable, "-m", "torquebench", "sweep", "small.yaml", "--out", "s", *alone]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
    while not list(Path("s/shards").glob("*.shard")) and run.poll() is None:
        time.sleep(0.01)
    os.killpg(run.pid, number)
    out, err = run.communicate(timeout=60)
    assert run.returncode == json.loads(out)["status"] == status, err
    assert err == f"torquebench: {word}; what is stored is kept, go on with: torquebench sweep --resume s\n"
    assert json.loads(out)["error"] == word
    while alive(run.pid):  # the last helper of multiprocessing ends when it notices that it is alone
        time.sleep(0.01)
    assert not Path("s/manifest.json").exists()
    state = state_of(open_sweep(Path("s"), (), "--resume"))
    assert len(state.complete) >= 1
    assert state.damaged == frozenset()


def test_the_processes_of_a_killed_sweep_end_too(small):
    """SIGKILL of the command alone, which can clean nothing up, while its workers are in the middle of long shards."""
    small.write_text(SMALL.replace("duration: 0.6", "duration: 25"))
    command = [sys.executable, "-m", "torquebench", "sweep", "small.yaml", "--out", "s", "--workers", "2", "--no-cap"]
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    workers = Path(f"/proc/{run.pid}/task/{run.pid}/children")
    while len(workers.read_text().split()) < 3:  # two, and the helper of multiprocessing
        assert run.poll() is None
        time.sleep(0.01)
    time.sleep(1.0)
    run.kill()
    run.wait()
    end = time.monotonic() + 180.0  # those that compile end when they have compiled
    while alive(run.pid):
        assert time.monotonic() < end
        time.sleep(0.01)


def test_what_the_table_says_is_written_and_made_again_in_the_same_bytes(small, command):
    """Summary, what matters and page are in the manifest; `report` makes them again from the table alone."""
    assert command("sweep", small, "--out", "s", *THREADS)[0] == 0
    told = ["summary.json", "sensitivity.json", "report.html"]
    files = json.loads(Path("s/manifest.json").read_text())["files"]
    assert set(told) <= set(files)
    summary = json.loads(Path("s/summary.json").read_text())
    table = dict(np.load("s/results.npz"))
    for law in summary["overall"]:
        own = table["rmse"][table["controller"] == law["controller"]]
        assert law["figures"]["rmse"]["median"] == pytest.approx(float(np.median(own)), rel=1e-12)
    assert not re.search(r"(src|href)=.https?:", Path("s/report.html").read_text())
    before = {name: Path("s", name).read_bytes() for name in [*told, "manifest.json"]}
    Path("s/report.html").write_bytes(b"spoilt")
    assert command("report", "s")[0] == 2
    Path("s/report.html").write_bytes(before["report.html"])
    assert command("report", "s")[0] == 0
    after = {name: Path("s", name).read_bytes() for name in told}
    assert after == {name: before[name] for name in told}
    Path("s/manifest.json").unlink()
    status, _, err = command("report", "s")
    assert status == 2
    assert "--resume s goes on with it" in err


def test_far_too_many_draws_are_refused_at_once(small, command):
    """Before each of them is looked at: ten million draws of a choice and of a normal key would take minutes."""
    random = "sweep.random={run.initial_q: {choice: [0.1, 0.2]}, run.seed: {choice: [1, 2, 3]}}"
    status, _, err = command("sweep", small, "--set", "sweep.draws=10000000", "--set", random, "--out", "s")
    assert status == 2
    assert err.startswith("sweep: needs about ")
    assert not Path("s").exists()


def test_the_config_that_is_shown_is_the_sweep(small, command):
    """With what is set, and the section sweep: the rows of the shown text are those of the file."""
    status, shown, err = command("sweep", small, "--show-config", "--set", "sweep.draws=2")
    assert (status, err) == (0, "")
    plans = [Plan(Source(small.read_bytes(), "a.yaml", ("sweep.draws=2",))), Plan(Source(shown.encode(), "a.yaml"))]
    assert plans[0].rows == plans[1].rows
    assert plans[0].experiment(0, 1) == plans[1].experiment(0, 1)

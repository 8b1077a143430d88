"""``torquebench video``, the key ``video`` and ``torquebench doctor``: what they make, refuse and say."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from torquebench.experiment.store import check_run, write_manifest
from torquebench.registry import restored
from torquebench.video.job import FPS


@pytest.fixture
def run(finished, tmp_path, monkeypatch):
    """A copy of the finished run in the current folder; films are stick figures, which every machine can make."""
    monkeypatch.setenv("MUJOCO_GL", "off")
    monkeypatch.chdir(tmp_path)
    return shutil.copytree(finished, tmp_path / "run")


@pytest.fixture
def no_encoder(tmp_path, monkeypatch):
    """An encoder that fails."""
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\necho out of order >&2\nexit 9\n")
    program.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(program))


def test_a_run_makes_the_film_that_its_config_asks_for(quick, command, monkeypatch):
    """video: {...} gives video.mp4, its facts in the manifest, its line on the terminal and the film on the page."""
    monkeypatch.setenv("MUJOCO_GL", "off")
    quick.write_text(quick.read_text() + "video: {size: [320, 240], speed: 0.5, camera: side}\n")
    status, out, err = command("run", quick, "--out", "run")
    assert (status, err) == (0, "")
    folder = quick.parent / "run"
    manifest = check_run(folder)
    facts = manifest["video"]
    assert facts["file"] in manifest["files"]
    assert (
        facts
        | {
            "backend": "stick",
            "size": [320, 240],
            "speed": 0.5,
            "camera": "side",
            "quality": "fast",
            "frames": 40,
            "seconds": 40 / FPS,
            "controllers": ["conventional", "linear-band"],
        }
        == facts
    )
    assert "MUJOCO_GL=off" in facts["reason"]
    assert f"film: {os.path.join('run', 'video.mp4')} (40 frames, 1.6 s; drawn by stick: MUJOCO_GL=off" in out
    assert "data:video/mp4;base64," in (folder / "report.html").read_text()
    page = (folder / "report.html").read_bytes()
    assert command("report", "run")[0] == 0
    assert (folder / "report.html").read_bytes() == page
    film = (folder / "video.mp4").read_bytes()
    assert command("video", "run", "--size", "320x240", "--speed", "0.5", "--camera", "side")[0] == 0
    assert (folder / "video.mp4").read_bytes() == film


def test_a_config_asks_for_sound(quick, command, monkeypatch):
    """video: {sound: true, ears: [...]} tells what is heard where and how loud it is; the film has a sound."""
    monkeypatch.setenv("MUJOCO_GL", "off")
    ears = "sound: true, ears: [linear-band, conventional], exaggerate: 50"
    quick.write_text(quick.read_text() + f"video: {{size: [320, 240], {ears}}}\n")
    status, out, err = command("run", quick, "--out", "run")
    assert (status, err) == (0, "")
    facts = check_run(quick.parent / "run")["video"]
    assert (facts["sound"]["left"], facts["sound"]["right"], facts["exaggerate"]) == ("linear-band", "conventional", 50)
    left, right = facts["sound"]["rms_over_limit"]
    assert left < right
    assert f"sound: left linear-band {100 * left:.3g} %, right conventional {100 * right:.3g} % of the torque" in out
    assert b"mp4a" in (quick.parent / "run" / "video.mp4").read_bytes()


def test_no_figures_means_no_film(quick, command):
    """--no-figures writes numbers only."""
    quick.write_text(quick.read_text() + "video: {}\n")
    assert command("run", quick, "--out", "run", "--no-figures")[0] == 0
    assert "video" not in check_run(quick.parent / "run")


def test_a_film_that_fails_does_not_fail_the_run(quick, command, monkeypatch, no_encoder):
    """Exit status 0, the run complete and checked, the failure told and in the manifest; no film, no half of one."""
    monkeypatch.setenv("MUJOCO_GL", "off")
    quick.write_text(quick.read_text() + "video: {}\n")
    status, _, err = command("run", quick, "--out", "run")
    assert status == 0
    assert "the run is complete, its film failed" in err
    assert "out of order" in err
    manifest = check_run(quick.parent / "run")
    assert manifest["video"]["backend"] is None
    assert "out of order" in manifest["video"]["failed"]
    assert not (quick.parent / "run" / "video.mp4").exists()
    assert "report.html" in manifest["files"]
    assert [p.name for p in (quick.parent / "run").iterdir() if p.name.startswith(".")] == []


PLUGIN = '''
from typing import Annotated, NamedTuple
from torquebench import Array, Gain, controller

class Gains(NamedTuple):
    k: Annotated[Array, Gain("torque", "N m")]

@controller("limp", gains=Gains)
def limp(gains, model, t, q, qd, ref, memory, tau):
    """Next to nothing."""
    for i in range(len(tau)):
        tau[i] = gains.k[i]
'''


def test_the_film_of_a_law_of_ones_own_needs_no_plug_in(quick, command, monkeypatch):
    """A run of a plug-in's law can be shown where nobody knows that law any more."""
    monkeypatch.setenv("MUJOCO_GL", "off")
    (quick.parent / "limp.py").write_text(PLUGIN)
    mine = "controllers=[{name: mine, law: limp, gains: {k: 0.01}}]"
    run = ("run", quick, "--plugin", "limp.py", "--out", "run", "--no-figures", "--set", mine)
    with restored():
        assert command(*run)[0] == 0
    assert command("video", "run", "--size", "320x240")[0] == 0
    assert check_run(quick.parent / "run")["video"]["controllers"] == ["mine"]


def test_a_film_that_fails_is_an_error_of_its_own_command(run, command, no_encoder):
    """`torquebench video` ends with status 3 and one line, and leaves the run as it was."""
    before = check_run(run)
    status, _, err = command("video", run)
    assert status == 3
    assert "out of order" in err
    assert check_run(run) == before


def test_without_imageio_ffmpeg_it_says_what_to_install(run, command, monkeypatch):
    """The package's absence is told with the command that brings it."""
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    status, _, err = command("video", run)
    assert status == 3
    assert "pip install imageio-ffmpeg" in err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--quality", "best"], "wanted one of fast, pretty"),
        (["--size", "641x480"], "--size: got 641, wanted an even number"),
        (["--size", "100x100"], "--size: got 100, wanted at least 160"),
        (["--speed", "0"], "--speed: got 0.0, wanted at least 0.001"),
        (["--speed", "nan"], "wanted a finite number"),
        (["--camera", "overveiw"], "did you mean 'overview'?"),
        (["--exaggerate", "0.5"], "--exaggerate: got 0.5, wanted at least 1"),
        (["--ears", "conventional"], "wanted two names of controllers, left and right"),
        (["--sound", "--ears", "conventional,linear-bnd"], "did you mean 'linear-band'?"),
        (["--sound", "--controllers", "conventional", "--ears", "conventional,linear-band"], "no controller is called"),
        (["--sound", "--speed", "0.02"], "got 0.02, wanted 0.25 to 4 with sound"),
        (["--sound", "--out", "x.webp"], "--sound: .webp is silent"),
        (["--sound", "--still", "0.1", "--out", "x.png"], "--sound: .png is silent"),
        (["--controllers", "linear-bnd"], "did you mean 'linear-band'?"),
        (["--still", "0.1"], "wanted --out FILE"),
        (["--still", "-1", "--out", "a.png"], "wanted a time of the run"),
        (["--still", "99", "--out", "a.png"], "got 99, wanted a time of the run, 0 to "),
        (["--out", "nowhere/a.mp4"], "nowhere is not a folder"),
        (["--out", "."], ". is a folder, wanted a file"),
        (["--out", "x.gif"], "got x.gif, wanted a name that ends in .mp4 or .webp"),
        (["--out", "film"], "got film, wanted a name that ends in .mp4"),
        (["--out", "x.png"], "one picture: --still SECONDS --out FILE.png"),
        (["--out", "x.jpg", "--still", "0.1"], "got x.jpg, wanted a name that ends in .png"),
        (["--out", "x.mp4", "--still", "0.1"], "got x.mp4, wanted a name that ends in .png"),
    ],
)
def test_bad_arguments_are_refused(run, command, arguments, said):
    """Status 2, what was wanted and the nearest name; nothing is written."""
    before = sorted(run.parent.rglob("*"))
    status, out, err = command("video", run, *arguments)
    assert (status, out) == (2, "")
    assert said in err
    assert sorted(run.parent.rglob("*")) == before


def test_all_mistakes_are_told_at_once(run, command):
    """Four wrong options give four lines."""
    wrong = "--quality", "best", "--speed", "-1", "--camera", "top", "--sound", "--ears", "left,right"
    _, _, err = command("video", run, *wrong)
    assert len(err.splitlines()) == 5  # neither ear has a controller


def test_what_is_no_run_is_refused(run, command):
    """One whose trajectory was changed; tests/cli/test_run_folder.py has the others."""
    path = run / "conventional" / "trajectory.npz"
    path.write_bytes(path.read_bytes()[:-1])
    status, _, err = command("video", run)
    assert status == 2
    assert "missing or changed" in err


def test_a_changed_arm_is_told(run, command, tmp_path, monkeypatch):
    """When the arm's file is no longer the one that was run, the film says that it shows another."""
    manifest = json.loads((run / "manifest.json").read_text())
    manifest["model_files"]["puma560.xml"] = "0" * 64
    write_manifest(run, manifest)
    out = tmp_path / "still.png"
    assert "has changed since the run" in command("video", run, "--still", "0.2", "--out", out)[2]


def test_too_many_controllers_for_the_frame(run, command):
    """What does not fit is refused with what helps."""
    status, _, err = command("video", run, "--size", "160x160", "--out", "a.mp4")
    assert status == 2
    assert err.startswith(
        "--size: 2 controllers do not fit in 160x160: each wants 150x150 or more below a line of 20 px"
    )
    assert "a larger frame, or fewer --controllers" in err
    status, _, err = command("video", run, "--size", "160x168", "--controllers", "conventional", "--out", "a.mp4")
    assert (status, "--size: 1 controller does not fit in 160x168" in err) == (2, True)


@pytest.mark.parametrize(
    "gl", ["nonsense", *(pytest.param(gl, marks=pytest.mark.slow) for gl in ("egl", "osmesa", "off"))]
)
def test_a_run_does_not_need_the_opengl_that_is_asked_for(quick, gl):
    """MuJoCo cannot be imported with a MUJOCO_GL that is absent or, here, no valid name; runs can be made."""
    command = [sys.executable, "-m", "torquebench", "run", str(quick), "--out", "run", "--no-figures"]
    environment = os.environ | {"MUJOCO_GL": gl}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, cwd=quick.parent)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_environment_is_left_as_it_was(run, command, monkeypatch):
    """MUJOCO_GL is there again after a command, and absent where it was absent."""
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    command("video", run.parent)
    assert os.environ["MUJOCO_GL"] == "nonsense"
    monkeypatch.delenv("MUJOCO_GL")
    command("video", run.parent)
    assert "MUJOCO_GL" not in os.environ


def test_doctor_tells_what_there_is(command, monkeypatch):
    """Exit status 0 as text and as JSON: versions, threads, cache, encoder, each back end and why not, what is used."""
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    status, out, err = command("doctor", "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)
    assert {"mujoco", "numpy", "numba", "imageio-ffmpeg", "python"} <= set(found["software"])
    assert found["threads"]["usable"] >= 1
    assert os.path.isdir(found["kernel_cache"])
    assert os.path.isfile(found["ffmpeg"])
    tried = {x["name"]: x for x in found["drawing"]["tried"]}
    assert next(iter(tried)) == "nonsense"
    assert not tried["nonsense"]["ok"]
    assert "invalid value" in tried["nonsense"]["why"]
    for x in tried.values():
        assert x["ok"] != bool(x["why"])
        assert not (x["ok"] and x["install"])
    first = next((name for name, x in tried.items() if x["ok"]), "stick")
    assert found["drawing"]["used"] == first
    status, out, err = command("doctor")
    assert (status, err) == (0, "")
    for word in ("nonsense", "kernel cache", "threads", "ffmpeg", f"films are drawn by: {first}"):
        assert word in out


def test_doctor_names_what_to_install(command, monkeypatch):
    """Where nothing draws and there is no encoder, the packages are named; the status is 0 all the same."""
    from torquebench.video import opengl

    monkeypatch.setattr(opengl, "probe", lambda name: opengl.Backend(name, "cannot load it"))
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    status, out, _ = command("doctor")
    assert status == 0
    for word in ("libegl1 libgl1", "libosmesa6", "pip install imageio-ffmpeg", "stick figure"):
        assert word in out


def test_a_film_that_cannot_be_written_leaves_a_manifest_that_holds(run, command, monkeypatch):
    """When the disk fails between the old film and the new, the manifest names neither, and all it names is there."""
    from torquebench.experiment import store

    assert command("video", run, "--size", "320x240")[0] == 0
    assert check_run(run)["video"]["size"] == [320, 240]
    write = store.atomic_write

    def full(path, content):
        if path.name == "video.mp4":
            raise OSError("no space left")
        write(path, content)

    monkeypatch.setattr(store, "atomic_write", full)
    status, _, err = command("video", run, "--size", "320x240", "--controllers", "linear-band")
    assert status == 3
    assert "no space left" in err
    manifest = check_run(run)
    assert "video" not in manifest
    assert "video.mp4" not in manifest["files"]

"""``torquebench view``: what it prints, serves and refuses, and that it ends."""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path
from urllib.parse import urljoin, urlsplit

import pytest

from tests.cli.conftest import QUICK
from torquebench.cli.app import main
from torquebench.experiment.store import add_to_run, check_run
from torquebench.video import process
from torquebench.view import server

ADDRESS = r"view: (http://127\.0\.0\.1:\d+/[\w-]{20,}/)#([^\n]*)\n"
NOWHERE = "http://127.0.0.1:1/token/"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Folder of a finished run."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "quick.yaml").write_text(QUICK)
    assert main(["run", str(folder / "quick.yaml"), "--out", str(folder / "run"), "--no-figures"]) == 0
    return folder / "run"


def test_view_serves_the_run_until_interrupted(finished):
    """Without a display it prints address and what to begin with, serves the run's page, and Ctrl-C ends it with 0."""
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [
        sys.executable,
        "-m",
        "torquebench",
        "view",
        str(finished),
        "--speed",
        "0.5",
        "--controllers",
        "linear-band",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        said = process.stdout.readline() + process.stdout.readline()
        address, chosen = re.search(ADDRESS, said).groups()
        with urllib.request.urlopen(address, timeout=60) as reply:
            page = reply.read()
        with urllib.request.urlopen(urljoin(address, "metrics.json"), timeout=60) as reply:
            linked = reply.read()
        process.send_signal(signal.SIGINT)
        said += process.stdout.read()
        assert process.wait(60) == 0
    assert "in the browser, as no window opens here (neither DISPLAY nor WAYLAND_DISPLAY is set)" in said
    assert chosen == "play=&speed=0.5&show=linear-band"
    assert page == (finished / "report.html").read_bytes()
    assert linked == (finished / "metrics.json").read_bytes()  # as are the other files that the page links
    check_run(finished)  # nothing was written


@pytest.mark.parametrize("more", ["--quiet", "--json"])
def test_the_address_is_printed_whatever_else_is_not(finished, command, monkeypatch, more):
    """With --quiet it is all of standard output; with --json a line on standard error, and it is in the document."""

    class Interrupted:
        def wait(self):
            raise KeyboardInterrupt

    monkeypatch.setattr(threading, "Event", Interrupted)
    monkeypatch.setattr(server, "serve", lambda page, port, files: contextlib.nullcontext(NOWHERE))
    status, out, err = command("view", finished, "--no-open", more)
    assert status == 0
    if more == "--json":
        assert json.loads(out)["address"] == f"{NOWHERE}#play="
        assert err.strip() == f"view: {NOWHERE}#play="
    else:
        assert (out.strip(), err) == (f"view: {NOWHERE}#play=", "")


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        (["view", "RUN", "--speed", "0"], "--speed: got 0, wanted 0.001 to 1000"),
        (["view", "RUN", "--speed", "nan"], "--speed: got nan"),
        (["view", "RUN", "--port", "70000"], "--port: got 70000"),
        (["view", "RUN", "--controllers", "linear-bnd"], "did you mean 'linear-band'"),
        (["view", "nowhere"], "RUN: nowhere"),
        (["view", "RUN", "--speed", "-1", "--port", "-2"], "--port: got -2"),
    ],
)
def test_bad_input(finished, command, arguments, wanted):
    """Exit status 2, the option and what was wanted; nothing is served or written."""
    status, out, err = command(*(finished if word == "RUN" else word for word in arguments))
    assert (status, out) == (2, "")
    assert wanted in err
    assert not Path("runs").exists()


def test_a_port_that_is_taken(finished, command):
    """Exit status 2 and which."""
    with server.serve(b"{}") as other:
        port = urlsplit(other).port
        status, _, err = command("view", finished, "--no-open", "--port", port)
    assert status == 2
    assert f"--port: 127.0.0.1:{port} cannot be used" in err


def test_a_run_without_its_page(finished, command, tmp_path):
    """Exit status 2, and the command that writes the page."""
    run = shutil.copytree(finished, tmp_path / "run")
    add_to_run(run, {"report.html": None})
    status, _, err = command("view", run, "--no-open")
    assert status == 2
    assert f"torquebench report {run} writes it" in err


def test_a_window_is_preferred(finished, command, monkeypatch):
    """Where one opens it gets the run, and no page is served."""
    jobs = []

    def show(module, job, gl, silence):
        jobs.append(job)
        yield "conventional"

    monkeypatch.setattr(process, "answers", show)
    status, out, _ = command("view", finished, "--speed", "0.25")
    assert status == 0
    assert "http" not in out
    assert "space to pause" in out
    assert jobs[0].settings.speed == 0.25
    assert [shot.name for shot in jobs[0].footage.shots] == ["conventional", "linear-band"]

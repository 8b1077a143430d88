"""``torquebench view`` and ``run --live``: what they print, serve and refuse, and that both end."""

import http.client
import json
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.cli.conftest import QUICK
from torquebench.cli import view
from torquebench.cli.app import main
from torquebench.experiment.store import check_run

ADDRESS = r"view: (http://127\.0\.0\.1:\d+/[\w-]{20,}/)\n"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Folder of a finished run."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "quick.yaml").write_text(QUICK)
    assert main(["run", str(folder / "quick.yaml"), "--out", str(folder / "run"), "--no-figures"]) == 0
    return folder / "run"


def collect(address):
    """Everything that a page would fetch from an address."""
    parts, found = urlsplit(address), []
    while not found or found[-1] != {"kind": "end"}:
        found += get(parts, len(found))
    get(parts, len(found))
    return found


def get(parts, first):
    """The messages from number `first` on."""
    connection = http.client.HTTPConnection(parts.netloc, timeout=60)
    connection.request("GET", f"{parts.path}messages/{first}")
    found = json.loads(connection.getresponse().read())
    connection.close()
    return found


def test_view_serves_the_run_until_interrupted(finished):
    """Without a display it prints its address, serves both controllers, and Ctrl-C ends it with 0."""
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-m", "torquebench", "view", str(finished), "--speed", "0.5"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        said = process.stdout.readline() + process.stdout.readline()
        found = collect(re.search(ADDRESS, said)[1])
        process.send_signal(signal.SIGINT)
        said += process.stdout.read()
        assert process.wait(60) == 0
    assert "in the browser, as no window opens here (neither DISPLAY nor WAYLAND_DISPLAY is set)" in said
    scene = found[0]
    assert (scene["speed"], scene["live"]) == (0.5, False)
    assert [c["name"] for c in scene["controllers"]] == ["conventional", "linear-band"]
    assert {m["controller"] for m in found if m["kind"] == "frames"} == {0, 1}
    check_run(finished)  # nothing was written


@pytest.fixture
def spectator(monkeypatch):
    """Collects, in a thread, what the first page that is served has to tell."""
    found, threads = [], []
    answer = view.answer

    def listen(text):
        answer(text)
        match = re.fullmatch(ADDRESS.removesuffix(r"\n"), text)
        if match:
            threads.append(threading.Thread(target=lambda: found.extend(collect(match[1]))))
            threads[-1].start()

    monkeypatch.setattr(view, "answer", listen)
    yield found
    for thread in threads:
        thread.join(60)


def files(folder):
    """Content of every file of a run but for the manifest and the page, which name the time it took place."""
    return {
        str(p.relative_to(folder)): p.read_bytes()
        for p in Path(folder).rglob("*")
        if p.is_file() and p.name not in ("manifest.json", "report.html")
    }


def test_a_watched_run_has_the_same_bytes(quick, command, spectator):
    """With --live every file of the results is the same, to the byte; whoever watches gets both controllers whole."""
    assert command("run", quick, "--out", "plain", "--no-figures")[0] == 0
    status, out, _ = command("run", quick, "--out", "watched", "--no-figures", "--live", "--no-open")
    assert status == 0
    assert files("watched") == files("plain")
    assert len(files("plain")) >= 4
    digests = [{name: x["digest"] for name, x in check_run(Path(f))["outcomes"].items()} for f in ("plain", "watched")]
    assert digests[0] == digests[1]
    assert re.search(ADDRESS, out)
    assert "again: torquebench view watched" in out
    assert spectator[0]["live"] is True
    assert [
        sum(len(m["tool"]) // 3 for m in spectator if m.get("controller") == i and "tool" in m) for i in (0, 1)
    ] == [
        80,
        80,
    ]
    assert spectator[-1] == {"kind": "end"}


@pytest.mark.parametrize("more", [(), ("--json",)])
def test_the_address_is_told_whatever_else_is_not(quick, command, spectator, more):
    """With --quiet it is all of standard output; with --json a line on standard error, and it is in the document."""
    quiet = () if more else ("--quiet",)
    status, out, err = command("run", quick, "--out", "w", "--no-figures", "--live", "--no-open", *quiet, *more)
    assert status == 0
    assert spectator[-1] == {"kind": "end"}
    if more:
        assert json.loads(out)["address"] == re.fullmatch(ADDRESS, err)[1]
    else:
        assert (re.fullmatch(ADDRESS, out) is not None, err) == (True, "")


def test_a_watched_run_ends_though_nobody_comes(quick, command, monkeypatch):
    """It says that it waits, waits its time and no longer, and ends as it would have."""
    monkeypatch.setattr(view, "NOBODY", 0.1)
    status, out, _ = command("run", quick, "--out", "watched", "--no-figures", "--live", "--no-open")
    assert status == 0
    assert "nobody has opened the page; waiting 0.1 s" in out
    assert check_run(Path("watched"))["name"] == "quick"


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        (["view", "RUN", "--speed", "0"], "--speed: got 0, wanted 0.001 to 1000"),
        (["view", "RUN", "--speed", "nan"], "--speed: got nan"),
        (["view", "RUN", "--port", "70000"], "--port: got 70000"),
        (["view", "RUN", "--controllers", "linear-bnd"], "did you mean 'linear-band'"),
        (["view", "nowhere"], "RUN: nowhere"),
        (["run", "CONFIG", "--browser"], "--browser: wanted --live as well"),
        (["run", "CONFIG", "--speed", "2", "--port", "8000"], "--port: wanted --live as well"),
        (["run", "CONFIG", "--live", "--speed", "-1"], "--speed: got -1"),
    ],
)
def test_bad_input(finished, quick, command, arguments, wanted):
    """Exit status 2, the option and what was wanted; nothing is served or written."""
    known = {"RUN": finished, "CONFIG": quick}
    status, out, err = command(*(known.get(word, word) for word in arguments))
    assert (status, out) == (2, "")
    assert wanted in err
    assert not Path("runs").exists()


def test_a_port_that_is_taken(finished, command):
    """Exit status 2 and which."""
    with view.Server(view.Feed(), "x") as other:
        status, _, err = command("view", finished, "--no-open", "--port", other.port)
    assert status == 2
    assert f"--port: 127.0.0.1:{other.port} cannot be used" in err


def test_a_window_is_preferred(finished, command, monkeypatch):
    """Where one opens it gets the run, and no page is served."""
    jobs = []

    def child(module, argument, gl, silence, heard=None):
        if module.endswith("display"):
            return {"ok": True, "why": ""}
        jobs.append(json.loads(argument))
        return {"closed": True}

    monkeypatch.setattr(view, "run_module", child)
    status, out, _ = command("view", finished, "--speed", "0.25")
    assert status == 0
    assert "http" not in out
    assert jobs[0]["settings"]["speed"] == 0.25
    assert [shot["name"] for shot in jobs[0]["shots"]] == ["conventional", "linear-band"]

"""What the terminal shows: tables that follow its width, colour, silence, progress."""

from __future__ import annotations

import io
import os
import re
import sys
import threading
import time
from types import SimpleNamespace

import pytest

from torquebench.cli import terminal
from torquebench.cli.app import Commands, command, main
from torquebench.cli.terminal import bad, coloured, complain, following, good, progress_bar, say, speaking, table, warn

HEADER = ["controller", "law", "RMSE [mrad]", "HF [%]", "outcome"]
ROWS = [["conventional", "smc", "0.5298", "30.15", "completed"], ["band", "linear-band-smc", "0.05", "0.1", "diverged"]]
WORDS = {word for row in (HEADER, *ROWS) for word in row}


def visible(text):
    """The text without what colours it."""
    return re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", text)


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        """Say so."""
        return True


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch):
    """No wishes about colour from outside."""
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")


@pytest.fixture
def screen(monkeypatch):
    """Make standard output a terminal of some width, and return it."""

    def make(columns):
        monkeypatch.setattr(sys, "stdout", Terminal())
        monkeypatch.setattr(terminal.shutil, "get_terminal_size", lambda *_, **__: os.terminal_size((columns, 24)))
        return sys.stdout

    return make


@pytest.mark.parametrize("columns", [200, 61, 60, 50, 40, 30])
def test_a_table_fits_the_terminal_and_loses_nothing(screen, columns):
    """No line is longer than the terminal; every cell is there whole; each part begins with the controller."""
    screen(columns)
    text = visible(table(HEADER, ROWS))
    parts = text.split("\n\n")
    assert max(map(len, text.splitlines())) <= columns
    assert all(word in text for word in WORDS)
    for part in parts:
        assert [re.split(r"\s", line)[0] for line in part.splitlines()[2:]] == ["conventional", "band"]
    assert (len(parts) == 1) == (columns > 60)


def test_a_terminal_too_narrow_for_two_columns(screen):
    """Cells are folded: every character of them is there, in order."""
    screen(12)
    lines = visible(table(["k", "value"], [["a", "0123456789" * 3]])).splitlines()
    assert max(map(len, lines)) <= 12
    assert "".join(line[1:].strip() for line in lines).endswith("0123456789" * 3)


def test_prose_is_broken_between_words(screen):
    """The last column takes the room that is left; its words stay in order, and the other columns stay empty beside."""
    screen(50)
    text = "the law writes to q, which belongs to the loop and must be left alone"
    lines = visible(table(["check", "what was found"], [["inputs", text]], prose=True)).splitlines()[2:]
    assert max(map(len, lines)) <= 50
    assert " ".join(" ".join(lines).removeprefix("inputs").split()) == text
    assert all(line.startswith("        ") for line in lines[1:])


def test_only_prose_is_broken(screen):
    """Where the last column takes what the others leave, a cell of another one and the rule stay in one line."""
    screen(80)
    row = ["pid", "9.5", "3.33 [3.32, 3.35], 3 of 40", "lam 18.32, kv 44.23, ki 5955, and more of it"]
    text = visible(table(["law", "untuned [mrad]", "test", "gains"], [row], prose=True))
    _, rule, *lines = text.splitlines()
    assert set(rule) == {"-", " "}
    assert "3.33 [3.32, 3.35], 3 of 40" in lines[0]
    assert len(lines) > 1


def test_without_a_terminal_a_table_is_as_wide_as_it_is(monkeypatch):
    """What a script reads does not depend on a window."""
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    monkeypatch.setenv("COLUMNS", "20")
    assert len(table(HEADER, ROWS).splitlines()) == 4


def test_long_lines_are_broken_and_paths_are_not(screen):
    """Words keep their order; a word longer than the line stays whole."""
    out = screen(20)
    say("  results: runs/a-name-without-any-space in it")
    assert out.getvalue() == "  results:\n    runs/a-name-without-any-space\n    in it\n"


@pytest.mark.parametrize(
    ("names", "is_terminal", "expected"),
    [
        ({}, True, True),
        ({}, False, False),
        ({"NO_COLOR": "1"}, True, False),
        ({"NO_COLOR": ""}, True, True),
        ({"FORCE_COLOR": "1"}, False, True),
        ({"TERM": "dumb"}, True, False),
        ({"NO_COLOR": "1", "FORCE_COLOR": "1"}, True, False),
    ],
)
def test_when_there_is_colour(monkeypatch, names, is_terminal, expected):
    """A terminal has it unless NO_COLOR or TERM=dumb; FORCE_COLOR brings it to a file; NO_COLOR has the last word."""
    for name, value in names.items():
        monkeypatch.setenv(name, value)
    assert coloured(Terminal() if is_terminal else io.StringIO()) == expected


def test_colour_moves_nothing(screen, monkeypatch):
    """Good is green and bad is red; without the escapes the coloured table is the plain one."""
    rows = [["a", good("yes")], ["b", bad("NO")]]
    screen(80)
    painted = table(["term", "agrees"], rows)
    assert re.search(r"\x1b\[32m *yes", painted)
    assert re.search(r"\x1b\[31m *NO", painted)
    monkeypatch.setenv("NO_COLOR", "1")
    plain = table(["term", "agrees"], rows)
    assert "\x1b" not in plain
    assert [line.rstrip() for line in visible(painted).splitlines()] == plain.splitlines()


def test_silence(capsys):
    """With --quiet neither lines nor warnings are seen; the warnings are kept for the document."""
    with speaking(quiet=True, as_json=False) as voice:
        say("a line")
        warn("a warning")
        terminal.complain("an error")
    assert capsys.readouterr() == ("", "an error\n")
    assert voice.remarks == ["a warning"]
    say("again")
    assert capsys.readouterr().out == "again\n"


@pytest.mark.parametrize(
    ("is_terminal", "quiet", "seen"), [(True, False, True), (True, True, False), (False, False, False)]
)
def test_progress_is_for_people(monkeypatch, is_terminal, quiet, seen):
    """On a terminal: what is being done, how much, the time left; with --quiet, and of short work else, nothing."""
    stream = Terminal() if is_terminal else io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    with speaking(quiet, as_json=False), progress_bar(4, "step", "starting", done=1) as bar:
        bar.update(1)
        bar.describe("going on")
    written = stream.getvalue()
    assert bool(written) == seen
    if seen:
        assert re.search(r"going on .* 50% +2 steps +0:00:00 so far", visible(written))


def test_without_a_terminal_a_line_now_and_then_tells_what_is_left(monkeypatch):
    """What is done, of how many and what is left, for a log; not more often than `EVERY`, and nothing with --quiet."""
    told = {}
    for every, quiet in ((0.0, False), (60.0, False), (0.0, True)):
        monkeypatch.setattr(terminal, "EVERY", every)
        monkeypatch.setattr(sys, "stderr", stream := io.StringIO())
        with speaking(quiet, as_json=False), progress_bar(0, "loop", "starting", done=1000) as bar:
            following(bar)("tuning", 0, 5000)
            bar.update(400)
            bar.update(600)
        told[every, quiet] = stream.getvalue().splitlines()
    assert told[0.0, False][-1] == "tuning: 2,000 of 5,000 loops, 0:00:00 so far, 0:00:00 left"
    assert told[60.0, False] == told[0.0, True] == []


def test_what_is_left_does_not_count_what_is_compiled_first(monkeypatch):
    """60 s to the first of 10 units and 2 s for each other: 16 s are left after the second, and unknown before."""
    now = 0.0
    monkeypatch.setattr(terminal, "time", SimpleNamespace(monotonic=lambda: now))
    monkeypatch.setattr(terminal, "EVERY", 0.0)
    monkeypatch.setattr(sys, "stderr", stream := io.StringIO())
    bar = terminal.Log(10, "run", "why", 0)
    for now in (60.0, 62.0):  # noqa: B007  the clock reads it
        bar.update(1)
    assert stream.getvalue().splitlines() == [
        "why: 1 of 10 runs, 0:01:00 so far",
        "why: 2 of 10 runs, 0:01:02 so far, 0:00:16 left",
    ]


def test_what_is_left_is_told_where_it_is_known(monkeypatch):
    """Without an estimate nothing is called left, and nothing is counted of which there may be none."""
    shown = []
    for total in (0, 4):
        monkeypatch.setattr(sys, "stderr", stream := Terminal())
        with progress_bar(total, "figure", "writing") as bar:
            for _ in range(3 if total else 0):
                bar.update(1)
                time.sleep(0.01)
        shown.append(visible(stream.getvalue()))
    assert re.search(r"writing .* 0:00:00 so far", shown[0])
    assert "left" not in shown[0]
    assert "0 figures" not in shown[0]
    assert re.search(r"3 figures 0:00:0\d so far, 0:00:0\d left", shown[1])


def test_progress_inside_progress(monkeypatch):
    """Both are seen, each in a line of its own; what is written to standard output meanwhile goes there."""
    stream, out = Terminal(), io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(sys, "stdout", out)
    with progress_bar(4, "step", "the whole"), progress_bar(2, "figure", "a part") as bar:
        bar.total = 3
        following(bar)("drawing", 1, 3)
        terminal._PROGRESS[0].refresh()
        say("a line")
        warn("a warning")
    assert out.getvalue() == "a line\n"
    lines = visible(stream.getvalue()).replace("\r", "\n").splitlines()
    assert any(line.startswith("the whole") for line in lines)
    assert any(line.startswith("drawing") and "33%" in line and "1 figures" in line for line in lines)
    assert any(line.rstrip() == "a warning" for line in lines)


@pytest.mark.parametrize(("quiet", "seen"), [(False, True), (True, False)])
def test_a_command_that_shows_nothing_is_seen_to_work(monkeypatch, quiet, seen):
    """On a terminal a line tells that it works, and for how long; it is gone before the next line is written."""
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(terminal.Beat, "PATIENCE", 0.02)
    silent, spoken = threading.Event(), threading.Event()

    @command("slow", example="")
    def slow():
        silent.wait(0.2)
        complain("a line")
        with progress_bar(1, "step", "a bar"):
            spoken.wait(0.1)

    monkeypatch.setattr(Commands, "get_command", lambda *_: slow)
    assert main(["slow", "--quiet"] if quiet else ["slow"]) == 0
    before, _, after = stream.getvalue().partition("a line\n")
    assert ("torquebench slow: working, 0 s" in before) == seen
    assert before.endswith("\x1b[K") == seen
    assert "working" not in after.partition("a bar")[2]


def test_nothing_beats_where_nobody_looks(monkeypatch):
    """A file, a pipe, and a terminal that cannot take a line back get nothing."""
    monkeypatch.setattr(terminal.Beat, "PATIENCE", 0.02)
    for stream, kind in ((io.StringIO(), "xterm"), (Terminal(), "dumb")):
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setenv("TERM", kind)
        with terminal.beating("torquebench slow"):
            threading.Event().wait(0.1)
        assert stream.getvalue() == ""

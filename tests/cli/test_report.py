"""``torquebench report``: the same bytes from the stored run, nothing simulated, several runs side by side."""

import json
import re
from html.parser import HTMLParser

import pytest

from torquebench.cli.main import main
from torquebench.experiment.store import check_run
from torquebench.report.run_page import differences


class Page(HTMLParser):
    """Collects what a page asks for from elsewhere, and its text."""

    def __init__(self):
        super().__init__()
        self.outside, self.text = [], []

    def handle_starttag(self, tag, attributes):
        """Note what is fetched."""
        for key, value in attributes:
            if key in ("src", "href", "xlink:href") and value and not value.startswith(("#", "data:")):
                self.outside.append(value)

    def handle_data(self, data):
        """Note what is read."""
        self.text.append(data)


def text_of(path):
    """Return a page's text with single spaces; it must ask for nothing from elsewhere."""
    page = Page()
    page.feed(path.read_text())
    assert page.outside == []
    return " ".join(" ".join(page.text).split())


@pytest.fixture
def run(quick, capsys):
    """Return the folder of a finished run."""
    assert main(["run", str(quick), "--out", str(quick.parent / "one")]) == 0
    capsys.readouterr()
    return quick.parent / "one"


@pytest.fixture
def no_simulation(monkeypatch):
    """Any simulation is an error from here on."""

    def refuse(*_, **__):
        raise AssertionError("something was simulated")

    monkeypatch.setattr("torquebench.sim.simulate.simulate", refuse)


@pytest.mark.parametrize("redraw", [(), ("--redraw",)])
def test_made_again_it_is_the_same_file(run, command, no_simulation, redraw):
    """From stored figures, or figures drawn again from the trajectories: the same bytes, and the manifest holds."""
    first = (run / "report.html").read_bytes()
    assert command("report", run, *redraw)[::2] == (0, "")
    assert (run / "report.html").read_bytes() == first
    assert "report.html" in check_run(run)["files"]


def test_the_page_tells_what_was_asked_and_what_came_out(run):
    """Every controller, gain with unit, metric, figure and seed is on it; nothing comes from outside."""
    text = text_of(run / "report.html")
    metrics = json.loads((run / "metrics.json").read_text())["controllers"]
    for name in ("conventional", "linear-band"):
        assert name in text
        assert f"{1e3 * metrics[name]['rmse']['value']:.4g}" in text
    for word in ("1/s", "slope lambda", "chattering index HF", "mujoco:puma560", "chain ideal", "numpy", "seed"):
        assert word in text
    page = (run / "report.html").read_text()
    assert len(re.findall(r"<figure><svg", page)) == len(list((run / "figures").glob("*.svg")))
    assert "prefers-color-scheme: dark" in page
    assert 'name="viewport"' in page


def test_text_from_the_config_cannot_become_markup(quick, command):
    """A description with a script in it is text."""
    quick.write_text(
        quick.read_text().replace("name: quick\n", "name: quick\ndescription: <script>alert(1)</script>\n")
    )
    assert command("run", quick, "--out", "two", "--no-figures")[0] == 0
    page = (quick.parent / "two" / "report.html").read_text()
    assert "<script" not in page
    assert "&lt;script&gt;" in page


def test_a_film_is_embedded(run, command):
    """A file ``video.mp4`` beside the run is on the page when it is made again."""
    (run / "video.mp4").write_bytes(b"not really a film")
    assert command("report", run)[0] == 0
    assert "data:video/mp4;base64,bm90IHJlYWxseSBhIGZpbG0=" in (run / "report.html").read_text()


def test_several_runs_side_by_side(run, quick, command):
    """A row for each run and controller, and the keys that differ, no others."""
    assert (
        command("run", quick, "--out", "two", "--no-figures", "--set", "controllers.linear-band.gains.phi=0.1")[0] == 0
    )
    status, out, err = command("report", run, quick.parent / "two", "--out", "both.html")
    assert (status, err) == (0, "")
    assert "both.html" in out
    text = text_of(quick.parent / "both.html")
    assert "controllers.linear-band.gains.phi 0.3 0.1" in text
    assert "gains.lam" not in text
    assert text.count("linear-band") >= 3


def test_differences_are_the_keys_that_differ() -> None:
    """Equal ones are left out; one that is missing shows as a dash."""
    assert differences({"a": {"x": "1", "y": "2"}, "b": {"x": "1", "y": "3", "z": "4"}}) == [
        ["y", "2", "3"],
        ["z", "-", "4"],
    ]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: (f / "manifest.json").unlink(), "the run has not finished (no manifest.json)"),
        (lambda f: (f / "metrics.json").write_text("{}"), "missing or changed"),
        (lambda f: (f / "conventional" / "trajectory.npz").unlink(), "missing or changed"),
    ],
)
def test_a_spoilt_run_is_refused(run, command, spoil, message):
    """Exit 2, what is wrong, and the page as it was."""
    spoil(run)
    before = (run / "report.html").read_bytes()
    status, _, err = command("report", run)
    assert status == 2
    assert message in err
    assert (run / "report.html").read_bytes() == before


def test_what_would_be_overwritten_is_refused(run, command):
    """An existing file is not replaced, and two runs of one name are not confused."""
    (run.parent / "there.html").write_text("mine")
    assert command("report", run, "--out", "there.html")[0] == 2
    assert (run.parent / "there.html").read_text() == "mine"
    assert command("report", run, run, "--out", "new.html")[0] == 2
    assert not (run.parent / "new.html").exists()

"""``torquebench report``: the same bytes from the stored run, nothing simulated, several runs side by side."""

import hashlib
import json
import os
import re
import shutil
from html.parser import HTMLParser

import pytest

from torquebench.experiment.store import check_run, write_manifest
from torquebench.report.compare_page import differences
from torquebench.robot.library import data_root
from torquebench.sim.session import Session


class Page(HTMLParser):
    """Collects what a page asks for from elsewhere, and its text."""

    def __init__(self):
        super().__init__()
        self.outside, self.text = [], []

    def handle_starttag(self, tag, attributes):
        """Note what is fetched."""
        for key, value in attributes:
            followed = tag == "a" and "://" not in (
                value or ""
            )  # a link to a file beside the page, fetched by a click only
            if key in ("src", "href", "xlink:href") and value and not value.startswith(("#", "data:")) and not followed:
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
def no_simulation(monkeypatch):
    """Any simulation is an error from here on."""

    def refuse(*_, **__):
        raise AssertionError("something was simulated")

    monkeypatch.setattr(Session, "run", refuse)


def test_made_again_it_is_the_same_file(run, command, no_simulation):
    """From what is stored: the same bytes, and the manifest holds."""
    first = (run / "report.html").read_bytes()
    assert command("report", run)[::2] == (0, "")
    assert (run / "report.html").read_bytes() == first
    assert "report.html" in check_run(run)["files"]


def test_the_page_tells_what_was_asked_and_what_came_out(run):
    """Every controller, gain with unit, metric and seed is on it, figures are linked; nothing comes from outside."""
    text = text_of(run / "report.html")
    metrics = json.loads((run / "metrics.json").read_text())["controllers"]
    for name in ("conventional", "linear-band"):
        assert name in text
        assert f"{1e3 * metrics[name]['rmse']['value']:.4g}" in text
    for word in ("1/s", "slope lambda", "chattering index HF", "mujoco:puma560", "chain ideal", "numpy", "seed"):
        assert word in text
    page = (run / "report.html").read_text()
    drawn = sorted(f"figures/{path.name}" for path in (run / "figures").glob("*"))
    assert re.findall(r'href="(figures/[^"]*)"', page) == drawn
    assert "prefers-color-scheme: dark" in page
    assert 'name="viewport"' in page


def test_text_from_the_config_cannot_become_markup(quick, command):
    """A description with a script in it is text, and so is what the page's own script reads."""
    quick.write_text(
        quick.read_text().replace("name: quick\n", "name: quick\ndescription: <script>alert(1)</script>\n")
    )
    assert command("run", quick, "--out", "two", "--no-figures")[0] == 0
    page = (quick.parent / "two" / "report.html").read_text()
    assert "alert(1)</script" not in page
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


@pytest.fixture
def own_data(tmp_path, monkeypatch):
    """A copy of the arms and configs, which a test may change."""
    for name in ("models", "configs"):
        shutil.copytree(data_root() / name, tmp_path / "data" / name)
    monkeypatch.setenv("TORQUEBENCH_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


def test_stored_numbers_stay_what_they_were_when_the_arm_is_edited(own_data, run, command):
    """Numbers and limits are those of the run, on the terminal, in the document and on the page; it is said.

    The limits of the arm are halved, which would double every figure that is a share of them.
    """
    document = json.loads(command("report", run, "--json")[1])["runs"][0]
    arm = own_data / "models" / "puma560" / "puma560.xml"
    halved = re.sub(
        r'(ctrlrange|forcerange|actuatorfrcrange)="([-\d.]+) ([-\d.]+)"',
        lambda m: f'{m[1]}="{float(m[2]) / 2:g} {float(m[3]) / 2:g}"',
        arm.read_text(),
    )
    assert halved != arm.read_text()
    arm.write_text(halved)
    status, out, err = command("report", run)
    assert status == 0
    assert "the files of the arm 'puma560' have changed since the run" in err
    page = (run / "report.html").read_text()
    assert "the files of the arm &#39;puma560&#39; have changed since the run" in page
    assert '"arm":null,"why":"the files of the arm have changed since the run"' in page
    for name, law in document["controllers"].items():
        for text in (out, page):
            assert f"{law['metrics']['hf']['value']:.4g}" in text, name
    after = json.loads(command("report", run, "--json")[1])
    assert after["runs"][0] == document
    assert any("have changed since the run" in remark for remark in after["remarks"])


def test_a_folder_of_an_older_version_is_read_while_its_arm_is_there(own_data, run, command):
    """Without stored joints they come from the arm, where its files are those of the run; else it is refused.

    That nothing vouches for the manifest is told.
    """
    path, newer = run / "manifest.json", ("joints", "conditions", "flags", "manifest_sha256")
    old = {key: value for key, value in json.loads(path.read_text()).items() if key not in newer}
    path.write_text(json.dumps(old))
    before = (run / "report.html").read_bytes()
    status, _, err = command("report", run)
    assert (status, len(err.splitlines())) == (0, 1)
    assert f"{path}: an older version wrote it, without manifest_sha256" in err
    assert (run / "report.html").read_bytes() == before
    with (own_data / "models" / "puma560" / "links.yaml").open("a") as file:
        file.write("# another remark\n")
    status, _, err = command("report", run)
    assert status == 2
    assert "an older version left it" in err
    assert len(err.splitlines()) == 1


def with_checksum(folder, name, content):
    """Write a file into a run's folder and have the manifest agree with it, as whoever wants to deceive would."""
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    (folder / name).write_bytes(content)
    manifest["files"][name] = hashlib.sha256(content).hexdigest()
    write_manifest(folder, manifest)


def swap_trajectories(folder):
    """Give each controller the other's run."""
    a, b = ((folder / name / "trajectory.npz").read_bytes() for name in ("conventional", "linear-band"))
    with_checksum(folder, "conventional/trajectory.npz", b)
    with_checksum(folder, "linear-band/trajectory.npz", a)


def change_a_gain(folder):
    """Have the experiment say another gain than was run."""
    text = (folder / "experiment.yaml").read_text()
    assert "phi: 0.3" in text
    with_checksum(folder, "experiment.yaml", text.replace("phi: 0.3", "phi: 0.4").encode())


def forget_metrics(folder):
    """Have the metrics be those of one controller alone."""
    content = json.loads((folder / "metrics.json").read_text())
    content["controllers"]["linear-band"] = None
    with_checksum(folder, "metrics.json", json.dumps(content).encode())


def add_a_metric(folder):
    """Have a metric that is registered nowhere, as one of a plug-in that was not loaded."""
    content = json.loads((folder / "metrics.json").read_text())
    for metrics in content["controllers"].values():
        metrics["mine"] = metrics["rmse"]
    with_checksum(folder, "metrics.json", json.dumps(content).encode())


@pytest.mark.parametrize(
    ("spoil", "file"),
    [
        (add_a_metric, "metrics.json"),
        (swap_trajectories, "trajectory.npz"),
        (change_a_gain, "experiment.yaml"),
        (forget_metrics, "metrics.json"),
    ],
)
def test_files_that_do_not_belong_together_are_refused(run, command, spoil, file):
    """Each with a right checksum, but of another run than the rest: exit 2, one line that names the file."""
    spoil(run)
    status, out, err = command("report", run)
    assert (status, out) == (2, "")
    assert file in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize("name", ["manifest.json", "metrics.json", "certificates.json"])
@pytest.mark.parametrize(
    "content",
    ["[]", "null", "1", '"x"', "NaN", "{", "", '{"files": []}', '{"files": {"a": 1}}', '{"files": {}}', "[" * 3000]
    + ['{"controllers": {"conventional": 3}}', '{"conventional": {}}', '{"controllers": {"conventional": {}}}'],
)
def test_json_that_is_not_ours_is_bad_input(run, command, name, content):
    """Whatever a file holds, exit 2 and one line; no traceback, no internal error."""
    if name == "manifest.json":
        (run / name).write_text(content)
    else:
        with_checksum(run, name, content.encode())
    status, out, err = command("report", run)
    assert (status, out) == (2, ""), err
    assert len([line for line in err.splitlines() if "an older version wrote it" not in line]) == 1
    assert name in err or "another command" in err


@pytest.mark.parametrize("line", ["report", "diff", "video --still 0 --out x.png", "view --no-open"])
def test_a_manifest_of_which_one_bit_was_flipped_is_refused(run, command, line):
    """Whatever reads it, exit 2 with its name: what it says is shown, such as conditions and limits of the joints."""
    path = run / "manifest.json"
    text = path.read_text()
    path.write_text(text.replace("puma560", "quma560", 1))
    assert path.read_text() != text
    kind, *options = line.split()
    status, out, err = command(kind, run, *[run] * (kind == "diff"), *options)
    assert (status, out) == (2, ""), err
    assert "manifest.json: changed since it was written" in err
    path.write_text(json.dumps(json.loads(text), sort_keys=True))  # laid out in another way, it says the same
    assert check_run(run)


def test_a_pipe_in_place_of_the_manifest_is_refused(run, command):
    """It is not waited for."""
    (run / "manifest.json").unlink()
    os.mkfifo(run / "manifest.json")
    assert command("report", run)[0] == 2


def test_a_printed_page_breaks_between_figures_and_rows(run):
    """The rules for print that all pages share are these, and none of the screen's."""
    text = (run / "report.html").read_text()
    rules = re.search(r"@media print \{(.*)\}\n@media", text)[1]
    assert re.findall(r"([^{}]+)\{([^{}]*)\}", rules) == [
        (" html ", " font-size: 12px; "),
        (" .scroll, .scroll:not(.prose) tr > :first-child ", " position: static; background: none; "),
        (" body ", " max-width: none; padding: 0; font-size: 10pt; "),
        (" figure, tr, svg, dl, .halves section ", " break-inside: avoid; "),
        (" h2, h3 ", " break-after: avoid; "),
        (" button, details:not([open]), .screen ", " display: none; "),
    ]

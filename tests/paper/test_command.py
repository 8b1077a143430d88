"""``torquebench paper --quick``, run once and looked at from all sides."""

from __future__ import annotations

import contextlib
import io
import json
import re
from html.parser import HTMLParser

import pytest
from paper.claims import claims
from paper.runs_table import Runs

from torquebench.cli.app import main
from torquebench.cli.paper import claims_table
from torquebench.experiment.store import check_run
from torquebench.shipped import data_root


@pytest.fixture
def command(capsys):
    """Run the command line: (exit status, standard output, standard error)."""

    def run(*arguments):
        status = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """The quick study: the folder of its results, and what it printed with --json."""
    out = tmp_path_factory.mktemp("paper") / "out"
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert main(["paper", "--quick", "--out", str(out), "--json"]) == 0
    return out, printed.getvalue()


@pytest.fixture(scope="module")
def folder(study):
    """Results of the quick study."""
    return study[0]


def test_what_it_prints_agrees_with_the_files(study):
    """With --json: the claims of ``claims.json``, the plants of ``checks.json``; as a table: each claim and verdict."""
    out, printed = study
    told, stored = json.loads(printed), read(out, "claims.json")
    assert (told["command"], told["status"], told["problems"]) == ("paper", 0, [])
    assert told["claims"] == stored
    assert told["plants_apart"] == read(out, "checks.json")["agreement"]
    assert told["directory"] == str(out)
    table = claims_table(claims(Runs.read(out / "runs.csv")))
    assert all(claim["claim"] in table and claim["verdict"] in table for claim in stored)


def read(folder, name):
    """Return a JSON file of the results."""
    return json.loads((folder / name).read_text())


def test_the_folder_is_complete(folder):
    """Claims, runs, checks, the page and Figs 9 to 11, with the manifest's checksums."""
    wanted = {"claims.json", "claims.md", "runs.csv", "checks.json", "report.html"}
    wanted |= {f"figures/fig{k}.{fmt}" for k in (9, 10, 11) for fmt in ("svg", "png")}
    assert set(check_run(folder)["files"]) == wanted


def test_the_claims_follow_from_the_stored_runs(folder):
    """Judged again from ``runs.csv`` they are the same; every field is there, and every config exists."""
    stored = read(folder, "claims.json")
    again = [claim.to_json() for claim in claims(Runs.read(folder / "runs.csv"))]
    assert stored == json.loads(json.dumps(again))
    for claim in stored:
        assert {"claim", "where", "verdict", "figure", "interval", "condition", "ablation", "config"} <= claim.keys()
        assert claim["verdict"] in ("holds", "fails", "holds only if")
        assert claim["interval"][0] <= claim["figure"] <= claim["interval"][1]
        assert (data_root() / claim["config"]).is_file()


def test_both_plants_agree(folder, figure):
    """Within 1e-12 rad, switching laws included.

    Without a model, sgn(s) leaves the torque as it is until s changes sign: the arm is in open loop, in which round-off
    grows tenfold a second. The proposed law on the slow chain without its linear term does not damp either. There the
    plants must command the same torques at every instant, and stay within 1e-10 rad.
    """
    rows = read(folder, "checks.json")["agreement"]
    undamped = ("conventional-blind", "conventional-strong", "m-no-linear")
    damped = [r["position"] for r in rows if r["controller"] not in undamped]
    figure(f"plants apart in {len(damped)} of {len(rows)} runs: all laws that damp [rad]", max(damped), "<= 1e-12")
    figure(
        "plants apart in the others [rad]",
        max(r["position"] for r in rows if r["controller"] in undamped),
        "<= 1e-12 in the issue",
    )
    assert len(damped) >= 120
    for row in rows:
        assert row["torques"] == 0, row
        assert row["position"] <= (1e-10 if row["controller"] in undamped else 1e-12), row


def test_hf_is_a_property_of_the_law_and_total_variation_is_not(folder, figure):
    """From 0.25 to 5 ms HF moves by less than 6 percentage points; total variation follows the period, tenfold."""
    rows = read(folder, "checks.json")["chattering"]
    assert [row["control_period"] for row in rows] == [0.00025, 0.0005, 0.001, 0.002, 0.005]
    hf, variation = ([row[key] for row in rows] for key in ("hf", "total_variation"))
    figure("HF of conventional SMC from 0.25 to 5 ms [percentage points]", max(hf) - min(hf), "< 6")
    assert max(hf) - min(hf) < 6.0
    assert max(variation) > 10.0 * min(variation)


def test_the_noise_is_what_it_is_said_to_be(folder, figure):
    """Standard deviation within 1 % of sigma, spectrum within 1 dB of a hold's up to 80 Hz."""
    noise = read(folder, "checks.json")["noise"]
    figure("standard deviation of the noise over sigma", noise["standard_deviation_over_sigma"], "0.99 .. 1.01")
    figure("noise spectrum off sinc^2, up to 80 Hz [dB]", noise["largest_deviation_dB"], "< 1")
    assert noise["standard_deviation_over_sigma"] == pytest.approx(1.0, abs=0.01)
    assert noise["largest_deviation_dB"] < 1.0


class Page(HTMLParser):
    """Collects what a page asks for from elsewhere, and its text."""

    def __init__(self):
        super().__init__()
        self.outside, self.text, self.open = [], [], []

    def handle_starttag(self, tag, attributes):
        """Note what is fetched."""
        for key, value in attributes:
            if key in ("src", "href", "xlink:href") and value and not value.startswith(("#", "data:")):
                self.outside.append(value)

    def handle_data(self, data):
        """Note what is read."""
        self.text.append(data)


def test_the_page_stands_alone(folder):
    """Nothing from outside, every claim with its verdict, three figures as SVG."""
    page = Page()
    page.feed((folder / "report.html").read_text())
    assert page.outside == []
    text = " ".join(" ".join(page.text).split())
    for claim in read(folder, "claims.json"):
        assert claim["claim"] in text
        assert claim["condition"] in text
    assert len(re.findall(r"<figure><img", (folder / "report.html").read_text())) == 3


def test_bad_arguments_write_nothing(tmp_path, command):
    """No threads: exit 2 and no folder."""
    status, _, err = command("paper", "--workers", "0", "--out", tmp_path / "out")
    assert status == 2
    assert "--workers: got 0, wanted" in err
    assert not (tmp_path / "out").exists()


def test_without_a_checkout_it_says_where_the_study_is(tmp_path, command, monkeypatch):
    """As in a wheel, which has configs and models only: exit 2, one line, nothing written."""
    monkeypatch.setenv("TORQUEBENCH_DATA", str(tmp_path))
    status, _, err = command("paper", "--quick", "--out", tmp_path / "out")
    assert status == 2
    assert len(err.splitlines()) == 1
    assert f"no folder {tmp_path / 'scripts' / 'paper'}: the study comes with the repository" in err
    assert not (tmp_path / "out").exists()

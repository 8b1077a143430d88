"""``torquebench diff``: ratios of one run or sweep to another, and limits that make the exit status 1."""

import json
import math
import shutil
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy import stats

from tests.cli.conftest import QUICK
from torquebench import diff, run_sweep
from torquebench.cli.app import main
from torquebench.diffs import Limit, _compared, read_limit
from torquebench.errors import ConfigError
from torquebench.experiment.store import write_manifest
from torquebench.statistics import draws_needed


@pytest.fixture(scope="module")
def softer(tmp_path_factory):
    """Return the folder of the run of `finished` with a wider band, and without the other law."""
    folder = tmp_path_factory.mktemp("softer")
    text = QUICK.replace("phi: 0.3", "phi: 0.6").replace("  - {name: conv", "# - {name: conv")
    (folder / "quick.yaml").write_text(text)
    assert main(["run", str(folder / "quick.yaml"), "--out", str(folder / "two"), "--quiet"]) == 0
    return folder / "two"


def test_a_run_against_itself_has_changed_nothing(command, run):
    """Every ratio is 1, whatever the limits, and the exit status 0; a metric that is 0 twice is no exception."""
    status, out, _ = command("diff", run, run, "--fail-if", "rmse > 1", "--fail-if", "chattering > 1.01", "--json")
    found = json.loads(out)
    assert status == 0
    assert found["broken"] == []
    assert {change["ratio"]["ratio"] for change in found["changes"]} == {1.0}
    assert {change["controller"] for change in found["changes"]} == {"conventional", "linear-band"}


def test_a_limit_is_passed_by_the_ratio_of_a_single_run(command, run, softer):
    """Half the stiffness of the band is a larger error: told with its ratio, exit 1, and the law that is gone too."""
    status, out, err = command("diff", run, softer, "--fail-if", "rmse > 1.05")
    values = [json.loads((folder / "metrics.json").read_text()) for folder in (run, softer)]
    assert status == 1
    assert "controller 'linear-band': rmse is" in err
    assert "controller 'conventional' is missing in B" in err
    change = next(x for x in diff(run, softer).changes if x.metric == "rmse")
    assert change.ratio.ratio == pytest.approx(change.b / change.a, rel=1e-12)
    assert change.ratio.ratio > 1.05
    assert f"x{change.ratio.ratio:.4g}" in out
    assert json.dumps(values[0]).count("linear-band") == 1
    assert command("diff", run, softer)[0] == 0  # nothing was named that must not be
    assert command("diff", softer, run, "--fail-if", "rmse > 1.05")[0] == 0  # the other way it is better


def test_another_arithmetic_is_told_and_an_unknown_one_is_not(command, run, tmp_path):
    """Both kinds of processor are named, by `diff` and on the page of both runs; a manifest of before tells nothing."""
    shutil.copytree(run, tmp_path / "other")
    path = tmp_path / "other" / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["machine"] |= {"arithmetic": "0" * 16, "processor": "x86_64, Elsewhere <b>"}
    write_manifest(path.parent, manifest)
    _, _, err = command("diff", run, path.parent)
    assert "B was made on another processor or C library than A (x86_64, Elsewhere <b>," in err
    assert command("report", run, path.parent, "--out", tmp_path / "both.html")[0] == 0
    page = (tmp_path / "both.html").read_text()
    assert "other was made on another processor or C library than" in page
    assert "Elsewhere &lt;b&gt;" in page
    manifest["machine"]["arithmetic"] = json.loads((run / "manifest.json").read_text())["machine"]["arithmetic"]
    manifest["machine"]["arrays"] = "0" * 16
    write_manifest(path.parent, manifest)
    assert len(diff(run, path.parent).remarks) == 1
    del manifest["machine"]["arithmetic"], manifest["machine"]["arrays"]
    write_manifest(path.parent, manifest)
    assert diff(run, path.parent).remarks == diff(run, run).remarks == ()


def test_mistakes_come_at_once_and_before_anything_is_read(command, tmp_path):
    """Every limit that is none is told with what was wanted; nothing is written."""
    limits = ("rms > 1.05", "rmse > 3 mrad", "rmse", "effort > -1")
    words = [word for limit in limits for word in ("--fail-if", limit)]
    status, _, err = command("diff", tmp_path / "no", tmp_path / "none", *words)
    assert status == 2
    assert err.count("--fail-if") == 4
    assert "did you mean 'rmse'?" in err
    status, _, err = command("diff", tmp_path / "no", tmp_path / "none")
    assert status == 2


def test_the_interval_decides_over_draws():
    """A limit is passed when all of the paired t-interval of ln B/A is beyond it, in scipy's figures; 1e-12."""
    rng = np.random.default_rng(4)
    a = np.exp(rng.normal(size=20))
    b = a * np.exp(0.1 + 0.1 * rng.normal(size=20))
    wanted = stats.ttest_rel(np.log(b), np.log(a)).confidence_interval(0.95)
    place, good = ("law", "payload=2"), [True] * 20
    sides = [{place: (good, {"rmse": x.tolist()})} for x in (a, b)]
    low, high = math.exp(wanted.low), math.exp(wanted.high)
    for limit, is_passed in ((0.999 * low, True), (1.001 * low, False)):
        found = _compared(*sides, [Limit("rmse", ">", limit)])
        assert bool(found.broken) == is_passed
    for limit, is_passed in ((1.001 * high, True), (0.999 * high, False)):
        assert bool(_compared(*sides, [Limit("rmse", "<", limit)]).broken) == is_passed
    ratio = found.changes[0].ratio
    assert (ratio.low, ratio.high) == pytest.approx((low, high), rel=1e-12)
    assert found.changes[0].b == pytest.approx(stats.gmean(b), rel=1e-12)
    assert _compared(*sides, [Limit("rmse", ">", 1.2)]).changes[0].needed == draws_needed(ratio, 1.2)
    assert _compared(*sides, []).changes[0].needed == draws_needed(ratio)


def test_what_fails_in_b_alone_passes_any_limit_and_is_no_ratio():
    """A run that failed is counted; a metric that was 0 and is not has no ratio, and cannot be judged in silence."""
    a = {("law", ""): ([True, True, True], {"rmse": [1.0, 1.0, 2.0], "chattering": [0.0, 0.0, 0.0]})}
    b = {("law", ""): ([True, False, True], {"rmse": [1.0, None, 2.0], "chattering": [0.0, None, 1.0]})}
    found = _compared(a, b, [Limit("rmse", ">", 1.5), Limit("chattering", ">", 1.5)])
    assert found.failed == ("controller 'law' fails in B only, in 1 of 3 draws (exact McNemar p = 1)",)
    assert found.ended[0].outcomes == (1, 0, 3, 1.0)
    assert found.broken == (*found.failed, "controller 'law': chattering has no ratio, and cannot be judged")
    assert [x.metric for x in found.changes] == ["rmse"]
    assert found.changes[0].ratio.pairs == 2
    assert _compared(b, a, [Limit("rmse", ">", 1.5)]).broken == ()
    assert _compared(b, a, []).mended == (
        "controller 'law' completes in B only, in 1 of 3 draws (exact McNemar p = 1)",
    )


def test_what_passes_a_limit_is_a_failure_of_junit(command, run, softer, tmp_path):
    """Each controller of A is a test; those with something in `broken` fail, with its words; without a limit none."""
    file = tmp_path / "found.xml"
    assert command("diff", run, softer, "--fail-if", "rmse > 1.05", "--junit", file)[0] == 1
    suite = ElementTree.parse(file).getroot()
    told = {test.get("name"): [failure.text for failure in test] for test in suite}
    assert told == {name: ["\n".join(texts)] for name, texts in diff(run, softer, ["rmse > 1.05"]).verdicts.items()}
    assert (suite.get("tests"), suite.get("failures")) == ("2", "2")
    suite = ElementTree.fromstring(diff(run, softer).junit())
    assert (suite.get("tests"), suite.get("failures")) == ("2", "0")


@pytest.mark.parametrize("text", ["rmse > 1.05", "rmse>=1.05", "effort < 0.9"])
def test_a_limit_is_read_and_written(text):
    """What is read is what was meant, and reads the same again."""
    limit = read_limit(text)
    assert read_limit(limit.text) == limit
    assert limit.text.replace(" ", "") == text.replace(" ", "")


def test_sweeps_are_compared_case_by_case_on_the_same_draws(tmp_path, command):
    """Each case has its row with an interval; another seed has other draws, and a run is no sweep: refused."""
    (tmp_path / "quick.yaml").write_text(QUICK)
    for name, seed in (("a", 7), ("other", 8)):
        changes = {"run.seed": seed, "model.mismatch": {"relative": 0.2}}
        run_sweep(
            tmp_path / "quick.yaml",
            changes=changes,
            grid={"controllers.linear-band.gains.phi": [0.2, 0.4]},
            draws=3,
            workers=1,
            folder=tmp_path / name,
        )
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    found = diff(tmp_path / "a", tmp_path / "b", ["rmse > 1.01"])
    assert found.broken == ()
    assert len({x.case for x in found.changes if x.controller == "linear-band"}) == 2
    assert {x.ratio.pairs for x in found.changes} == {3}
    with pytest.raises(ConfigError, match="other draws"):
        diff(tmp_path / "a", tmp_path / "other")
    status, _, err = command("diff", tmp_path / "a", tmp_path)
    assert status == 2
    assert "two of one kind" in err

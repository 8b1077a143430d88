"""A study from end to end: what is stored, shown and returned, and what moves a verdict."""

import json
import math
import re
import shutil

import numpy as np
import pytest

from tests.audit.studies import STUDY
from torquebench.audit.judge import judge_study
from torquebench.audit.run import Runs
from torquebench.audits import read_audit, run_audit
from torquebench.cli.app import main
from torquebench.errors import ConfigError, ResultError


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The small study, run once."""
    folder = tmp_path_factory.mktemp("audit")
    (folder / "study.yaml").write_text(STUDY)
    return run_audit(folder / "study.yaml", folder=folder / "out", workers=2)


def test_verdicts(done):
    """Each claim has the verdict that its cases give."""
    verdicts = {claim.key: str(claim.verdict) for claim in done.claims}
    assert verdicts["removes"] == "holds"
    assert verdicts["exact"] == "fails"
    assert verdicts["growth"] == "undecided"
    assert verdicts["knows"] == "depends"
    assert not done.moved


def test_figures_are_those_of_the_runs(done):
    """A ratio is that of the conditions' own tables, paired by draw."""
    case = next(case for case in done.claim("exact").cases)
    table = done.runs.tables[case.condition]
    of, over = (table["rmse"][table["controller"] == name] for name in ("band", "switching"))
    figure = case.figures[0]
    assert figure.interval.value == pytest.approx(math.exp(sum(map(math.log, of / over)) / len(of)), rel=1e-12)
    assert figure.interval.n == len(of)
    assert figure.of == pytest.approx(of.mean(), rel=1e-12)


def test_difference_to_another_condition(done):
    """The one run of a condition without draws stands for all draws of the other."""
    (case,) = done.claim("growth").cases
    wrong, nominal = (
        done.runs.values("rmse", "band", ("ideal", "wrong"), 9),
        done.runs.values("rmse", "band", ("ideal", "nominal"), 9),
    )
    assert len(nominal) == 1
    assert case.figures[0].interval.value == pytest.approx(sum(wrong) / len(wrong) - nominal[0], rel=1e-9)


def test_feedforward_knows_a_model_from_none(done):
    """A law with the exact model supplies all of the torque at zero error, one without a model nothing."""
    figures = {case.pair.label: case.figures[0].interval.value for case in done.claim("knows").cases}
    assert figures["band"] == pytest.approx(1.0, abs=1e-9)
    assert figures["PD"] == 0.0


def test_unlike_pairs_are_shown_and_not_judged(done):
    """They are in the files, and move no verdict."""
    claim = done.claim("removes")
    assert [case.pair.label for case in claim.shown] == ["a law without model"] * 4
    assert len(claim.cases) == 4
    assert [one.label for one in claim.ablations] == ["PD"]


def test_claims_json(done):
    """The file says what was claimed, measured and found, case by case."""
    claims = {claim["id"]: claim for claim in json.loads((done.folder / "claims.json").read_text())}
    claim = claims["removes"]
    assert claim["verdict"] == claim["expect"] == "holds"
    assert claim["quoted"] == "no switching is left"
    assert claims["exact"]["implied"] == "Fig 2"
    assert {case["verdict"] for case in claim["cases"]} <= {"holds", "undecided", "fails"}
    assert {figure["n"] for case in claim["cases"] for figure in case["figures"]} == {1, 3}
    assert claims["reaches"]["vacuous"] == 0
    assert {case["command"] for case in claim["cases"]} >= {"torquebench sweep conditions/03-fast/sweep.yaml"}
    fields = {"claim", "where", "verdict", "figure", "interval", "condition", "ablation", "measure", "quoted", "expect"}
    fields |= {"config", "overrides", "command"}
    assert claim["config"] == "conditions/01-ideal/sweep.yaml"
    assert all(fields <= found.keys() for found in claims.values())
    assert claim["ablation"].startswith(("as well somewhere: PD", "nothing tried does as well; worse: PD"))


def test_the_command_of_a_row_runs_it_again(done, tmp_path, capsys):
    """The condition's config is there as a file, and gives the same table."""
    config = done.folder / "conditions" / "03-fast" / "sweep.yaml"
    assert main(["sweep", str(config), "--out", str(tmp_path / "again"), "-q"]) == 0
    assert (tmp_path / "again" / "results.csv").read_bytes() == (config.parent / "results.csv").read_bytes()


def test_same_bytes_whoever_runs_it_and_when(done, tmp_path):
    """Another number of workers, and an audit that goes on where it was cut off, write the same claims."""
    other = tmp_path / "out"
    shutil.copytree(done.folder, other)
    (other / "manifest.json").unlink()
    (other / "claims.json").unlink()
    shutil.rmtree(other / "conditions" / "03-fast")
    run_audit(done.folder.parent / "study.yaml", folder=other, workers=1, figures=False)
    assert (other / "claims.json").read_bytes() == (done.folder / "claims.json").read_bytes()


def test_another_study_does_not_go_on_there(done, tmp_path):
    """A folder with the runs of another study is refused, and left as it is."""
    (tmp_path / "study.yaml").write_text(STUDY.replace("seed: 3", "seed: 4"))
    with pytest.raises(ConfigError, match="holds an audit of other runs"):
        run_audit(tmp_path / "study.yaml", folder=done.folder)
    assert (done.folder / "manifest.json").is_file()


def test_exchanged_laws_turn_the_verdict(done, tmp_path):
    """With the two laws' names exchanged the claim fails, the exit status is 1, and the claim is named."""
    text = (
        STUDY.replace("name: switching", "name: x")
        .replace("name: band", "name: switching")
        .replace("name: x", "name: band")
    )
    (tmp_path / "study.yaml").write_text(text)
    found = run_audit(tmp_path / "study.yaml", folder=tmp_path / "out", figures=False)
    assert str(found.claim("removes").verdict) == "fails"
    assert "removes" in [claim.key for claim in found.moved]


def test_command(done, tmp_path, capsys):
    """Verdict, dots and a sentence for each claim; status 0 while verdicts are those expected, 1 by --fail-if."""
    out = tmp_path / "out"
    shutil.copytree(done.folder, out)
    study = str(done.folder.parent / "study.yaml")
    assert main(["audit", study, "--out", str(out), "--no-figures"]) == 0
    said = capsys.readouterr().out
    assert "●●" in said
    assert "HOLDS" in said
    assert "A. Author, A band, Journal 1, 1-9, 1999" in said
    assert main(["audit", study, "--out", str(out), "--no-figures", "--fail-if", "exact=fails"]) == 1
    assert "claim 'exact': fails (--fail-if exact=fails)" in capsys.readouterr().err
    moved = ["audit", study, "--out", str(out), "--no-figures", "--set", "audit.claims.exact.expect=holds"]
    assert main(moved) == 1
    assert "claim 'exact': fails, the study expects holds" in capsys.readouterr().err
    assert main(["audit", study, "--out", str(out), "--fail-if", "exakt=fails", "--no-figures"]) == 2
    assert "did you mean 'exact'" in capsys.readouterr().err
    assert main(["audit", study, "--out", str(out), "--fail-if", "exact=fail"]) == 2
    assert "did you mean 'fails'" in capsys.readouterr().err


def test_one_draw_of_something_random_decides_nothing(tmp_path):
    """It has no spread; a law without certificates has no case, and the claim is undecided. Both are drawn and told."""
    text = STUDY.replace("pairs: {switching: switching}", "pairs: {pd: pd}")
    (tmp_path / "study.yaml").write_text(text)
    found = run_audit(tmp_path / "study.yaml", folder=tmp_path / "out", draws=1)
    case = next(case for case in found.claim("removes").cases if case.condition == ("fast", "nominal"))
    assert [str(one.verdict) for one in case.figures] == ["undecided", "undecided"]
    assert not found.claim("reaches").cases
    assert str(found.claim("reaches").verdict) == "undecided"
    assert "nothing is certified" in found.claim("reaches").sentence
    assert (found.folder / "claims.md").read_text().count("nan") == 0


def test_a_run_that_failed_speaks_against_its_law(done):
    """Whatever the figure: also one that does not come from the run."""
    tables = {
        condition: dict(table) | {"failed_at": np.where(table["controller"] == "band", 5.0, table["failed_at"])}
        for condition, table in done.runs.tables.items()
    }
    runs = Runs(done.runs.experiments, tables)
    assert runs.values("rmse", "band", ("ideal", "wrong"), 2) == [None, None]
    claims = {claim.key: claim for claim in judge_study(done.study, runs)}
    assert str(claims["removes"].verdict) == "fails"
    assert {case.pair.label: str(case.verdict) for case in claims["knows"].cases} == {"band": "fails", "PD": "fails"}


def test_page(done):
    """The page stands alone, has every claim, and the command of each case."""
    page = (done.folder / "report.html").read_text()
    assert "default-src 'none'" in page
    assert all(claim.claim.says in page for claim in done.claims)
    assert "conditions/03-fast/sweep.yaml" in page
    assert page.count("<figure>") >= 6


def test_from_python(done):
    """A frame with a row for each figure, a figure, and a notebook's view."""
    frame = done.to_dataframe()
    assert len(frame) == sum(len(case.figures) for claim in done.claims for case in (*claim.cases, *claim.shown))
    assert set(frame["verdict"]) <= {"holds", "fails", "undecided"}
    assert done.figure().axes
    assert done.figure("removes", 1).axes
    assert "2 fails" in repr(done) or "holds" in repr(done)
    assert "<table>" in done._repr_html_()
    with pytest.raises(ResultError, match="did you mean 'exact'"):
        done.claim("exat")


def test_figures_are_drawn_again_from_the_folder(done, tmp_path):
    """The same names and bytes as the audit left, as PNG too; by width for a paper; an unknown name is refused."""
    folder = tmp_path / "copy"
    shutil.copytree(done.folder, folder)
    left = {file.name: file.read_bytes() for file in (folder / "figures").iterdir()}
    assert main(["figures", str(folder), "--workers", "1"]) == 0
    for name, content in left.items():
        assert (folder / "figures" / name).read_bytes() == content
        assert (folder / "figures" / name).with_suffix(".png").is_file()
    assert main(["figures", str(folder), "--only", "claims", "--for", "paper", "--pdf"]) == 0
    for width in (85.0, 180.0):
        text = (folder / f"figures/claims-{width:g}mm.svg").read_text()
        points = float(re.search(r'<svg[^>]* width="([0-9.]+)pt"', text)[1])
        assert points / 72.0 * 25.4 == pytest.approx(width, abs=0.1)
    assert main(["figures", str(folder), "--only", "clams"]) == 2


def test_an_audit_is_read_as_it_was_made(done):
    """Every claim has the same verdict, sentence and figures."""
    again = read_audit(done.folder)
    assert [claim.to_json({}) for claim in again.claims] == [claim.to_json({}) for claim in done.claims]

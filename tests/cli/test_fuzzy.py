"""``torquebench fuzzy``, and what ``run`` says and draws of the fuzzy systems its controllers use."""

import json
import re

import pytest

from torquebench.experiment.store import check_run
from torquebench.fuzzy import oracle
from torquebench.registry import restored
from torquebench.robot.library import data_root

CONFIG = """\
name: small
plant: {engine: analytic, model: two-link}
controllers:
  - {name: plain, law: pd, gains: {lam: 10, kv: 20}}
  - name: proposed
    law: fuzzy-linear-band-smc
    gains: {lam: 10, k: 0.3, phi: 0.3, kv: 20, kf: 0.3, gd: 1, ki: 100}
  - name: odd
    law: fuzzy-linear-band-smc
    fuzzy: lopsided
    gains: {lam: 10, k: 0.3, phi: 0.3, kv: 20, kf: 0.3, gd: 1, ki: 100}
fuzzy:
  lopsided:
    kind: mamdani
    inputs:
      - terms: {N: -1, Z: 0.1, P: 1}
      - terms: {N: -1, Z: 0, P: 1}
    output: {terms: {N: -1, Z: 0, P: 1}}
    rules: [[N, N, Z], [N, Z, P], [Z, P, none]]
reference: {kind: sine, amplitude: 0.5, frequency_hz: 1.0}
run: {duration: 0.6, metrics_from: 0.1}
"""


@pytest.fixture
def small(tmp_path, monkeypatch):
    """Path of a small experiment with fuzzy laws, in a folder that is also the current one."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "small.yaml"
    path.write_text(CONFIG)
    return path


@pytest.fixture
def undrawn(monkeypatch):
    """Draw no page of a system: what is said of it is looked at."""
    monkeypatch.setattr("torquebench.report.figures.fuzzy.system_figures", lambda *_: {})


def test_run_draws_and_describes_the_systems_in_use(small, command):
    """Each controller's rules where they are asked for; method, bound and warnings in terminal and manifest."""
    status, out, err = command("run", small, "--out", "result", "--set", "figures=[rules]")
    assert (status, err) == (0, "")
    manifest = check_run(small.parent / "result")
    drawn = {name for name in manifest["files"] if name.startswith("figures/")}
    assert drawn == {f"figures/rules-{name}.{fmt}" for name in ("proposed", "odd") for fmt in ("svg", "png")}
    assert manifest["fuzzy"]["pd-49"] == {"method": "exact (closed form, stairs)", "error_bound": 0.0}
    assert manifest["fuzzy"]["lopsided"]["method"].startswith("table of ")
    assert 0.0 < manifest["fuzzy"]["lopsided"]["error_bound"]
    for line in (
        "fuzzy system pd-49: exact (closed form, stairs)",
        "fuzzy system lopsided: table of ",
        "fuzzy system lopsided: warning: rules: no rule for P and P",
    ):
        assert line in out


def test_the_resolved_experiment_repeats_the_run(small, command):
    """The stored experiment.yaml holds the fuzzy systems and gives the same trajectories."""
    command("run", small, "--out", "first", "--no-figures")
    command("run", "first/experiment.yaml", "--out", "second", "--no-figures")
    manifests = [check_run(small.parent / name) for name in ("first", "second")]
    assert manifests[0]["files"] == manifests[1]["files"]


def test_a_built_in_system(tmp_path, monkeypatch, command):
    """Its name alone is enough; by default the figures go to a folder of its own."""
    monkeypatch.chdir(tmp_path)
    status, out, err = command("fuzzy", "pd-9")
    assert (status, err) == (0, "")
    assert "fuzzy system pd-9: 9 rules on 3 x 3 terms" in out
    assert "evaluated: exact (closed form, stairs)\nlint:\n  nothing to remark" in out
    (folder,) = (tmp_path / "runs").glob("fuzzy-pd-9-*")
    pages = ("membership", "surface", "scaling")
    assert {p.name for p in folder.iterdir()} == {f"pd-9-{page}.{fmt}" for page in pages for fmt in ("svg", "png")}


def test_the_systems_of_a_file(small, command, undrawn):
    """All of them, its own first; bound and lint are printed."""
    status, out, _ = command("fuzzy", small, "--out", "all")
    assert status == 0
    assert out.index("fuzzy system lopsided") < out.index("fuzzy system pd-49")
    assert "error at most 0." in out
    assert "asymmetric" in out


def test_one_system_of_a_file(small, command):
    """The one that is named is described and drawn, and no other."""
    status, out, _ = command("fuzzy", small, "--name", "pd-49", "--out", "one")
    assert status == 0
    assert "lopsided" not in out
    assert len(list((small.parent / "one").iterdir())) == 6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["pd-94"], "pd-94: does not exist (did you mean 'pd-9'?)"),
        (["missing.yaml"], "missing.yaml: does not exist"),
        (["small.yaml", "--name", "lopsid"], "--name: lopsid: no such fuzzy system in small.yaml (did you"),
        (["pd-9", "--name", "pd-25"], "--name: pd-25: goes with a config file; pd-9 is built in"),
        (["plain.yaml"], "plain.yaml: fuzzy: there is no fuzzy system in it, and no controller uses one"),
        (["broken.yaml"], "broken.yaml:19:31: fuzzy.lopsided.rules[1][2]: unknown consequent 'Q' (one of: N, Z, P)"),
        (["small.yaml", "--out", "taken"], "taken is not empty"),
    ],
)
def test_bad_input(small, command, arguments, message):
    """Exit status 2, one line that says what was wanted, nothing written."""
    folder = small.parent
    (folder / "plain.yaml").write_text((data_root() / "configs" / "two-link.yaml").read_text())
    (folder / "broken.yaml").write_text(CONFIG.replace("[N, Z, P]", "[N, Z, Q]"))
    (folder / "taken").mkdir()
    (folder / "taken" / "file").write_text("")
    before = sorted(folder.rglob("*"))
    status, out, err = command("fuzzy", *arguments)
    assert (status, out) == (2, "")
    assert message in err
    assert sorted(folder.rglob("*")) == before


def test_metrics_of_fuzzy_laws_are_there(small, command):
    """The laws follow the motion: the proposed one better than the PD law without gravity compensation."""
    command("run", small, "--out", "result", "--no-figures")
    metrics = json.loads((small.parent / "result" / "metrics.json").read_text())["controllers"]
    assert metrics["proposed"]["rmse"]["value"] < 0.1 * metrics["plain"]["rmse"]["value"]


LAW = """\
\"\"\"Nothing but rules.\"\"\"

from typing import Annotated, NamedTuple
from torquebench import Array, Fis, Gain, Rules, controller, infer


class Gains(NamedTuple):
    ge: Annotated[Array, Gain("error that counts as 1", "rad")]
    gd: Annotated[Array, Gain("its rate that counts as 1", "rad/s")]
    fis: Annotated[Fis, Rules("torque over its limit")]


@controller("rules-only", gains=Gains)
def rules_only(gains, model, t, q, qd, ref, memory, tau):
    \"\"\"tau = tau_max FIS(e/ge, de/gd).\"\"\"
    for i in range(len(tau)):
        e, de = ref.q[i] - q[i], ref.qd[i] - qd[i]
        tau[i] = model.tau_max[i] * infer(gains.fis, e / gains.ge[i], de / gains.gd[i])
"""


def test_a_law_of_ones_own_with_a_fuzzy_system(small, command, undrawn):
    """A plug-in declares a field of type `Fis`, the config chooses its system; without scaling, no page of rules."""
    (small.parent / "mine.py").write_text(LAW)
    small.write_text(
        CONFIG.replace(
            "  - {name: plain, law: pd, gains: {lam: 10, kv: 20}}\n",
            ("  - {name: mine, law: rules-only, gains: {ge: 0.05, gd: 0.5}, fuzzy: pd-9}\n"),
        )
    )
    with restored():
        status, out, _ = command(
            "run", small, "--plugin", "mine.py", "--out", "result", "--set", "figures=[torque, rules]"
        )
    assert status == 0
    assert "fuzzy system pd-9: exact" in out
    files = check_run(small.parent / "result")["files"]
    assert "figures/torque.svg" in files
    assert "figures/rules-mine.svg" not in files
    metrics = json.loads((small.parent / "result" / "metrics.json").read_text())["controllers"]
    assert metrics["mine"]["rmse"]["value"] < 0.05
    with restored():
        status, out, _ = command("fuzzy", small, "--plugin", "mine.py", "--name", "pd-9", "--out", "described")
    assert (status, "fuzzy system pd-9" in out) == (0, True)


def test_the_oracle_is_asked(tmp_path, command, monkeypatch, undrawn):
    """Status 0, the largest difference with its place, the grid and what bounds it; the same as data."""
    monkeypatch.chdir(tmp_path)
    status, out, err = command("fuzzy", "s-7", "--oracle")
    assert (status, err) == (0, "")
    found = re.search(
        r"^s-7 beside skfuzzy\.control on 32 inputs: largest difference (\S+), at \((\S+)\), (.*)$", out, re.M
    )
    assert found
    assert 0.0 < float(found[1]) < 1e-3
    assert found[3].startswith("within its bound (steps of scikit-fuzzy's universe at most ")
    status, out, _ = command("fuzzy", "s-7", "--oracle", "--json")
    assert json.loads(out)["systems"]["s-7"]["oracle"]["within"] is True


def test_a_difference_above_the_bound_is_a_failure(tmp_path, command, monkeypatch, undrawn):
    """Status 1, and the word ABOVE."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(oracle, "scikit_fuzzy", lambda system, x, y: (oracle.CONTROL, x))
    status, out, _ = command("fuzzy", "s-7", "--oracle")
    assert status == 1
    assert "ABOVE its bound" in out

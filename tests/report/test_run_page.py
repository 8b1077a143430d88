"""The page of a run: its answer is the stored numbers', its signals are the samples, no text of it is ever code."""

import base64
import dataclasses
import itertools
import json
import re

import numpy as np
import pytest

from torquebench.experiment import load_experiment
from torquebench.experiment.build import build
from torquebench.experiment.run import run_experiment
from torquebench.metrics import Metric, Metrics
from torquebench.report import replay
from torquebench.report.answer import answer, times
from torquebench.report.compare_page import comparison_page
from torquebench.report.render import data_text, script
from torquebench.report.replay import BLOCK, packed, replay_data, thinned
from torquebench.report.run_page import controller_rows, heat_rows, number_cells, run_page
from torquebench.sim.trajectory import SIGNALS, Outcome

CONFIG = """\
name: page-test
plant: {engine: mujoco, model: two-link}
controllers:
  - {name: conventional, law: smc, switching: sign, gains: {lam: 10, k: 0.3}}
  - {name: band, law: linear-band-smc, gains: {lam: 10, k: 0.3, phi: 0.3, kv: 20}}
  - {name: pd, law: pd, gains: {lam: 5, kv: 20}}
reference: {kind: sine, amplitude: [0.5, 0.4], frequency_hz: [0.5, 0.7]}
run: {duration: 0.9, metrics_from: 0.2}
"""


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """Three controllers on two joints, 0.9 s."""
    path = tmp_path_factory.mktemp("page") / "page.yaml"
    path.write_text(CONFIG)
    experiment = load_experiment(path)
    return run_experiment(experiment, build(experiment))


def with_metrics(result, **changed):
    """The run with other headline values: metric=(conventional, band, pd); None is a failed controller's."""
    metrics = {}
    for i, (name, own) in enumerate(result.metrics.items()):
        values = {key: column[i] for key, column in changed.items()}
        if None not in values.values():
            new = {key: Metric(value, (value, 2 * value), 2) for key, value in values.items()}
            metrics[name] = Metrics({**{info.key: metric for info, metric in own.items()}, **new})
    return dataclasses.replace(result, metrics=metrics)


def plain(markup):
    """The text of an answer."""
    return re.sub("<[^>]*>", "", str(markup))


def test_the_answer_names_best_calmest_and_costs(result):
    """Who follows best, who chatters least and most, and what each pays for the other, from the metrics alone."""
    run = with_metrics(result, rmse=(1e-3, 4e-3, 2e-3), chattering=(30.0, 1.5, 6.0), effort=(0.4, 0.1, 0.2))
    assert plain(answer(run)) == (
        "conventional follows best: RMS error 1 mrad; band worst, 4 mrad. "
        "band chatters least (1.5 %), conventional chatters most (30 % of the torque limit). "
        "Following best costs 20 times the chattering and 4 times the torque effort of band, "
        "which has 4 times the error."
    )


def test_the_answer_when_the_best_does_not_chatter(result):
    """Below 0.1 % of the limit nobody is said to chatter; a failed controller is named, and nothing of it is ranked."""
    run = with_metrics(result, rmse=(3e-3, 1e-3, None), chattering=(30.0, 4e-4, None), effort=(0.4, 0.1, None))
    short = {name: getattr(run.runs["pd"], name)[:313].copy() for name in ("t", *SIGNALS)}
    failed = dataclasses.replace(run.runs["pd"], **short, outcome=Outcome.DIVERGED, failed_at=312, extra={})
    run = dataclasses.replace(run, runs={**run.runs, "pd": failed})
    assert plain(answer(run)) == (
        "band follows best: RMS error 1 mrad; conventional worst, 3 mrad. "
        "band does not chatter (below 0.1 %), conventional chatters most (30 % of the torque limit). "
        "band takes 25 % of the torque effort of conventional. pd failed: diverged at 0.312 s."
    )
    quiet = with_metrics(result, rmse=(3e-3, 1e-3, 2e-3), chattering=(0.02, 4e-4, 0.01), effort=(0.4, 0.1, 0.2))
    assert "None chatters: at most 0.02 % of the torque limit." in plain(answer(quiet))


def test_nobody_is_best_of_equals(result):
    """Laws whose numbers read the same are told together, none of them as better or worse than another."""
    two = with_metrics(result, rmse=(1e-3, 1e-3, 2e-3), chattering=(30.0, 30.0, 6.0))
    text = plain(answer(two))
    assert text.startswith("conventional and band follow best: RMS error 1 mrad; pd worst, 2 mrad. ")
    assert "pd chatters least (6 %), conventional and band chatter most (30 % of the torque limit)." in text
    same = plain(answer(with_metrics(result, rmse=(1e-3,) * 3, chattering=(30.0,) * 3, effort=(0.1,) * 3)))
    assert same == "All follow alike: RMS error 1 mrad. All chatter alike: 30 % of the torque limit."


def test_heat_beside_an_error_of_zero(result):
    """Where a law does not err at all, every law that does is hottest in that joint, and is not told as the least."""
    run = with_metrics(result, rmse=(0.0, 1e-3, 2e-3))
    metrics = {
        name: Metrics({info.key: dataclasses.replace(one, per_joint=(one.value,) * 2) for info, one in own.items()})
        for name, own in run.metrics.items()
    }
    rows = {row["name"]: row["cells"] for row in heat_rows(dataclasses.replace(run, metrics=metrics))}
    assert [cell[2] for cell in rows["conventional"]] == [0.0, 0.0]
    assert [cell[2:] for cell in rows["band"]] == [(1.0, "the least is 0")] * 2


@pytest.mark.parametrize(("asked", "shares", "told"), [(9.0, 0.5, True), (9.0, 0.01, False), (0.5, 0.5, False)])
def test_a_motion_that_the_arm_cannot_do_has_no_winner(result, tmp_path, asked, shares, told):
    """Too much torque asked for and the best law at its limit: that is said first, nobody is best; one alone is not it.

    At 9 times its frequency a sine takes 81 times the torque of inertia; saturation is put in by hand.
    """
    (tmp_path / "page.yaml").write_text(CONFIG.replace("[0.5, 0.7]", f"[{0.5 * asked}, {0.7 * asked}]"))
    experiment = load_experiment(tmp_path / "page.yaml")
    run = dataclasses.replace(result, built=None, experiment=experiment)
    values = {"rmse": (1e-3, 4e-3, 2e-3), "saturation_fraction": (shares / 2, 1.0, 1.0)}
    run = with_metrics(run, **values)
    text, marked = plain(answer(run)), [c.kind for row in controller_rows(run) for c in row["cells"]]
    joint = "The motion cannot be done: the reference needs more torque than the arm has: shoulder "
    assert (text.startswith(joint) and "; no law is better here." in text) == told
    assert ("follows best" in text) == ("best" in marked) == (not told)
    assert ('class="answer shaky"' in run_page(run).decode()) >= told


def test_a_page_of_which_all_controllers_shake_is_marked_and_asks_why(result):
    """The answer is marked only where none is still; the command that says why is there where one shakes."""
    one, all_of_them, none = (
        run_page(with_metrics(result, chattering=values)).decode()
        for values in ((30.0, 0.01, 0.01), (30.0, 1.5, 6.0), (0.01, 0.02, 0.01))
    )
    assert ["answer shaky" in page for page in (one, all_of_them, none)] == [False, True, False]
    assert ["torquebench why RUN" in page for page in (one, all_of_them, none)] == [True, True, False]


def test_a_joint_that_chatters_alone_is_named(result):
    """Quiet in the mean of the joints and not in one of them: said with the joint, here twice the mean."""
    told = plain(answer(with_metrics(result, rmse=(3e-3, 1e-3, 2e-3), chattering=(30.0, 0.06, 0.04))))
    assert "pd and band do not chatter" in told
    assert f"band has 0.12 % in {result.joints.names[1]} alone." in told
    assert "pd has" not in told


def test_the_answer_names_all_that_chatter_where_they_are_few(result):
    """More than four that do not are counted; who does beside the loudest is named; up to four quiet ones tell it."""
    metrics = dict(zip("abcdefg", itertools.cycle(result.metrics.values()), strict=False))
    many = dataclasses.replace(result, metrics=metrics)
    loud = with_metrics(many, chattering=(4e-4, 4e-4, 4e-4, 4e-4, 4e-4, 9.0, 30.0))
    assert "5 of 7 do not chatter (below 0.1 %), g chatters most (30 % of the torque limit). f chatters too." in plain(
        answer(loud)
    )
    assert "too." not in plain(answer(with_metrics(many, chattering=(4e-4, 4e-4, 4e-4, 4e-4, 2.0, 9.0, 30.0))))


def test_ratios_are_written_as_they_are_said():
    """Two digits below ten, whole numbers above, shares in per cent."""
    assert [times(a, b) for a, b in ((87.4, 1), (2.34, 1), (0.25, 1), (12345.0, 1), (1.0, 0.0))] == [
        "87 times",
        "2.3 times",
        "25 % of",
        "12,300 times",
        "many times",
    ]


def test_rows_go_by_error_and_the_best_is_marked(result):
    """Ascending RMS error; of each column the least is marked, of saturation, all zero, none."""
    rows = controller_rows(result)
    errors = [row["cells"][0].value for row in rows]
    assert errors == sorted(errors)
    assert [row["name"] for row in rows] == sorted(result.metrics, key=lambda name: result.metrics[name]["rmse"].value)
    for column in zip(*(row["cells"] for row in rows), strict=True):
        best = [cell.value for cell in column if cell.kind == "best"]
        known = [cell.value for cell in column if cell.value is not None]
        assert not best or (min(known) in best and max(known) not in best)
    assert all(row["cells"][-1].kind == "" for row in rows)
    assert rows[0]["cells"][0].kind == "best"


def test_a_small_number_is_told_as_it_is():
    """Four digits of each, however small: the table says what the terminal and the answer say."""
    cells = number_cells([0.04148, 602.1, 500.0, 2.676e-4, 1.2541e-5, 0.0, None])
    assert [cell.text for cell in cells] == ["0.04148", "602.1", "500", "0.0002676", "1.254e-05", "0", "-"]


@pytest.mark.parametrize(("effort", "told"), [(0.104, False), (0.096, False), (0.106, True), (0.094, True)])
def test_an_effort_that_is_the_same_is_worth_no_word(result, effort, told):
    """Between 0.95 and 1.05 times the other's the torque effort is left out, beside chattering and by itself."""
    columns = {"rmse": (1e-3, 4e-3, 2e-3), "effort": (effort, 0.1, 0.1)}
    loud = plain(answer(with_metrics(result, chattering=(30.0, 1.5, 6.0), **columns)))
    assert ("the torque effort of band" in loud) == told
    assert "Following best costs 20 times the chattering" in loud
    assert ("torque effort" in plain(answer(with_metrics(result, chattering=(0.01, 0.02, 0.03), **columns)))) == told


def test_heat_names_joints_by_what_tells_them_apart(result):
    """The table of joints leaves out what all names begin and end with, and has the whole name under the pointer."""
    joints = result.joints._replace(names=("robot0:pan_joint", "robot0:lift_joint"))
    page = run_page(dataclasses.replace(result, joints=joints)).decode()
    assert '<th class="number" title="robot0:pan_joint">pan</th>' in page


def test_heat_is_the_ratio_to_the_best_of_the_joint(result):
    """0 at the least error of each joint, 1 at the largest ratio, the logarithm between."""
    rows = {row["name"]: [cell[2] for cell in row["cells"]] for row in heat_rows(result)}
    table = np.array([result.metrics[name]["rmse"].per_joint for name in rows])
    ratio = np.log(table / table.min(axis=0))
    assert np.max(np.abs(np.array(list(rows.values())) - ratio / ratio.max())) <= 5e-4  # three decimals


def unpacked(signal, samples, n):
    """What the page's script makes of a packed signal, by its own words: integers times the scale of their block."""
    values = np.frombuffer(base64.b64decode(signal["values"]), "<i2").reshape(n, samples).astype(float)
    scale = np.frombuffer(base64.b64decode(signal["scale"]), "<f4").reshape(n, -1).astype(float)
    values[values == -32768] = np.nan
    return (values * np.repeat(scale, signal["block"], axis=1)[:, :samples]).T


def test_joints_that_give_show_by_how_much(tmp_path):
    """The page has motor less link as a signal, the samples to 16 bits; of joints that are rigid by word it has not."""
    path = tmp_path / "page.yaml"
    path.write_text(CONFIG)
    for word, gives in (("{stiffness: 300, damping: 1}", True), ("rigid", False)):
        run = run_experiment(load_experiment(path, [f"plant.transmission={word}"]))
        page, own = run_page(run).decode(), run.runs["pd"]
        assert ('value="deflection"' in page) == gives
        shown = replay_data(run, dict.fromkeys(run.runs, "#000000"))["controllers"][2]
        assert (shown["deflection"] is not None) == gives
        assert ("transmission" in run.experiment.to_dict()["plant"]) == gives
        if gives:
            wound = own.motor_q - own.q
            assert unpacked(shown["deflection"], 900, 2) == pytest.approx(wound, abs=2e-5 * np.max(np.abs(wound)))


def test_signals_are_the_samples(result):
    """Each within 2e-5 of the largest in its block of 128 samples: half a step of 1 / 32766, and float32."""
    data = replay_data(result, dict.fromkeys(result.runs, "#000000"))
    assert (data["every"], data["samples"], data["period"]) == (1, 900, 0.001)
    for shown in data["controllers"]:
        run = result.runs[shown["name"]]
        for key, wanted in (("error", run.q_ref - run.q), ("torque", run.tau), ("sliding", run.s)):
            if shown[key] is None:
                assert not np.isfinite(wanted).any()
                continue
            found = unpacked(shown[key], 900, 2)
            for k in range(0, 900, BLOCK):
                block = slice(k, k + BLOCK)
                most = np.nanmax(np.abs(wanted[block]), axis=0)
                assert np.all(np.abs(found[block] - wanted[block]) <= 2e-5 * most)


def test_what_is_no_number_stays_none():
    """NaN is a gap; infinities and huge numbers are large, and do not spoil other blocks."""
    signal = np.ones((300, 1))
    signal[5], signal[200], signal[201] = np.nan, np.inf, 1e200
    found = unpacked(packed(signal), 300, 1)[:, 0]
    assert np.array_equal(np.isnan(found), np.isnan(signal[:, 0]))
    assert np.all(np.abs(found[:128][~np.isnan(found[:128])] - 1.0) < 2e-5)
    assert found[200] > 1e29


def test_thinned_the_range_of_each_stretch_is_kept():
    """Of each six samples the least and the greatest, in order: a torque that switches each sample still does."""
    signal = np.arange(60.0)[:, None] * np.array([1.0, -1.0]) * np.where(np.arange(60) % 2, 1.0, -1.0)[:, None]
    found = thinned(signal, 3)
    assert found.shape == (20, 2)
    for k in range(10):
        stretch = signal[6 * k : 6 * k + 6]
        assert np.array_equal(
            np.sort(found[2 * k : 2 * k + 2], axis=0), np.sort([stretch.min(0), stretch.max(0)], axis=0)
        )


def test_a_long_run_is_thinned_and_says_so(result, monkeypatch):
    """With more values than the page takes, its script gets fewer samples, further apart, and the page tells it."""
    monkeypatch.setattr(replay, "MOST_VALUES", 9 * 2 * 900 // 3)
    page = run_page(result).decode()
    data = json.loads(re.search(r'id="data">(.*?)</script>', page)[1])
    assert (data["every"], data["samples"]) == (3, 300)
    assert "every 3 samples by their least and greatest" in page


def test_the_same_run_gives_the_same_page(result):
    """Byte for byte, and with a film another; figures of the folder are linked."""
    assert run_page(result) == run_page(result) != run_page(result, b"film")
    assert b'href="figures/torque.svg"' in run_page(result, figures=["figures/torque.svg"])


def test_every_script_is_named_in_the_policy(result):
    """Its digests are those of the scripts on the page, in order; nothing else may run or be fetched."""
    page = run_page(result).decode()
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1]
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    assert re.findall(r"'sha256-([^']*)'", policy) == [
        script(name).digest for name in ("libraries/uplot", "libraries/three", "page", "run")
    ]
    assert scripts == [script(name).text for name in ("libraries/uplot", "libraries/three", "page", "run")]
    assert policy.startswith("default-src 'none'")
    assert "unsafe-inline" not in policy.partition("script-src")[2]


def test_data_cannot_end_their_element():
    """No character of HTML is left in them, and JSON reads the same values."""
    data = {"</script><!--": "<script>alert(1)</script>&amp;\u2028"}
    text = data_text(data)
    assert not set("<>&") & set(text)
    assert json.loads(text) == data


def test_two_runs_have_ratios_to_the_first(result):
    """An error twice as large is x2 and bad; a controller of one run alone is listed; equal ones have x1."""
    name = "conventional"
    metrics = dict(result.metrics)
    worse = dataclasses.replace(metrics[name]["rmse"], value=2 * metrics[name]["rmse"].value)
    metrics[name] = Metrics({**{info.key: metric for info, metric in metrics[name].items()}, "rmse": worse})
    keys = [keys for keys in result.experiment.controllers if keys.name != "pd"]
    other = dataclasses.replace(
        result, metrics=metrics, experiment=dataclasses.replace(result.experiment, controllers=tuple(keys))
    )
    page = comparison_page({"one": result, "two": other}).decode()
    assert re.search(r'<td class="number fails" data-value="2(\.0)?">x2</td>', page)
    assert "Only in one: pd." in page
    assert "RMSE of <b>conventional</b> in <b>two</b> is 2 times that in <b>one</b>" in page

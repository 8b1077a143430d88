"""Falsification: the search, what it may change, what it stores, and what it refuses."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import torquebench
from tests.experiment.examples import FALSIFY, GOOD
from torquebench.cli.app import main
from torquebench.cli.falsify import BARS, bars
from torquebench.disturbances import Pulses
from torquebench.errors import ConfigError
from torquebench.experiment.falsify_section import Claim, read_claim
from torquebench.falsification import space_of
from torquebench.metrics import METRICS
from torquebench.shipped import how_to_install
from torquebench.sweep.search import COMPARED, METHODS, Method, Search, check_method, shrink, start_search

ARM: dict[str, Any] = {
    "name": "arm",
    "plant": {"engine": "analytic", "model": "two-link", "timestep": 0.001},
    "controllers": [{"name": "pd", "law": "computed-torque", "gains": {"lam": 5, "kv": 10, "ki": 0}}],
    "reference": {"kind": "sine", "amplitude": [0.5, -0.4], "frequency_hz": [0.5, 0.7]},
    "run": {"duration": 0.6, "control_period": 0.002, "metrics_from": 0.0},
}
"""An experiment that takes a millisecond."""


PULSES = "disturbances[0].levels"


def config(**section: Any) -> dict[str, Any]:
    """Return the experiment with a section ``falsify``."""
    bias = [{"kind": "bias", "value": [0.0, 0.0]}]
    return {**ARM, "disturbances": bias, "falsify": {"evaluations": 40, **section}}


def maximise(search: Search, function: Any) -> tuple[float, int]:
    """Return the highest value that a search finds, and how many points it asked for."""
    best, count, points = -math.inf, 0, next(search, None)
    while points:
        values = [function(np.array(point)) for point in points]
        best, count = max(best, *values), count + len(values)
        try:
            points = search.send(values)
        except StopIteration:
            break
    return best, count


@pytest.mark.parametrize("dimensions", [1, 5])
def test_cma_finds_the_top_of_a_paraboloid(dimensions: int) -> None:
    """The known maximum 0 at 0.8 of each side is found to 1e-8, far below what as many random points can."""
    best, _ = maximise(start_search("cma", [dimensions], 800, 3), lambda x: -float(((x - 0.8) ** 2).sum()))
    assert -1e-8 < best <= 0.0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("evaluations", [1, 7, 100])
def test_a_search_keeps_to_its_budget(method: Method, evaluations: int) -> None:
    """So many points are asked for as are allowed, be it less than a generation or after one that has converged."""
    assert maximise(start_search(method, [3], evaluations, 0), lambda x: 0.0)[1] == evaluations


@pytest.mark.parametrize("method", ["cma", "corners"])
def test_corners_are_tried_of_which_lists_stay_at_one_end(method: Method) -> None:
    """Of 30 numbers in two lists, evenly drawn ends would be all alike in a list of 20 once in half a million.

    Of 40 corners or more about a quarter (the chance of no change) are whole lists; random corners are half of their
    search's points.
    """
    seen = list[np.ndarray]()
    maximise(start_search(method, [20, 10], 400, 1), lambda x: seen.append(x) or 0.0)
    ends = [x for x in seen if set(x.tolist()) <= {0.0, 1.0}]
    whole = [x for x in ends if np.ptp(x[:20]) == np.ptp(x[20:]) == 0.0]
    mixed = [x for x in ends if np.abs(np.diff(x[:20])).sum() > 5]
    assert whole
    assert mixed
    if method == "corners":
        assert len(ends) == 200
    even = list[np.ndarray]()
    maximise(start_search("random", [20, 10], 400, 1), lambda x: even.append(x) or 0.0)
    # 12,000 even numbers: their mean is within five deviations of a half
    assert abs(np.mean(even) - 0.5) < 5.0 / math.sqrt(12 * 12_000)
    assert not any(set(x.tolist()) & {0.0, 1.0} for x in even)


@pytest.mark.parametrize("flips", [0, 1, 3])
def test_a_corner_with_blocks_of_equal_ends_is_found(flips: int) -> None:
    """The known top of a linear function of 40 numbers is a corner whose ends change so often in each list of 20.

    Within 1000 runs 95 % of the way from the middle to it are found: faces are reached, not only come near.
    """
    blocks = np.where(np.arange(20) * (flips + 1) // 20 % 2, -1.0, 1.0)
    slope = np.concatenate([blocks, -blocks])
    best, _ = maximise(start_search("cma", [20, 20], 1000, 0), lambda x: float(slope @ (2.0 * x - 1.0)))
    assert best >= 0.95 * 40.0


def test_points_lie_in_the_cube_and_global_random_numbers_are_left_alone() -> None:
    """Numbers leave neither 0 to 1 nor, with the same seed, those of another search; numpy's own go on as they were."""
    np.random.seed(1)  # noqa: NPY002  (this is what must not be touched)
    before = np.random.get_state()[1].tolist()  # type: ignore[index]  # noqa: NPY002
    seen: list[list[float]] = [[], []]
    for own in seen:
        maximise(start_search("cma", [4], 200, 5), lambda x, own=own: own.extend(x.tolist()) or float(x.sum()))
    assert seen[0] == seen[1]
    assert 0.0 <= min(seen[0]) <= max(seen[0]) <= 1.0
    assert np.random.get_state()[1].tolist() == before  # type: ignore[index]  # noqa: NPY002


def test_the_way_back_keeps_what_is_needed_alone() -> None:
    """Of three dimensions one is needed, above 0.6: it comes within 1/32 of that, the others go back whole."""
    search, last = shrink((1.0, 1.0, 0.2), (0.0, 0.0, 0.0), lambda score: score > 0.6), (1.0, 1.0, 0.2)
    points = next(search, None)
    while points:
        last = points[0] if points[0][1] > 0.6 else last
        try:
            points = search.send([points[0][1]])
        except StopIteration:
            break
    assert (last[0], last[2]) == (0.0, 0.0)
    assert 0.6 < last[1] <= 0.6 + 1 / 32


def test_the_worst_bias_is_at_the_end_of_its_range() -> None:
    """A constant torque on a stable linear loop does the more harm the larger it is, so the worst is at an end.

    CMA-ES comes within 1 % of the range; the error is that of the run at the end, to the same 1 %.
    """
    bounds = {"disturbances[0].value[0]": [-3, 1], "disturbances[0].value[1]": [-0.01, 0.01]}
    keys = config(variables=bounds, metric="rmse")
    (own,) = torquebench.falsify(keys, methods=("cma",), changes={"falsify.evaluations": 150}).hunts
    end = torquebench.run_experiment(
        {**{k: v for k, v in keys.items() if k != "falsify"}, "disturbances": [{"kind": "bias", "value": [-3.0, 0.0]}]}
    )
    assert own.worst.point[0] < 0.01
    assert own.worst.value == pytest.approx(end.metrics.loc["pd", "rmse"], rel=0.02)


def test_the_worst_torque_of_a_loop_is_found() -> None:
    """The error of a loop that does not swing answers a torque of one sign with one sign: the worst torque keeps it.

    So the largest error is that of all 20 levels at one end, run by itself; in 21 dimensions and 200 runs at least 95 %
    of it is found. The start, too, is at an end: the one whose error has the torque's sign.
    """
    pulses = {"kind": "pulses", "size": [0, 2], "hold": 0.03, "levels": [0.0] * 20}
    section = {"evaluations": 200, "variables": {PULSES: [-1, 1], "run.initial_q[1]": [-0.01, 0.01]}, "metric": "rmse"}
    arm = {**ARM, "run": {**ARM["run"], "initial_q": [0.0, 0.0]}}
    found = torquebench.falsify({**arm, "disturbances": [pulses], "falsify": section}, methods=("cma",))
    ends = [
        torquebench.run_experiment(
            {
                **arm,
                "disturbances": [{**pulses, "levels": [level] * 20}],
                "run": {**arm["run"], "initial_q": [0.0, start]},
            }
        ).metrics.loc["pd", "rmse"]
        for level in (-1.0, 1.0)
        for start in (-0.01, 0.01)
    ]
    assert found.hunts[0].worst.value >= 0.95 * max(ends)


def test_worst_and_smallest_case_replay_bit_for_bit(tmp_path: Path) -> None:
    """``torquebench run`` of ``NAME/worst.yaml`` and ``NAME/smallest.yaml`` gives the very metrics that were stored.

    The worst is not better than any run of a search, nor than the smallest.
    """
    keys = config(variables={"disturbances[0].value": [-3, 3], "plant.payload.mass": [0, 2]}, claim="rmse <= 5 mrad")
    found = torquebench.falsify(keys, folder=tmp_path / "found")
    assert found.broken == ("pd",)
    stored = json.loads((tmp_path / "found/falsify.json").read_text())["controllers"]["pd"]
    for case in ("worst", "smallest"):
        again = torquebench.run_experiment(tmp_path / f"found/pd/{case}.yaml")
        assert again.metrics.loc["pd", "rmse"] == stored[case]["value"] > 0.005
    assert stored["worst"]["value"] >= stored["smallest"]["value"]
    rows = list(csv.DictReader((tmp_path / "found/evaluations.csv").read_text().splitlines()))
    assert {row["method"] for row in rows} == set(COMPARED)
    assert stored["worst"]["value"] >= max(float(row["rmse"]) for row in rows)
    assert (tmp_path / "found/figures/convergence.svg").is_file()


def test_workers_change_nothing() -> None:
    """One thread and two give the same bytes."""
    keys = config(variables={"disturbances[0].value": [-3, 3], "chain.measurement_delay": [0, "20 ms"]})
    one, two = (torquebench.falsify(keys, workers=count) for count in (1, 2))
    assert one.table() == two.table()
    assert one.to_json() == two.to_json()


def test_a_delay_is_a_whole_number_of_periods() -> None:
    """Of a key that takes whole control periods no other values are tried; a step of one's own is kept to as well."""
    payload = {"low": 0, "high": 2, "step": 0.5}
    keys = config(variables={"chain.measurement_delay": [0, "20 ms"], "plant.payload.mass": payload})
    rows = list(csv.DictReader(torquebench.falsify(keys).table().decode().splitlines()))
    delays, masses = ({float(row[key]) for row in rows} for key in ("chain.measurement_delay", "plant.payload.mass"))
    assert len(delays) > 3
    assert all(delay == float(f"{round(delay / 0.002) * 0.002:.15g}") for delay in delays)
    assert masses <= {0.0, 0.5, 1.0, 1.5, 2.0}


@pytest.mark.parametrize("spacing", ["linear", "log"])
def test_every_multiple_of_a_step_is_as_likely(spacing: str) -> None:
    """Of even shares each whole period has as many, those at the ends of the range too; its ends are at 0 and 1.

    With equal ratios the same is so of the logarithm: 2 is nearer to 1 and 3 than these are to each other.
    """
    bounds = {"low": 0.0021 if spacing == "log" else 0, "high": "21 ms", "spacing": spacing}
    (delay,) = space_of(config(variables={"chain.measurement_delay": bounds})).variables
    shares = (np.arange(11_000) + 0.5) / 11_000
    values, counts = np.unique([delay.value(share) for share in shares], return_counts=True)
    ends = np.array([0.004 if spacing == "log" else 0.0, 0.02])
    assert values[[0, -1]].tolist() == [delay.value(0.0), delay.value(1.0)] == ends.tolist()
    wide = np.diff(np.log([*(values - 0.001), 0.021])) if spacing == "log" else np.ones(11)
    np.testing.assert_allclose(counts / counts.sum(), wide / wide.sum(), atol=2e-4)


def test_gains_that_are_chosen_stay_those_of_the_config() -> None:
    """A law with ``gains: auto`` has at the longest delay the numbers that it has at none: it does not know of it."""
    controllers = [{"name": "st", "law": "super-twisting", "gains": "auto"}]
    space = space_of({**config(variables={"chain.measurement_delay": [0, 0.01]}), "controllers": controllers})
    own = torquebench.Experiment.from_dict({**ARM, "controllers": controllers}).controllers[0].gains
    for late in (space.experiment((1.0,), "st"), space.checked((1.0,), "st")):
        assert late.chain.measurement_delay == 0.01
        assert late.controllers[0].gains == own


def test_the_config_may_be_outside_the_range() -> None:
    """What has no value in its range where it starts is searched inside alone, and may go back to where it started."""
    found = torquebench.falsify(config(variables={"disturbances[0].value[0]": [1, 2]}, evaluations=20))
    tried = {float(row["disturbances[0].value[0]"]) for row in csv.DictReader(found.table().decode().splitlines())}
    assert (min(tried), max(tried)) == (1.0, 2.0)
    assert found.space.values(found.space.nominal) == (0.0,)


def test_what_a_config_leaves_out_has_its_default() -> None:
    """A key that is not in the file begins, and ends where it is not needed, at what it has there: its default."""
    keys = config(variables={"chain.measurement_delay": [0, "20 ms"], "run.metrics_from": [0.1, 1.2]})
    own, bare = {**keys, "chain": {"measurement_delay": 0.004}}, {"duration": 2.0, "control_period": 0.002}
    delay, start = torquebench.falsify({**own, "run": bare}, methods=("random",)).space.variables
    default = torquebench.load_experiment({**ARM, "run": bare}).run.metrics_from
    assert (delay.nominal, start.nominal) == (0.004, default)


def test_a_failed_run_is_worst_and_the_earlier_the_worse() -> None:
    """Where runs fail, the worst one is a failure, and none fails before it; without a claim it breaks the law too."""
    wild = [{"name": "pd", "law": "computed-torque", "gains": {"lam": 5, "kv": 10, "ki": 0}}]
    keys = config(variables={"controllers.pd.gains.kv": {"low": 1, "high": 1e7, "spacing": "log"}})
    found = torquebench.falsify({**keys, "controllers": wild})
    (own,) = found.hunts
    failures = [one.failed_at for runs in own.tried.values() for one in runs if not math.isnan(one.failed_at)]
    if failures:
        assert own.worst.failed_at == min(failures)
        assert found.broken == ("pd",)
    else:
        assert found.broken == ()


@pytest.mark.parametrize(("until", "status"), [("max_error > 10 rad", 0), ("max_error > 1 urad", 1)])
def test_a_claim_decides_the_status(
    until: str, status: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A claim that nothing breaks takes the whole budget, status 0; one that a run breaks ends the search, status 1."""
    file = tmp_path / "study.yaml"
    file.write_text(json.dumps(config(variables={"disturbances[0].value": [-1, 1]})))
    words = ["falsify", str(file), "--until", until, "--out", str(tmp_path / "out"), "--json", "--workers", "1"]
    assert main(words) == status
    runs = [own["runs"] for own in json.loads(capsys.readouterr().out)["controllers"]["pd"]["searches"]]
    assert all((count == 40) == (status == 0) for count in runs)


@pytest.mark.parametrize(
    ("until", "told"),
    [
        ("max_error < 5 mrad", ("got <", "wanted >=: of max_error lower values are better")),
        ("max_eror > 5 mrad", ("'max_eror'", "max_error")),
        ("max_error > 5 kg", ("'5 kg'", "mrad")),
        ("max_error > 30", ("'30'", "a number with its unit [mrad, rad,")),
        ("much", ("'much'", "max_error > 5 mrad")),
    ],
)
def test_a_bad_end_of_a_search_is_told_as_it_was_typed(
    until: str, told: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The message is about ``--until``, with the sign that was typed, and not about the claim that is made of it."""
    assert main(["falsify", "studies/falsify", "--until", until, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert all(text in error for text in ("--until", *told)), error
    assert "--set" not in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "limit", "shown"),
    [
        ("max_error <= 30 mrad", 0.03, "30 mrad"),
        ("max_error <= 0", 0.0, "0 mrad"),
        ("chattering < 5 %", 5.0, "5 %"),
        ("saturation_fraction <= 5 %", 0.05, "5 %"),
        ("tool_rmse <= 2 mm", 0.002, "2 mm"),
        ("total_variation <= 3 1/s", 3.0, "3 1/s"),
        ("effort <= 0.2", 0.2, "0.2"),
    ],
)
def test_a_limit_has_the_unit_of_tables_or_another_of_its_kind(text: str, limit: float, shown: str) -> None:
    """It is read in that unit, and said again in it; its text reads back as the same claim."""
    claim = read_claim(text)
    assert isinstance(claim, Claim)
    assert claim.limit == pytest.approx(limit, rel=1e-15)
    assert claim.text.endswith(shown)
    assert read_claim(claim.text) == claim


@pytest.mark.parametrize("key", METRICS)
def test_a_limit_without_unit_is_asked_for_it(key: str) -> None:
    """A number alone could be of tables or of SI units, a thousand apart: only pure ones are taken as they are."""
    info = METRICS[key]
    found = read_claim(f"{key} {'<=' if info.better == 'lower' else '>='} 30")
    if info.shown_unit == "1":
        assert isinstance(found, Claim)
    else:
        assert isinstance(found, dict)
        assert "with its unit" in found["wanted"]


def test_a_sentence_counts_the_numbers_of_a_list() -> None:
    """A key of many numbers is one part of the sentence and one row, a bar for each number that is needed."""
    pulses = [{"kind": "pulses", "size": [8, 0], "hold": 0.1, "levels": [0, 0, 0, 0, 0, 0]}]
    keys = {**ARM, "disturbances": pulses, "falsify": {"evaluations": 20, "variables": {PULSES: [-1, 1]}}}
    found = torquebench.falsify(keys, methods=("random",))
    moved = found.moved(found.hunts[0])[PULSES]
    assert f"with {len(moved)} of 6 {PULSES}" in found.sentence(found.hunts[0])
    assert bars([0.0, None, 1.0]) == f"{BARS[0]}·{BARS[-1]}"


def test_every_search_that_ships_is_one() -> None:
    """The shipped study, and the written example, are valid at the ends of their ranges, whatever is changed."""
    assert len(space_of("studies/falsify").variables) == 43
    file = yaml.safe_load(GOOD + FALSIFY)
    (variable,) = space_of(file).variables
    assert (variable.log, variable.step, variable.value(0.0), variable.value(1.0)) == (True, 0.1, 0.1, 2.0)


def test_without_its_package_cma_is_refused_with_what_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Random search goes on without it; CMA-ES says which extra it needs."""
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    check_method(["random"], "--method")
    with pytest.raises(ConfigError, match=re.escape(how_to_install("falsify"))):
        check_method(METHODS, "--method")


BAD: Mapping[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "bounds": (
        {"variables": {"plant.payload.mass": [3, 0], "run.nonsense": [0, 1], "chain.jitter": "much"}, "seeds": 0},
        ("smaller number first", "chain.jitter", "run.nonsense", "seeds"),
    ),
    "claim": (
        {"variables": {"plant.payload.mass": [0, 3]}, "claim": "max_eror < 5 mrad", "evaluations": 0},
        ("max_error", "evaluations"),
    ),
    "upward": ({"variables": {"plant.payload.mass": [0, 3]}, "claim": "max_error > 5 mrad"}, ("is bad",)),
    "no number": ({"variables": {"plant.payload.mass": [0, 3]}, "claim": "max_error <= "}, ("such as max_error",)),
    "unit": ({"variables": {"plant.payload.mass": [0, 3]}, "claim": "max_error < 5 kg"}, ("mrad",)),
    "none": ({"variables": {}}, ("nothing may change",)),
    "unknown": ({"variables": {"plant.payload.mas": [0, 3], "run.metrics": [0, 1]}}, ("mass", "metrics_from")),
    "list": ({"variables": {"disturbances[0].value": {"low": [0, 0], "high": 1}, "disturbances": [0, 1]}}, ("low",)),
    "whole": ({"variables": {"disturbances": [0, 1]}}, ("no list of numbers",)),
    "twice": (
        {"variables": {"disturbances[0].value": [0, 1], "disturbances[0].value[1]": [0, 1]}},
        ("changes it too",),
    ),
    "step": ({"variables": {"plant.payload.mass": {"low": 1.1, "high": 1.9, "step": 1}}}, ("no whole multiple of 1",)),
    "no gain": (
        {"variables": {"controllers.*.gains.phi": [0, 1]}, "evaluations": 0},
        ("no controller's law", "evaluations"),
    ),
    "end": ({"variables": {"plant.payload.mass": [-1, 3]}}, ("at least 0",)),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_sections_are_refused_with_all_mistakes(name: str) -> None:
    """Each mistake of the section is named in one refusal."""
    section, told = BAD[name]
    with pytest.raises(ConfigError) as caught:
        torquebench.falsify(config(**section))
    assert all(text in str(caught.value) for text in told), str(caught.value)


def test_mistakes_of_the_section_come_with_all_others() -> None:
    """A mistake of another section, an unknown key that may change, and one of the section are told in one refusal."""
    keys = config(variables={"plant.payload.mas": [0, 3]}, evaluations=0)
    with pytest.raises(ConfigError) as caught:
        torquebench.falsify({**keys, "run": {**ARM["run"], "duration": -1}})
    assert all(text in str(caught.value) for text in ("mass", "evaluations", "duration")), str(caught.value)
    assert len(caught.value.problems) == 3


def test_pulses_are_the_levels_in_their_time() -> None:
    """Against the definition: size x levels[i] from i hold on, zero after the last one; a long one fills the run."""
    t = np.arange(10) * 0.01
    tau = Pulses(size=(2.0, -1.0), levels=(1.0, 0.0, -0.5), hold=0.03).sample(2, t, 0.01, np.random.default_rng(0))
    shape = np.array([1, 1, 1, 0, 0, 0, -0.5, -0.5, -0.5, 0])
    assert np.array_equal(tau, np.outer(shape, [2.0, -1.0]))
    long = Pulses(size=1.0, levels=(0.5, 1.0), hold=1.0).sample(1, t, 0.01, np.random.default_rng(0))
    assert np.array_equal(long, np.full((10, 1), 0.5))

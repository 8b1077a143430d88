"""Tuning: every law alike, on draws of its own, the same bytes however it is run, and what is refused."""

from __future__ import annotations

import copy
import csv
import io
import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import torquebench
from torquebench.cli.app import main
from torquebench.errors import ConfigError, ResultError
from torquebench.experiment.falsify_section import Claim
from torquebench.experiment.source import read_bytes, read_document
from torquebench.experiment.tune_section import HELD, Tune, take_tune
from torquebench.robot.library import data_root
from torquebench.shipped import how_to_install
from torquebench.statistics import undominated
from torquebench.sweep.search import NEEDS, Sampler, check_method, sampler_search
from torquebench.sweep.tune import Run, evaluation_of, judge, threads, tune_laws
from torquebench.tunings import TABLE, Tuning, read_study, tune

SAMPLERS: tuple[Sampler, ...] = ("random", "tpe", "cma-es", "nsga-ii")
CONFIG: dict[str, Any] = {
    "name": "arm",
    "plant": {"engine": "analytic", "model": "two-link", "timestep": 0.002},
    "model": {"mismatch": {"relative": 0.3}},
    "controllers": [
        {"name": "ct", "law": "computed-torque", "gains": {"lam": 5, "kv": 10, "ki": 10}},
        {"name": "pd", "law": "pd", "gains": "auto"},
    ],
    "reference": {"kind": "sine", "amplitude": [0.5, -0.4], "frequency_hz": [0.5, 0.7]},
    "chain": "slow",
    "run": {"duration": 0.6, "control_period": 0.002, "metrics_from": 0.0},
    "tune": {
        "evaluations": 9,
        "draws": 2,
        "conditions": {"sine": {}, "step": {"reference": {"kind": "step", "target": [0.2, -0.2], "at": 0.0}}},
        "test": {"draws": 3},
    },
}
"""A study of which a closed loop takes a millisecond."""


def study(**changes: Any) -> dict[str, Any]:
    """Return the study with other values for some keys of its section, None to leave one out."""
    config = copy.deepcopy(CONFIG)
    config["tune"] = {key: x for key, x in {**config["tune"], **changes}.items() if x is not None}
    return config


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Tuning, Path]:
    """Tune the study on one thread, stored."""
    folder = tmp_path_factory.mktemp("whole") / "out"
    return tune(CONFIG, workers=1, folder=folder), folder


def files(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder by their names."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_an_evaluation_is_the_geometric_mean_over_conditions_and_draws(whole: tuple[Tuning, Path]) -> None:
    """The number of two sets of gains follows from `run_experiment` of each condition in each draw, to round-off."""
    tuning, _ = whole
    own = tuning.law("ct")
    for one in (own.start, own.best):
        errors = []
        for condition in tuning.study.training:
            for draw in range(2):
                changes = {"controllers": [{"name": "ct", "law": "computed-torque", "gains": dict(one.gains)}]}
                experiment = condition.experiment.with_({**changes, "run.draw": draw})
                errors.append(torquebench.run_experiment(experiment).metrics.loc["ct", "rmse"])
        assert one.objectives[0] == pytest.approx(float(np.prod(errors)) ** 0.25, rel=1e-12)


def test_every_law_has_the_same_budget_and_its_own_gains_first(whole: tuple[Tuning, Path]) -> None:
    """Each law has three seeds of nine evaluations, the first of its own gains: so none ends worse than it began."""
    tuning, _ = whole
    for own in tuning.laws:
        assert [len(search) for search in own.searches] == [9, 9, 9]
        assert all(search[0].gains == own.controller.gains for search in own.searches)
        assert all(best.scores[0] <= own.start.scores[0] for best in own.bests)
        assert own.best.scores[0] == min(one.scores[0] for search in own.searches for one in search)
        seeds = [[one.gains for one in search[1:]] for search in own.searches]
        assert seeds[0] != seeds[1] != seeds[2] != seeds[0]
    assert tuning.law("ct").best.number > 0
    # evaluations of both conditions, each of 0.6 s in two draws; the law's own gains are run once for all seeds
    assert tuning.seconds == pytest.approx(0.6 * 2 * 2 * (3 * 9 - 2))


def test_draws_to_judge_on_are_others(whole: tuple[Tuning, Path]) -> None:
    """What is judged follows from runs in the draws from a million on, paired for both sets of gains."""
    tuning, _ = whole
    own, judged = tuning.law("ct"), tuning.tuned["ct"]
    assert len(judged.draws[0]) == 3
    controllers = [{"name": "ct", "law": "computed-torque", "gains": dict(own.best.gains)}]
    for i, value in enumerate(judged.draws[0]):
        errors = [
            torquebench.run_experiment(one.experiment.with_({"controllers": controllers, "run.draw": HELD + i}))
            for one in tuning.study.judged
        ]
        wanted = math.prod(result.metrics.loc["ct", "rmse"] for result in errors) ** 0.5
        assert value == pytest.approx(wanted, rel=1e-12)
    ratio = tuning.ratio("ct")
    assert ratio is not None
    logs = [math.log(a / b) for a, b in zip(judged.draws[0], tuning.untuned["ct"].draws[0], strict=True)]
    assert ratio.ratio == pytest.approx(math.exp(np.mean(logs)), rel=1e-12)


@pytest.mark.parametrize("workers", [2, 3])
def test_the_bytes_do_not_depend_on_how_many_threads_there_are(
    workers: int, whole: tuple[Tuning, Path], tmp_path: Path
) -> None:
    """Every file of the folder is the same."""
    tune(CONFIG, workers=workers, folder=tmp_path / "out")
    assert files(tmp_path / "out") == files(whole[1])


def test_what_was_interrupted_goes_on_to_the_same_bytes(whole: tuple[Tuning, Path], tmp_path: Path) -> None:
    """After Ctrl-C there are the evaluations so far and the best gains; a torn last line does no harm."""

    def stop(what: str, done: int, total: int) -> None:
        if done > 20:
            raise KeyboardInterrupt

    folder = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        tune(CONFIG, workers=2, folder=folder, progress=stop)
    assert not (folder / "manifest.json").exists()
    rows = (folder / TABLE).read_bytes()
    assert 20 < len(rows.splitlines()) < 54
    half = torquebench.load_experiment(folder / "tuned.yaml")
    assert "Interrupted after" in str(half.description)
    (folder / TABLE).write_bytes(rows[:-7])
    tuning = tune(CONFIG, workers=2, folder=folder, resume=True)
    assert files(folder) == files(whole[1])
    assert tuning.law("pd").best == whole[0].law("pd").best


def test_nothing_that_is_stored_is_run_again(whole: tuple[Tuning, Path]) -> None:
    """With all evaluations known no closed loop is run, and what comes out is equal."""
    tuning, _ = whole
    known = {
        (own.controller.name, i, one.number): one
        for own in tuning.laws
        for i, search in enumerate(own.searches)
        for one in search
    }
    asked = tuning.study

    class Idle:
        def map(self, function: Callable[..., Any], jobs: list[Any]) -> list[Any]:
            assert jobs == []
            return []

    again = tune_laws(asked.base, asked.training, asked.asked, Idle(), known=known)  # type: ignore[arg-type]
    assert [own.searches for own in again] == [own.searches for own in tuning.laws]


def test_altered_evaluations_are_found(whole: tuple[Tuning, Path], tmp_path: Path) -> None:
    """Gains that the search does not ask for, cells that are no numbers and another study are each refused."""
    folder = tmp_path / "out"
    folder.mkdir()
    for name in ("study.json", TABLE):
        (folder / name).write_bytes((whole[1] / name).read_bytes())
    rows = list(csv.reader(io.StringIO((folder / TABLE).read_text())))
    place = rows[0].index("gains.lam")

    def store(value: str) -> None:
        rows[3][place] = value
        (folder / TABLE).write_text("".join(",".join(row) + "\n" for row in rows))

    store("7.25")
    with pytest.raises(ResultError, match="evaluation 2 of 'ct' has other gains"):
        tune(CONFIG, workers=1, folder=folder, resume=True)
    store("seven")
    with pytest.raises(ResultError, match=rf"{TABLE}:4: cannot be read"):
        tune(CONFIG, workers=1, folder=folder, resume=True)
    with pytest.raises(ConfigError, match="another study"):
        tune(study(seed=5), workers=1, folder=folder, resume=True)
    with pytest.raises(ConfigError, match="no tuning was begun there"):
        tune(CONFIG, workers=1, folder=tmp_path / "none", resume=True)
    with pytest.raises(ConfigError, match="is not empty"):
        tune(CONFIG, workers=1, folder=folder)


def test_the_tuned_config_runs_in_a_draw_that_no_law_was_tuned_on(whole: tuple[Tuning, Path]) -> None:
    """`tuned.yaml` has the gains that were found, tells the budget, and gives the very numbers of the first draw."""
    tuning, folder = whole
    experiment = torquebench.load_experiment(folder / "tuned.yaml")
    assert experiment.run.draw == HELD
    assert "9 evaluations x 3 seeds of each law (tpe, seed 0)" in str(experiment.description)
    result = torquebench.run_experiment(experiment)
    with threads(1) as pool:
        for keys in experiment.controllers:
            assert keys.gains == tuning.law(keys.name).best.gains
            alone = [one for one in tuning.study.judged if one.name == "sine"]
            (found,) = judge([keys], alone, ["rmse"], range(HELD, HELD + 1), pool)
            assert found.draws[0][0] == pytest.approx(result.metrics.loc[keys.name, "rmse"], rel=1e-12)


def test_the_document_and_the_table_say_the_same(whole: tuple[Tuning, Path]) -> None:
    """Of each law and seed the best row of the table is the one in `tune.json`; the ranking is that of the test."""
    tuning, folder = whole
    said = json.loads((folder / "tune.json").read_bytes())
    rows = tuning.to_dataframe()
    assert len(rows) == 2 * 3 * 9
    for name, own in said["controllers"].items():
        best = rows[(rows.controller == name) & rows.feasible].groupby("seed").rmse.min()
        assert best.tolist() == [seed["rmse"] for seed in own["seeds"]]
        assert own["tuned"]["rmse"] == min(best)
    means = {name: own["test"]["tuned"]["rmse"]["mean"][0] for name, own in said["controllers"].items()}
    assert said["ranking"]["tuned"] == sorted(means, key=lambda name: means[name])
    assert said["training"]["draws"][1] <= said["test"]["draws"][0]


def test_feasibility_comes_first() -> None:
    """Gains that keep the constraint beat less error that does not, less excess beats more, and any beats a failure."""
    budget = Tune(constraints=(Claim("chattering", "<=", 5.0),))

    def score(*runs: tuple[float, float, float]) -> float:
        return evaluation_of(0, {}, [Run(lost, values) for lost, *values in runs], budget).scores[0]  # type: ignore[arg-type]

    nan = math.nan
    kept, better = score((0.0, 1.0, 5.0), (0.0, 4.0, 1.0)), score((0.0, 1.0, 1.0), (0.0, 1.0, 1.0))
    little, much = score((0.0, 1e-6, 5.1), (0.0, 1e-6, 1.0)), score((0.0, 1e-6, 90.0), (0.0, 1e-6, 1.0))
    undefined = score((0.0, nan, 1.0), (0.0, 1.0, 1.0))
    late, early = score((0.1, nan, nan), (0.0, 1e-6, 1.0)), score((0.9, nan, nan), (0.0, 1e-6, 1.0))
    both = score((0.9, nan, nan), (0.9, nan, nan))
    assert better < kept < little < much < late < early < both
    assert much < late
    assert kept < undefined < late
    assert math.exp(kept) == pytest.approx(2.0)


def test_a_failed_run_makes_the_objective_infinite() -> None:
    """Failures are not averaged away: there is no objective, and their number is told."""
    one = evaluation_of(3, {}, [Run(0.5, (math.nan,)), Run(0.0, (1.0,))], Tune())
    assert (one.objectives, one.failed, one.feasible, one.lost) == ((math.inf,), 1, False, 0.25)


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_a_sampler_keeps_to_its_budget_and_is_seeded(sampler: Sampler) -> None:
    """So many points of the cube are asked for as are allowed, the same ones for a seed, others for another one."""

    def asked(seed: int, evaluations: int = 21) -> list[tuple[float, ...]]:
        search, found = sampler_search(sampler, 3, evaluations, 1, seed), list[tuple[float, ...]]()
        points = next(search)
        while points:
            found += points
            try:
                points = search.send([(sum((x - 0.3) ** 2 for x in point),) for point in points])
            except StopIteration:
                break
        return found

    first = asked(1)
    assert len(first) == 21
    assert all(0.0 <= x <= 1.0 for point in first for x in point)
    assert asked(1) == first != asked(2)
    assert asked(1, 13) == first[:13]


@pytest.mark.parametrize("sampler", ["tpe", "cma-es"])
def test_a_sampler_comes_closer_to_a_minimum_than_chance(sampler: Sampler) -> None:
    """Of a paraboloid in three dimensions, 64 points: half the distance of as many random ones, medians of 3 seeds.

    With scores in which half of the cube is infeasible: the order alone decides.
    """

    def least(which: Sampler, seed: int) -> float:
        best, search = math.inf, sampler_search(which, 3, 64, 1, seed)
        points = next(search)
        while points:
            squares = [sum((x - 0.3) ** 2 for x in point) for point in points]
            best = min(best, *squares)
            try:
                points = search.send([(s if p[0] < 0.5 else 1e3 + s,) for s, p in zip(squares, points, strict=True)])
            except StopIteration:
                break
        return math.sqrt(best)

    found = [sorted(least(which, seed) for seed in range(3))[1] for which in (sampler, "random")]  # type: ignore[arg-type]
    assert found[0] < 0.5 * found[1]


def test_a_front_is_searched_with_two_objectives(tmp_path: Path) -> None:
    """No point of the front is better than another in both, all are evaluations, and a figure is drawn."""
    tuning = tune(study(objective=["rmse", "chattering"], evaluations=20), workers=2, folder=tmp_path / "out")
    assert tuning.study.asked.sampler == "nsga-ii"
    for own in tuning.laws:
        front = [one.objectives for _, one in own.front]
        every = {one.objectives for search in own.searches for one in search if one.feasible}
        assert set(front) <= every
        assert front == sorted(front)
        assert len(undominated(front)) == len(front)  # type: ignore[arg-type]
        assert not any(all(a < b for a, b in zip(x, y, strict=True)) for x in every for y in front)
    assert (tmp_path / "out" / "figures" / "fronts.svg").is_file()


def test_all_cores_are_asked_for_by_name_of_the_package() -> None:
    """A sampler whose package is not there is refused with what to install; random needs none."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("importlib.util.find_spec", lambda name: None)
        check_method(["random"], "tune.sampler")
        for sampler in ("tpe", "cma-es", "nsga-ii"):
            with pytest.raises(
                ConfigError,
                match=re.escape(
                    f"{NEEDS[sampler][0][0]}: {how_to_install('tune')}; --set tune.sampler=random needs none"
                ),
            ):
                check_method([sampler], "tune.sampler")


MISTAKES: dict[str, tuple[dict[str, Any], str]] = {
    "seeds": ({"seeds": 1}, "tune.seeds: got 1, wanted at least 3"),
    "objective": ({"objective": "rmes"}, "tune.objective.*did you mean 'rmse'"),
    "upwards": ({"objective": "time_in_band"}, "wanted a metric of which lower values are better"),
    "twice": ({"objective": ["rmse", "rmse"]}, "wanted two metrics"),
    "sampler": ({"objective": ["rmse", "hf"], "sampler": "tpe"}, "tpe has one objective, wanted nsga-ii or random"),
    "constraint": ({"constraints": ["chattering >= 5 %"]}, "claims that chattering is bad"),
    "constraints": ({"constraints": ["hf <= 5 %", "hf <= 4 %"]}, "hf has a constraint already"),
    "seed": ({"conditions": {"a": {"run.seed": 3}}}, "conditions.a.'run.seed'.*keeps the draws"),
    "draw": ({"test": {"conditions": {"a": {"run": {"duration": 1, "draw": 3}}}}}, "keeps the draws"),
    "key": ({"conditions": {"a": {"chian": "fast"}}}, "unknown key .*did you mean 'chain'"),
    "gains": ({"conditions": {"a": {"controllers": []}}}, "cannot be varied"),
    "slug": ({"conditions": {"A b": {}}}, "its name is not a slug"),
    "steps": ({"objective": "settling_time"}, "conditions.sine: has no settling_time"),
    "arm": ({"conditions": {"a": {"plant.model": "puma560"}}}, "an arm of 6 joints|wanted"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_mistakes_are_told_with_their_place(case: str) -> None:
    """Each with what was wanted, before anything is run."""
    changes, wanted = MISTAKES[case]
    with pytest.raises(ConfigError, match=wanted):
        read_study(study(**changes))


def test_draws_are_never_mixed() -> None:
    """Nothing random to judge on what was tuned on, no tuning on draws that are judged on, and none the other way."""
    fixed = study() | {"chain": "ideal", "model": {}}
    with pytest.raises(ConfigError, match="nothing is random in 'sine'"):
        read_study(fixed)
    fixed["tune"]["test"] = {"conditions": {"other": {"plant.payload.mass": 0.5}}}
    found = read_study(fixed)
    with threads(1) as pool:
        with pytest.raises(ConfigError, match=f"draws before {HELD} are tuned on"):
            judge(found.base.controllers, found.judged, ["rmse"], range(1), pool)
        beyond = Tune(draws=HELD + 1)
        with pytest.raises(ConfigError, match="none tuned on"):
            tune_laws(found.base, found.training, beyond, pool)


def test_the_command_shows_where_each_law_was_and_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Dots before the table, gains in it, status 0; 1 and its name where no gains keep a constraint; 2 for mistakes."""
    config = tmp_path / "arm.yaml"
    config.write_text(json.dumps(study(evaluations=4)))
    assert main(["tune", str(config), "--out", str(tmp_path / "a"), "-j", "1"]) == 0
    out = capsys.readouterr().out
    assert out.index("●") < out.index("untuned, test [mrad]")
    assert "torquebench run" in out
    impossible = ["--set", "tune.constraints=[max_error <= 1 urad]"]
    assert main(["tune", str(config), "--out", str(tmp_path / "b"), "-j", "1", *impossible]) == 1
    said = capsys.readouterr()
    assert "controller 'ct': no gains were found that keep the constraints" in said.err
    assert "(" in said.out
    assert main(["tune", str(config), "--out", str(tmp_path / "c"), "--set", "tune.seeds=2"]) == 2
    assert main(["tune", str(config), "--resume"]) == 2
    assert not (tmp_path / "c").exists()
    assert "the folder in which the study was begun" in capsys.readouterr().err


@pytest.mark.parametrize(
    "path",
    [path for path in sorted((data_root() / "configs").rglob("*.yaml")) if "\ntune:" in path.read_text()],
    ids=lambda path: path.stem,
)
def test_a_shipped_study_tunes_on_a_step_or_quintic(path: Path) -> None:
    """Gains tuned on smooth motions alone often ring on the way to a target."""
    found = take_tune(read_document(read_bytes(path), str(path)))
    assert {"step", "quintic"} & {one.experiment.reference.kind for one in found.training}

"""The arena: run, stored, ranked again, entered by one more law, made again, refused."""

from __future__ import annotations

import itertools
import json
import os
import platform
import re
import runpy
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

import torquebench
from torquebench import diff
from torquebench.arena.pages import by_condition, duels, worth
from torquebench.arena.ranking import compare, is_open, rank
from torquebench.arena.record import Record, digest_of, looks_at, picks, plain_gains, read_record
from torquebench.arena.run import draws_of, run_rows
from torquebench.arenas import (
    ALIKE,
    Arena,
    _entries,
    _stored_study,
    against,
    check_row,
    difference,
    entry_config,
    run_arena,
    study_of,
)
from torquebench.cli.app import Terminated, main
from torquebench.errors import ConfigError, ResultError
from torquebench.experiment.seal import commitment
from torquebench.kernel import clip
from torquebench.laws import find_law, law_names, sliding_mode
from torquebench.robot.library import mjcf_path
from torquebench.sim.sandbox import SandboxedLaw
from torquebench.sweep.tune import threads

STUDY: dict[str, Any] = {
    "name": "small",
    "plant": {"engine": "analytic", "model": "two-link"},
    "controllers": [
        {"law": "computed-torque", "gains": "auto"},
        {"law": "pd-gravity", "gains": "auto"},
        {"law": "linear-band-smc", "gains": "auto"},
    ],
    "reference": {"kind": "sine", "amplitude": [0.5, -0.4], "frequency_hz": [0.5, 0.7]},
    "run": {"duration": 1.0, "control_period": 0.002, "metrics_from": 0.3},
    "arena": {
        "laws": "listed",
        "chains": {"slow": {"chain": "slow"}},
        "training": {"sine": {}},
        "burdens": {"nominal": {}, "noise": {"disturbances": "30 %"}},
        "held_out": {"payload": {"plant.payload": {"mass": 1}}},
        "levels": ["2 %", "20 %"],
        "sampler": "random",
        "evaluations": 6,
        "seeds": 2,
        "draws": 3,
    },
}
"""An arena of a few seconds."""


UNKNOWN = """\
from typing import Annotated, NamedTuple

import numpy as np

from torquebench import Array, Gain, controller, gravity


class Gains(NamedTuple):
    lam: Annotated[Array, Gain("slope", "1/s")]
    kv: Annotated[Array, Gain("damping over inertia", "1/s")]


@controller("unknown-law", gains=Gains)
def unknown_law(gains, model, t, q, qd, ref, memory, tau):
    gravity(model, q, tau)
    tau += gains.kv * model.inertia_scale * np.asarray(ref.qd - qd + gains.lam * (ref.q - q))
"""


def edited(**section: Any) -> dict[str, Any]:
    """Return the study with other keys in its section."""
    return {**STUDY, "arena": {**STUDY["arena"], **section}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the arena."""
    path = tmp_path_factory.mktemp("arena") / "out"
    run_arena(STUDY, folder=path, seed=3, workers=2)
    return path


@pytest.fixture(scope="module")
def record(folder: Path) -> Record:
    """What it left."""
    return read_record(folder)


def test_rows_are_the_same_on_any_number_of_workers_and_resumed(folder: Path, tmp_path: Path) -> None:
    """One worker and two, and a folder in which a row is missing, leave the same bytes."""
    run_arena(STUDY, folder=tmp_path / "one", seed=3, workers=1)
    assert (tmp_path / "one/arena.json").read_bytes() == (folder / "arena.json").read_bytes()
    before = (tmp_path / "one/report.html").read_bytes()
    (tmp_path / "one/rows/slow--pd-gravity.json").unlink()
    (tmp_path / "one/arena.json").unlink()
    run_arena(STUDY, folder=tmp_path / "one", workers=2)
    assert (tmp_path / "one/arena.json").read_bytes() == (folder / "arena.json").read_bytes()
    assert (tmp_path / "one/report.html").read_bytes() == before
    with pytest.raises(ConfigError, match="another arena"):
        run_arena(edited(draws=4), folder=tmp_path / "one")


def test_gains_are_judged_until_no_draw_decides_more(tmp_path: Path) -> None:
    """What is told of decided and of hopeless pairs is the same as of all draws; only the gains of open ones go on.

    Stopped in the middle it goes on to the same bytes, and a row made again alone has as many draws.
    """
    study = edited(draws=12, looks=3, levels=["2 %", "90 %"])
    found = run_arena(study, folder=tmp_path / "out", seed=3, workers=2).record
    counts = {(row.entry, i): draws_of(one) for row in found.rows for i, one in enumerate(row.judged)}
    assert set(counts.values()) <= set(looks_at(12, 3))
    assert len(set(counts.values())) > 1
    whole = run_arena(edited(draws=12, levels=["2 %", "90 %"]), store=False, seed=3).record
    for row, other in zip(found.rows, whole.rows, strict=True):
        for one, more in zip(row.judged, other.judged, strict=True):
            assert more.gains == one.gains
            for name, table in one.values.items():
                assert all(more.values[name][metric][: len(own)] == own for metric, own in table.items())
    for level in found.levels:  # a pair that is left does not tie for want of draws
        known = {row.entry: found.scores(row, level) for row in found.rows if None not in picks(row, level)}
        for a, b in itertools.combinations(known, 2):
            closed = min(known[x].values.shape[2] for x in (a, b)) < 12
            assert not (closed and is_open(known[a], known[b], looks=3)) or not all(
                one.rank for one in found.standings("slow", level) if one.entry in (a, b)
            )
    before = (tmp_path / "out/arena.json").read_bytes()
    cut = tmp_path / "out/rows/slow--pd-gravity.json"
    row = json.loads(cut.read_text())
    for one in row["judged"]:
        one["values"] = {}
    cut.write_text(json.dumps(row))
    (tmp_path / "out/arena.json").unlink()
    run_arena(study, folder=tmp_path / "out", workers=1)
    assert (tmp_path / "out/arena.json").read_bytes() == before
    assert check_row(tmp_path / "out", "slow/pd-gravity") <= ALIKE


def test_a_condition_in_which_nothing_is_random_is_run_once(tmp_path: Path, record: Record) -> None:
    """However many draws are looked at: its one run stays the one of the first look, and the drawn ones go on."""
    chains = {"slow": {"chain": "ideal"}}
    study = study_of(edited(chains=chains, held_out={}, evaluations=2))
    track = study.tracks["slow"].sealed(1)
    with threads(1) as pool:
        two, three = (
            run_rows(study, [(track, track.base.controllers[1])], pool, record, tmp_path, draws=counts)[0]
            for counts in (lambda row: [2] * len(row.judged), lambda row: [3] * len(row.judged))
        )
    for one, more in zip(two.judged, three.judged, strict=True):
        assert one.values["nominal"] == more.values["nominal"]
        assert len(more.values["nominal"]["rmse"]) == 1
        assert len(more.values["noise"]["rmse"]) == 3
        assert more.values["noise"]["rmse"][:2] == one.values["noise"]["rmse"]


def test_draws_are_sealed_and_apart_from_those_of_training(folder: Path, record: Record) -> None:
    """The hash of the secret stands before the runs; another secret is another seed, and none is that of training."""
    sealed = json.loads((folder / "seal.json").read_text())
    assert record.seal["commitment"] == sealed["commitment"] == commitment(record.seal["secret"])
    track = study_of(STUDY).tracks["slow"].sealed(5)
    assert {one.experiment.run.seed for one in track.tests}.isdisjoint(
        {one.experiment.run.seed for one in track.training}
    )
    found = [run_arena(store=False, study=edited(evaluations=2, draws=2)).record.seal["commitment"] for _ in range(2)]
    assert found[0] != found[1]


def test_every_law_has_the_same_budget(record: Record) -> None:
    """Evaluations x seeds x training conditions, in closed loops and in seconds of them."""
    assert {row.loops for row in record.rows} == {6 * 2 * 1}
    assert {row.seconds for row in record.rows} == {12.0}


def test_picked_gains_do_not_chatter_more_than_the_level_where_they_were_tuned(record: Record) -> None:
    """Of each tuning those with the least error among what was judged; a lower level never has less error."""
    for row in record.rows:
        for seed in range(record.seeds):
            errors = []
            for level in record.levels:
                one = picks(row, level)[seed]
                if one is not None:
                    assert one.chattering is not None
                    assert one.error is not None
                    assert one.chattering <= level
                    errors.append(one.error)
            assert errors == sorted(errors, reverse=True)


def test_exchanging_two_laws_stored_scores_exchanges_their_places(record: Record) -> None:
    """Nothing in the arena knows a law by name."""
    a, b, *rest = record.rows
    other = replace(record, rows=(replace(a, judged=b.judged), replace(b, judged=a.judged), *rest))
    names = {a.entry: b.entry, b.entry: a.entry}
    for level in record.levels:
        before, after = record.standings("slow", level), other.standings("slow", level)
        told = {own.entry: own[1:] for own in after}
        assert {own.entry: told[names.get(own.entry, own.entry)] for own in before} == {o.entry: o[1:] for o in before}


def test_the_same_law_under_two_names_ties() -> None:
    """A null arena: equal seeds give equal gains, and the two share a rank."""
    twice = [{"name": name, "law": "computed-torque", "gains": "auto"} for name in ("one", "other")]
    found = run_arena(store=False, study={**edited(evaluations=3), "controllers": twice}).standings("slow", 20.0)
    assert [own[1:3] for own in found] == [(1, 2), (1, 2)]
    assert found[0][2:] == found[1][2:]


def test_a_row_can_be_made_again_and_a_forged_one_is_found_out(folder: Path, tmp_path: Path, record: Record) -> None:
    """From the file alone every figure comes again; one that is better than the truth does not."""
    assert check_row(folder, "slow/pd-gravity") <= ALIKE
    row = record.row("slow/pd-gravity")
    values = {
        key: {m: tuple(x and 0.9 * x for x in own) for m, own in table.items()}
        for key, table in row.judged[0].values.items()
    }
    forged = replace(row, judged=(replace(row.judged[0], values=values), *row.judged[1:]))
    rows = tuple(forged if own.name == row.name else own for own in record.rows)
    (tmp_path / "arena.json").write_bytes(replace(record, rows=rows).to_json())
    assert check_row(tmp_path, "slow/pd-gravity") > 0.05
    assert main(["arena", str(tmp_path / "arena.json"), "--check", "slow/pd-gravity", "-q"]) == 1
    with pytest.raises(ResultError, match="did you mean 'slow/pd-gravity'"):
        check_row(folder, "slow/pd-gravit")


def test_a_forged_arena_writes_nothing_outside_its_folder(tmp_path: Path, record: Record) -> None:
    """Names of entries, chains and arms become names of files: what leads out of the folder is refused, in words."""
    first, *rest = record.rows
    forged = replace(record, rows=(replace(first, entry="../../../out"), *rest))
    with pytest.raises(ResultError, match=r"'slow/\.\./\.\./\.\./out' is of no entry"):
        Arena(forged).save(tmp_path / "one/two")
    (tmp_path / "arena.json").write_bytes(replace(record, rows=(replace(first, chain="../out"), *rest)).to_json())
    with pytest.raises(ResultError, match="on a chain that the arena does not have"):
        read_record(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"arena.json", "one"}


@pytest.mark.parametrize("path", ["arms/links.xml", "../../links.xml"])
def test_an_arm_of_ones_own_lies_beside_each_config_that_replays_a_row(
    path: str, tmp_path: Path, record: Record
) -> None:
    """Wherever it was when the arena was run, and never outside of the arena's folder."""
    text = mjcf_path("two-link").read_text()
    assert "model: two-link" in record.study
    own = replace(record, study=record.study.replace("model: two-link", f"model: {path}"), arms={path: text})
    Arena(own).save(tmp_path / "one/two")
    replay = torquebench.load_experiment(tmp_path / "one/two/entries/slow/pd-gravity.yaml")
    assert str(replay.plant.model) == "links.xml"
    assert (tmp_path / "one/two/entries/slow/links.xml").read_text() == text
    assert [file.name for file in tmp_path.rglob("*.xml")] == ["links.xml"]


def test_a_pipe_is_no_arena(tmp_path: Path) -> None:
    """It is said at once, though nobody writes to it."""
    os.mkfifo(tmp_path / "arena.json")
    with pytest.raises(ResultError, match="is not a regular file"):
        read_record(tmp_path)


def test_the_config_of_a_row_replays_what_is_stored(record: Record, folder: Path) -> None:
    """An experiment run by itself has the stored figures of the last burden's first draw: 4 digits are stored."""
    row = record.row("slow/linear-band-smc")
    text = entry_config(record, row.name)
    gains = {one["name"]: one["gains"] for one in yaml.safe_load(text)["controllers"]}
    for level in record.levels:
        for seed, one in enumerate(picks(row, level)):
            (name,) = (x for x in gains if re.fullmatch(rf"tuned-{seed}-at-(\d+-)*{level:g}(-\d+)*", x))
            assert one is not None
            assert plain_gains(gains[name]) == one.gains
    assert (folder / "entries/slow/linear-band-smc.yaml").read_text() == text
    result = torquebench.run_experiment(torquebench.load_experiment(yaml.safe_load(text)))
    for one, found in zip(row.judged, result.to_dataframe()["rmse"], strict=True):
        assert found == pytest.approx(one.values["noise"]["rmse"][0], rel=1e-3)


def test_one_law_enters_beside_the_stored_rivals(
    folder: Path, tmp_path: Path, record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its row is that of an arena in which it was from the start; the rivals stay as they stand.

    What was interrupted after its last row goes on without a closed loop.
    """
    found = against(folder, laws=["pd"], folder=tmp_path / "new")
    assert found.record.rows[: len(record.rows)] == record.rows
    whole = {**STUDY, "controllers": [{"law": "pd", "gains": "auto"}]}
    (row,) = run_arena(store=False, study=whole, seed=3).record.rows
    assert found.record.rows[-1] == row
    assert {own.entry for own in found.standings("slow", 20.0)} >= {"pd", "pd-gravity"}
    with pytest.raises(ConfigError, match="no law enters"):
        against(folder, store=False)
    with pytest.raises(ConfigError, match="did you mean 'pd"):
        against(folder, laws=["pdd"], store=False)
    stored = (tmp_path / "new/arena.json").read_bytes()
    (tmp_path / "new/arena.json").unlink()
    monkeypatch.setattr("torquebench.arena.run.Trials", None)
    monkeypatch.setattr("torquebench.arena.run.tune_row", None)
    against(folder, laws=["pd"], folder=tmp_path / "new")
    assert (tmp_path / "new/arena.json").read_bytes() == stored
    with pytest.raises(ConfigError, match="another arena"):
        against(folder, laws=["pid"], folder=tmp_path / "new")


@pytest.mark.parametrize("error", [KeyboardInterrupt, Terminated])
def test_an_interrupted_arena_says_how_to_go_on(
    error: type[KeyboardInterrupt], tmp_path: Path, command: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command that it names has every option of the first one, and finds the draws that were sealed."""

    def interrupted(*_: object) -> None:
        raise error

    monkeypatch.setattr("torquebench.arenas.run_rows", interrupted)
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(STUDY))
    words = ["arena", tmp_path / "study.yaml", "--out", tmp_path / "out", "--quick", "--set", "arena.draws=4"]
    status, _, said = command(*words)
    assert status == (130 if error is KeyboardInterrupt else 143)
    again = shlex.split(said.split("go on with: ")[1])
    assert sorted(again[1:]) == sorted(map(str, words))
    sealed = (tmp_path / "out/seal.json").read_bytes()
    assert command(*again[1:]) == (status, "", said)
    assert (tmp_path / "out/seal.json").read_bytes() == sealed


def test_a_stored_study_that_names_no_laws_is_read_again(record: Record) -> None:
    """As the shipped one is, in which all laws enter: what is stored is that text."""
    text = "\n".join(line for line in record.study.splitlines() if "laws:" not in line)
    assert text != record.study
    assert list(_stored_study(replace(record, study=text)).tracks) == ["slow"]


def test_a_row_without_its_law_expires(record: Record) -> None:
    """It is shown and not ranked: one whose law is gone, and one whose law has changed."""
    a, b, *rest = record.rows
    old = replace(record, rows=(replace(a, law="gone", source="my_law.py"), replace(b, digest="0"), *rest))
    notes = {own.entry: own for own in old.standings("slow", 20.0)}
    assert notes[a.entry].rank is None
    assert notes[a.entry].note.endswith("is not there any more, unless --plugin names my_law.py")
    assert notes[b.entry].rank is None
    assert "has changed since" in notes[b.entry].note
    with pytest.raises(ResultError, match="expired"):
        entry_config(old, a.name)


def test_ranks_are_worked_out_once_and_again_when_a_law_has_changed(
    record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tables, figure and page share them; a caller that empties its list, and a law that expires, spoil nothing."""
    asked, again, known = list[int](), replace(record), record.standings("slow", 20.0)

    def counted(scores: Any, looks: int) -> Any:
        asked.append(len(scores))
        return rank(scores, looks=looks)

    monkeypatch.setattr("torquebench.arena.record.rank", counted)
    found = again.standings("slow", 20.0)
    assert found == known
    found.clear()
    assert len(again.standings("slow", 20.0)) == 3
    assert asked == [3]
    gone = again.rows[0].law
    monkeypatch.setattr("torquebench.arena.record.law_names", lambda: [x for x in law_names() if x != gone])
    assert [own.rank for own in again.standings("slow", 20.0) if own.entry == gone] == [None]
    assert asked == [3, 2]


def test_duels_are_those_that_make_the_ranks(record: Record) -> None:
    """Who is behind a rival is beaten by it with the inverse ratio (1e-12); the first rank counts rivals that beat it.

    One entry's errors are made a million times as large, so that there is something to tell with two tunings.
    """
    names = [row.entry for row in record.rows]
    worse = scaled(record, names[0], 1e6)
    every = {(name, one.rival): one for name in names for one in duels(worse, name, 20.0)}
    for (name, rival), one in every.items():
        other = every[rival, name]
        assert one.verdict == -other.verdict
        assert one.ratio[:3] == pytest.approx((1 / other.ratio.ratio, 1 / other.ratio.high, 1 / other.ratio.low), 1e-12)
    for own in worse.standings("slow", 20.0):
        verdicts = [one.verdict for (name, _), one in every.items() if name == own.entry]
        assert (own.rank, own.last) == (1 + verdicts.count(-1), len(names) - verdicts.count(1))
    assert any(one.verdict for one in every.values())
    with pytest.raises(ResultError, match=f"did you mean '{names[0]}'"):
        duels(record, f"{names[0]}x", 20.0)


def test_errors_under_each_burden_make_the_error_that_ranks(record: Record) -> None:
    """Their geometric mean is the standing's value where nothing fails (1e-12); beside it stands the best other one."""
    first, second, *_ = (own for own in record.standings("slow", 20.0))
    for entry, other in ((first, second), (second, first)):
        found = by_condition(record, entry.entry, 20.0)["slow"]
        assert list(found) == [entry.entry, other.entry]
        assert list(found[entry.entry]) == ["nominal", "noise", "payload"]
        product = found[entry.entry]["nominal"] * found[entry.entry]["noise"]
        assert product**0.5 == pytest.approx(entry.value, rel=1e-12)


def test_an_arena_without_ablations_says_so(record: Record, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In its tables, on its page and in the terminal; with one variant of a law there is nothing to say."""
    assert worth(record) in (folder / "arena.md").read_text()
    assert "No part of any law is taken out" in (folder / "report.html").read_text()
    assert main(["arena", str(folder), "--json"]) == 0
    assert any("No part of any law is taken out" in text for text in json.loads(capsys.readouterr().out)["remarks"])
    a, b, *rest = record.rows
    assert worth(replace(record, rows=(a, replace(b, law=a.law), *rest))) == ""


def test_who_enters_is_called_by_entry_or_law_and_takes_no_name(record: Record) -> None:
    """A law's name means all its entries; one that has the name of another law's entry is refused, not passed over."""
    own = {**STUDY, "controllers": [{"name": "mine", "law": "pd", "gains": "auto"}]}
    text = yaml.safe_dump(own)
    study = _stored_study(replace(record, study=text))
    assert _entries(study, ["mine"]) == _entries(study, ["pd"]) == ["mine"]
    own["controllers"][0]["name"] = "pid"
    with pytest.raises(ConfigError, match="'pid' does not enter: an entry of law 'pd' has its name"):
        _entries(_stored_study(replace(record, study=yaml.safe_dump(own))), ["pid"])


def test_stored_arenas_are_ranked_again_by_another_level_and_metric(record: Record) -> None:
    """No run is made; a level below all of them has nobody, and a metric that is not stored is refused."""
    assert [own.rank for own in record.standings("slow", 1e-9)] == [None] * 3
    assert {own.value for own in record.standings("slow", 20.0, "max_error")} != {
        own.value for own in record.standings("slow", 20.0)
    }
    with pytest.raises(ResultError, match="not stored"):
        record.scores(record.rows[0], 20.0, "effort")


def test_a_law_is_its_file_and_what_it_shares_with_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """A change of a function that a law calls in another file expires its rows, and those of no law that does not."""
    text = "import os\nfrom torquebench import sat\n"
    own = replace(find_law("pd"), function=SandboxedLaw(text, "own.py", "own", "own", "", ()))
    laws = find_law("smc"), own, find_law("pd")
    before = [digest_of.__wrapped__(law) for law in laws]
    for module in (sliding_mode, torquebench):
        monkeypatch.setattr(module, "sat", clip)
    assert [a == digest_of.__wrapped__(law) for a, law in zip(before, laws, strict=True)] == [False, False, True]


def test_a_level_between_those_of_the_arena_is_told(folder: Path, command: Any) -> None:
    """Whose gains are shown is said, above and below all levels too; nothing is said of a level of the arena."""
    told = {level: command("arena", folder, "--level", level)[1] for level in (1, 2, 7, 50)}
    assert "no level of this arena" not in told[2]
    for level, whose in ((1, "none, as a rule"), (7, "as a rule those of 2 %"), (50, "as a rule those of 20 %")):
        assert f"{level} % is no level of this arena" in told[level]
        assert whose in " ".join(told[level].split())


def test_a_file_reads_back_as_it_was_written(record: Record, tmp_path: Path) -> None:
    """What is read is what was written, and another file is refused with its name."""
    (tmp_path / "arena.json").write_bytes(record.to_json())
    assert read_record(tmp_path) == record
    for text in ("", "{}", "[1]", json.dumps({"format": 9})):
        (tmp_path / "arena.json").write_text(text)
        with pytest.raises(ResultError, match=r"arena\.json"):
            read_record(tmp_path)


def test_differences_are_relative_and_see_what_is_missing() -> None:
    """A figure off by a tenth, a run that failed in one alone, a value more."""
    assert difference({"a": [1.0, 2.0]}, {"a": (1.0, 2.2)}) == pytest.approx(0.2 / 2.2)
    assert difference([1.0, None], [1.0, 2.0]) == difference([1.0], [1.0, 1.0]) == float("inf")


def test_all_laws_enter_unless_listed() -> None:
    """Every registered law has an entry with gains of its own, beside those that the file lists."""
    own = {**STUDY, "controllers": [{"name": "mine", "law": "pd", "gains": "auto"}]}
    (track,) = study_of({**own, "arena": {**STUDY["arena"], "laws": "all"}}).tracks.values()
    assert sorted(one.law for one in track.base.controllers) == sorted(law_names())
    assert len(study_of(own).tracks["slow"].base.controllers) == 1


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"levels": [0.2, 0.1]}, r"arena\.levels.*rising"),
        ({"metric": "rmsee"}, r"arena\.metric.*did you mean 'rmse'"),
        ({"metric": "chattering"}, r"arena\.metric.*an error"),
        ({"seeds": 1}, r"arena\.seeds"),
        ({"training": {}}, r"arena\.training"),
        ({"burdens": {"a": {"chian": "slow"}}}, r"chian.*did you mean 'chain'"),
        ({"burdens": {"a": {"run.seed": 3}}}, r"run\.seed.*arena's own"),
        ({"burdens": {"a": {"controllers": []}}}, r"cannot be varied"),
        ({"held_out": {"nominal": {}}}, r"held_out\.nominal.*burden too"),
    ],
)
def test_mistakes_are_refused_with_their_place(section: dict[str, Any], message: str) -> None:
    """Each is named with its key, and what was wanted."""
    with pytest.raises(ConfigError, match=message):
        study_of(edited(**section))


def test_the_command_ranks_and_prints(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A stored arena as table, as JSON, as Markdown and as LaTeX; options that do not fit are refused."""
    stored = str(folder / "arena.json")
    assert main(["arena", stored]) == 0
    assert "slow, at 20 % chattering" in capsys.readouterr().out
    assert main(["arena", stored, "--json", "--metric", "max_error"]) == 0
    assert len(json.loads(capsys.readouterr().out)["standings"]) == 3 * 2
    for flag, word in (("--markdown", "## As given"), ("--latex", "\\toprule"), ("--config", "controllers:")):
        assert main(["arena", stored, flag, *(["slow/pd-gravity"] if flag == "--config" else [])]) == 0
        assert word in capsys.readouterr().out
    assert main(["arena", stored, "--law", "pd-gravity"]) == 0
    assert "of pd-gravity and of the best other law" in capsys.readouterr().out
    assert main(["arena", stored, "--against", stored]) == 2
    assert main(["arena", "studies/arena", "--check", "slow/pid"]) == 2
    assert main(["arena"]) == 2


def test_an_arena_is_a_table_and_a_figure(folder: Path) -> None:
    """A row for each entry, level, ruleset and set of conditions; a panel for each chain."""
    found = torquebench.read_arena(folder)
    assert isinstance(found, Arena)
    assert len(found.to_dataframe()) == 3 * 2 * 2 * 2
    assert [ax.get_title(loc="left") for ax in found.figure().axes] == ["slow"]
    with pytest.raises(ResultError, match="did you mean 'slow'"):
        found.standings("slo", 20.0)


def test_a_quick_look_is_the_first_chain_alone() -> None:
    """Few evaluations and draws; what is asked for besides is kept."""
    study = study_of(edited(chains={"fast": {"chain": "fast"}, "slow": {"chain": "slow"}}), quick=True)
    assert list(study.tracks) == ["fast"]
    assert (study.asked.evaluations, study.asked.seeds, study.asked.tests) == (4, 2, 2)
    assert study.asked.levels == (0.02, 0.2)


def test_the_page_of_the_docs_takes_an_arena_between_its_marks(record: Record) -> None:
    """What stands around them stays, and a second arena replaces the first."""
    page = runpy.run_path("scripts/arena_page.py")["page"]
    text = page("before\n<!-- arena -->\nEARLIER\n<!-- /arena -->\nafter\n", record)
    assert text.startswith("before\n<!-- arena -->\n## What came out\n")
    assert text.endswith("<!-- /arena -->\nafter\n")
    assert "EARLIER" not in text
    assert page(text, record) == text
    assert "<!-- arena -->" in Path("docs/arena.md").read_text(encoding="utf-8")


def test_the_shipped_study_is_valid_and_has_the_ablations() -> None:
    """Every law enters; beside the proposed one stand no FIS, clip(x + y), no integral and no band."""
    study = study_of("studies/arena")
    (track, *_) = study.tracks.values()
    options = {one.name: one.options for one in track.base.controllers if one.law == "fuzzy-linear-band-smc"}
    own = options["proposed"]
    changed = {
        name: {key: value for key, value in found.items() if value != own[key]} for name, found in options.items()
    }
    assert changed == {
        "proposed": {},
        "proposed-model": {"equivalent_control": True},
        "proposed-no-fuzzy": {"compensation": "off"},
        "proposed-clipped-sum": {"compensation": "clipped-sum"},
        "proposed-no-integral": {"integral": False},
        "proposed-no-band": {"band": "sign"},
    }
    assert {one.law for one in track.base.controllers} == set(law_names())
    assert {"step", "quintic"} & {one.experiment.to_dict()["reference"]["kind"] for one in track.training}


@pytest.mark.slow
def test_a_law_of_somebody_unknown_enters_in_a_process_of_its_own(folder: Path, tmp_path: Path) -> None:
    """A file outside the dialect runs in a process that has nothing but its inputs; its row names the file.

    9 s: each closed loop has a process, and asks it at each of its instants.
    """
    if sys.platform != "linux" or platform.machine() != "x86_64":
        pytest.skip("needs Linux on x86-64")
    file = tmp_path / "unknown_law.py"
    file.write_text(UNKNOWN)
    found = against(folder, plugins=[file], store=False)
    row = found.record.row("slow/unknown-law")
    assert row.source == file.name
    assert isinstance(find_law("unknown-law").function, SandboxedLaw)
    assert all(x is not None for one in row.judged for x in one.values["nominal"]["rmse"])


def scaled(record: Record, entry: str, factor: float, **changes: Any) -> Record:
    """Return an arena in which one entry's errors on test draws are so many times as large."""

    def of(values: Any) -> Any:
        return {
            name: {
                key: tuple(None if x is None else x * (factor if key == "rmse" else 1.0) for x in draws)
                for key, draws in metrics.items()
            }
            for name, metrics in values.items()
        }

    rows = tuple(
        replace(row, judged=tuple(replace(one, values=of(one.values)) for one in row.judged))
        if row.entry == entry
        else row
        for row in record.rows
    )
    return replace(record, rows=rows, **changes)


def test_a_worse_entry_passes_the_limit_and_no_other(folder: Path, record: Record, tmp_path: Path) -> None:
    """Three times the error of one entry: its ratio is 3, others keep 1 and no interval; other draws are refused."""
    file = tmp_path / "b.json"
    file.write_bytes(scaled(record, "pd-gravity", 3.0).to_json())
    found = diff(folder, file, ["rmse > 1.05"])
    for change in found.changes:
        if change.metric != "rmse":
            continue
        is_scaled = change.controller == "pd-gravity"
        assert change.ratio.ratio == pytest.approx(3.0 if is_scaled else 1.0, rel=1e-12)
        if not is_scaled:
            assert (change.ratio.low, change.ratio.high) == (1.0, 1.0)
    cases = {change.case for change in found.changes if change.controller == "pd-gravity"}
    assert cases == {f"slow, {text}" for text in ("as given", "2 %", "2 %, held out", "20 %", "20 %, held out")} & cases
    assert "slow, 20 %" in cases
    (row,) = (row for row in record.rows if row.entry == "pd-gravity")
    (other,) = (row for row in scaled(record, "pd-gravity", 3.0).rows if row.entry == "pd-gravity")
    known = compare(record.scores(other, 20.0), record.scores(row, 20.0))
    (own,) = (x for x in found.changes if x[:3] == ("pd-gravity", "slow, 20 %", "rmse"))
    assert own.ratio == known
    assert bool([text for text in found.broken if "slow, 20 %:" in text]) == (known.low > 1.05)
    assert all("pd-gravity" in text for text in found.broken)
    assert diff(folder, file).broken == ()
    file.write_bytes(replace(record, seal={**record.seal, "commitment": "0" * 64}).to_json())
    with pytest.raises(ConfigError, match="other draws"):
        diff(folder, file)
    with pytest.raises(ConfigError, match="two of one kind"):
        diff(folder, tmp_path)


def test_an_entry_that_is_gone_or_fails_is_told(
    folder: Path,
    record: Record,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """With a limit exit 1: a missing entry by its name, and failures with the runs and the exact McNemar p."""
    first, *rest = record.rows
    lost = replace(
        first,
        judged=tuple(
            replace(
                one,
                values={
                    **one.values,
                    "noise": {key: (None, *draws[1:]) for key, draws in one.values["noise"].items()},
                },
            )
            for one in first.judged
        ),
    )
    file = tmp_path / "arena.json"
    file.write_bytes(replace(record, rows=(lost, *rest[1:])).to_json())
    words = ["diff", str(folder), str(file), "--fail-if", "rmse > 1.05", "--json"]
    assert main(words) == 1
    found = json.loads(capsys.readouterr().out)
    assert any(f"'{rest[0].entry}'" in text and "missing" in text for text in found["broken"])
    assert any(f"'{first.entry}'" in text and "fails in B only, in 1 of" in text for text in found["broken"])
    for one in found["ended"]:
        assert (one["outcomes"]["first"], one["outcomes"]["second"], one["outcomes"]["p"]) == (1, 0, 1.0)
    assert all(change["ratio"]["ratio"] is not None for change in found["changes"])


def test_what_is_said_of_the_arena_stands_in_its_tables() -> None:
    """Each ratio with its interval, and each error with its rank, of the sentences is a figure of the tables below."""
    text, tables = Path("docs/arena.md").read_text(encoding="utf-8").split("<!-- arena -->")
    said = text.split("## What may be said of it")[1].split("\n## ")[0]
    ratios = re.findall(r"x[\d.]+ \[[\d.]+, [\d.]+\]", said)
    placed = re.findall(r"([\d.]+)(?: mrad)?, (?:rank )?(\d+-\d+)[;.]", said)
    assert len(ratios) == 6
    assert len(placed) == 5
    assert [x for x in ratios if f"| {x} |" not in tables] == []
    assert [x for x in placed if f"| {x[1]}: {x[0]} |" not in tables] == []

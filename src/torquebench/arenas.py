"""Arenas from Python: laws tuned alike and ranked; one more law set beside stored rivals; a row made again."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.arena.pages import Duel, by_condition, duels, latex, markdown, write_files
from torquebench.arena.ranking import Standing
from torquebench.arena.record import RULESETS, SHIPPED, TUNED, Record, Row, digest_of, picks, read_record
from torquebench.arena.run import Entry, draws_of, loops_of, run_rows
from torquebench.arena.study import Study, Track, take_study
from torquebench.begun import BEGUN
from torquebench.errors import ConfigError, Problem, ResultError, did_you_mean
from torquebench.experiment.dump import dump_experiment
from torquebench.experiment.folder import write_experiment
from torquebench.experiment.run import Progress
from torquebench.experiment.schema import Experiment
from torquebench.experiment.seal import commitment, new_secret, seed_of, today
from torquebench.experiment.source import apply_overrides, read_document, set_key
from torquebench.experiment.store import (
    MANIFEST,
    RunDirectory,
    atomic_write,
    claim_folder,
    json_bytes,
    machine,
    versions,
)
from torquebench.experiment.yaml_tree import value_at
from torquebench.keys import altered
from torquebench.laws import find_law, law_names
from torquebench.robot.library import ArmFile, arm_name
from torquebench.sim.sandbox import load_sandboxed
from torquebench.sweep.tune import threads
from torquebench.sweeps import document_from

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

RECORD, SEAL, ROWS = "arena.json", "seal.json", "rows"
QUICK = ("arena.evaluations=4", "arena.seeds=2", "arena.draws=2", "arena.looks=1")
"""Changes that make a look of an arena, on its first chain alone."""
ALIKE, NOTHING = 1.1e-3, 1e-9
"""Largest difference of a row's figures, made again, from the stored ones: their last digit [1]; what is less
than the other one is none."""


class Arena:
    """An arena that was run, or read.

    Args:
        record: What it left.
        folder: Where it is stored; None for nowhere.
    """

    def __init__(self, record: Record, folder: Path | None = None) -> None:
        self.record, self.folder = record, folder

    def standings(
        self, chain: str, level: float, metric: str = "", ruleset: str = TUNED, held_out: bool = False
    ) -> list[Standing]:
        """Return where each entry stands on a chain, the best first; see `Record.standings`.

        Args:
            chain: The chain.
            level: Chattering that gains do not exceed where they were tuned [% of the torque limit].
            metric: What is compared; the arena's own if left out.
            ruleset: ``tuned``, or ``self`` for the gains that entries have by themselves.
            held_out: Whether under the held-out conditions instead of the burdens.
        """
        for what, value, known in (("chain", chain, self.record.chains), ("ruleset", ruleset, tuple(RULESETS))):
            if value not in known:
                raise ResultError(f"no {what} '{value}'{did_you_mean(value, known)}")
        return self.record.standings(chain, level, metric, ruleset, held_out)

    def duels(self, entry: str, level: float, metric: str = "") -> list[Duel]:
        """Return an entry's duels with all others on each chain; see `duels`."""
        return duels(self.record, entry, level, metric)

    def by_condition(self, entry: str, level: float, metric: str = "") -> dict[str, dict[str, dict[str, float]]]:
        """Return the errors of an entry and of the best other one under each condition; see `by_condition`."""
        return by_condition(self.record, entry, level, metric)

    def to_dataframe(self) -> pd.DataFrame:
        """Return a row for each chain, level, ruleset and entry: rank, error, interval, chattering, failures."""
        import pandas as pd

        return pd.DataFrame(
            [
                {"chain": chain, "level": level, "ruleset": ruleset, "held_out": held} | standing._asdict()
                for chain in self.record.chains
                for level in self.record.levels
                for ruleset in RULESETS
                for held in (False, True)[: 1 + bool(self.record.held_out)]
                for standing in self.record.standings(chain, level, "", ruleset, held)
            ]
        )

    def markdown(self) -> str:
        """Return the tables as Markdown."""
        return markdown(self.record)

    def latex(self) -> str:
        """Return the tables as LaTeX, for booktabs."""
        return latex(self.record)

    def figure(self) -> Figure:
        """Draw the front of every law, error against chattering on test draws: a panel for each chain."""
        from torquebench.arena.figures import fronts

        return fronts(self.record)

    def save(self, folder: str | Path) -> None:
        """Write everything into a folder, new or empty."""
        _write(self.record, RunDirectory(claim_folder(Path(folder), self.record.name)))

    def __repr__(self) -> str:
        """Name the arena and its size."""
        entries = {row.entry for row in self.record.rows}
        return f"<Arena {self.record.name}: {len(entries)} entries, {len(self.record.chains)} chains>"


def run_arena(
    study: str | Path | Mapping[str, Any],
    *,
    folder: str | Path | None = None,
    store: bool = True,
    changes: Mapping[str, Any] | Sequence[str] = (),
    workers: int | None = None,
    plugins: Sequence[str | Path] = (),
    seed: int | None = None,
    quick: bool = False,
    progress: Progress | None = None,
) -> Arena:
    """Tune every law alike, judge it on draws that no tuning saw, and rank.

    Args:
        study: A config with a section ``arena``: its file, the name of a shipped one, or its keys.
        folder: Where to store it: new, empty, or one in which this arena was begun, which then goes on; None for
            ``runs/NAME-UTC``.
        store: Whether to store anything.
        changes: Dotted key -> value, or edits ``key=value``, set before the check.
        workers: How many closed loops run at once; None for one per core. Results do not depend on it.
        plugins: Python files that register laws of your own, which enter. What is outside the dialect runs in a process
            that has nothing but a law's inputs; see `load_sandboxed`.
        seed: Seed of the test draws; None for a secret one, of which the hash is written before the first run and
            which is revealed after the last.
        quick: Whether for a look: a handful of evaluations and draws, on the first chain alone.
        progress: Called with what is being done, how many closed loops are run, and of how many.

    Raises:
        ConfigError: the study has mistakes, or the folder holds something else.
    """
    added = _load(plugins)
    asked = study_of(study, changes, quick)
    if asked.asked.laws == "all":
        _entries(asked, added)
    secret = new_secret() if seed is None else f"seed {seed}"
    wanted = [(track, own) for track in asked.tracks.values() for own in track.base.controllers]
    directory = None
    if store:
        directory, secret = _claim(None if folder is None else Path(folder), asked, wanted, secret)
    wanted = [(track.sealed(seed_of(secret)), own) for track, own in wanted]
    rows = None if directory is None else directory.folder / ROWS
    record = _record(asked, secret)
    record = replace(record, rows=_run(asked, wanted, record, workers, rows, progress))
    if directory is not None:
        _write(record, directory)
    return Arena(record, None if directory is None else directory.folder)


def read_arena(path: str | Path, plugins: Sequence[str | Path] = ()) -> Arena:
    """Read what an arena left; it is ranked again, nothing is run.

    Args:
        path: ``arena.json``, or its folder.
        plugins: Python files that register laws which do not ship; without them their rows have expired.

    Raises:
        ResultError: it is no such file.
    """
    _load(plugins)
    return Arena(read_record(Path(path)))


def against(
    path: str | Path,
    *,
    laws: Sequence[str] = (),
    plugins: Sequence[str | Path] = (),
    folder: str | Path | None = None,
    store: bool = True,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Arena:
    """Tune and judge laws alone, with the budget and on the draws of a stored arena, beside its rivals as they stand.

    Args:
        path: ``arena.json``, or its folder.
        laws: Names of the laws, or of the stored entries that are made anew; the laws that the plug-ins add if left
            out. Each enters with ``gains: auto``.
        plugins: Python files that register them.
        folder: Where to store the arena with them: new, empty, or one in which the same was begun, which then goes on;
            None for ``runs/NAME-UTC``.
        store: Whether to store anything.
        workers, progress: As of `run_arena`.

    Raises:
        ConfigError: no law enters, or one has no ``gains: auto``.
        ResultError: the file is no arena.
    """
    added = _load(plugins)
    record = read_record(Path(path))
    entering = list(laws) or added
    if not entering:
        raise ConfigError([Problem("--against", "", "no law enters", wanted="--plugin FILE, or --law NAME")])
    study = _stored_study(record)
    entries = _entries(study, entering)
    rivals = replace(record, rows=tuple(row for row in record.rows if row.entry not in entries))
    wanted = _wanted(rivals, study, entries, record.chains)
    directory = None
    if store:
        own = None if folder is None else Path(folder)
        others = hashlib.sha256(rivals.to_json()).hexdigest()
        directory, _ = _claim(own, study, wanted, record.seal["secret"], [others])
    stored = None if directory is None else directory.folder / ROWS
    rows = _run(study, wanted, rivals, workers, stored, progress)
    found = replace(record, rows=rivals.rows + rows, date=today(), software=versions(), machine=machine())
    if directory is not None:
        _write(found, directory)
    return Arena(found, None if directory is None else directory.folder)


def check_row(
    path: str | Path,
    name: str,
    *,
    plugins: Sequence[str | Path] = (),
    workers: int | None = None,
    progress: Progress | None = None,
) -> float:
    """Make a row again from the file alone, tuning included, and return how far it is from what is stored.

    The largest relative difference of any figure: gains, training figures and every test run; infinite where a run
    failed in one of them alone.

    Args:
        path: ``arena.json``, or its folder.
        name: ``CHAIN/ENTRY``.
        plugins: Python files that register its law, if it does not ship.
        workers, progress: As of `run_arena`.

    Raises:
        ResultError: there is no such row, or it has expired.
    """
    _load(plugins)
    record = read_record(Path(path))
    row = record.row(name)
    if row.state:
        raise ResultError(f"row '{name}' {row.state}")
    study = _stored_study(record)
    wanted, stored = _wanted(record, study, [row.entry], [row.chain]), list(map(draws_of, row.judged))

    def draws(made: Row) -> list[int]:
        return (stored + [max(stored)] * len(made.judged))[: len(made.judged)]

    (made,) = _run(study, wanted, record, workers, None, progress, draws)
    return difference(asdict(row), asdict(made))


def difference(a: Any, b: Any) -> float:
    """Return the largest relative difference of two trees of plain values; infinite where they are not alike."""
    if isinstance(a, dict) and isinstance(b, dict) and a.keys() == b.keys():
        return max((difference(a[key], b[key]) for key in a), default=0.0)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple) and len(a) == len(b):
        return max(map(difference, a, b), default=0.0)
    if isinstance(a, float) and isinstance(b, float):
        return abs(a - b) / max(abs(a), abs(b)) if abs(a - b) > NOTHING else 0.0
    return 0.0 if a == b else float("inf")


def entry_config(record: Record, name: str) -> str:
    """Return the config that replays a row: every set of gains that was judged, on its chain, in the first test draw.

    Args:
        record: The arena.
        name: ``CHAIN/ENTRY``.

    Raises:
        ResultError: there is no such row, or it has expired.
    """
    row = record.row(name)
    if row.state:
        raise ResultError(f"row '{name}' {row.state}")
    track = _stored_study(record).tracks[row.chain].sealed(seed_of(record.seal["secret"]))
    return dump_experiment(replay_of(track, row, record.levels))


def replay_of(track: Track, row: Row, levels: Sequence[float]) -> Experiment:
    """Return the experiment that replays a row under the last burden, which is the heaviest where there is an order.

    Args:
        track: The row's chain, with its tests sealed.
        row: The row.
        levels: Chattering at which laws are compared, which names the controllers [% of the torque limit].

    Raises:
        ResultError: the study has no such entry, as of a forged file.
    """
    own = next((controller for controller in track.base.controllers if controller.name == row.entry), None)
    if own is None:
        raise ResultError(f"row '{row.name}' is of no entry of the arena's study")
    controllers = []
    for i, one in enumerate(row.judged):
        name = "as-given"
        if one.seed is not None:
            at = [f"{level:g}".replace(".", "p") for level in levels if picks(row, level)[one.seed] is one]
            name = f"tuned-{one.seed}-at-{'-'.join(at) or f'none-{i}'}"
        controllers.append(replace(own, name=name, gains=dict(one.gains)))
    experiment = track.burdens[-1].experiment
    words = (
        f"{row.name}: the gains that were judged, under {track.burdens[-1].name}; those of tuned-K-at-L are what "
        "tuning K found for a chattering of L %, the mean over its training conditions: one burden may have more."
    )
    if row.source != SHIPPED:
        words += f" Run it with --plugin {row.source}."
    name = f"{row.entry}-{row.chain}"[:64].rstrip("-")
    return altered(experiment, controllers=tuple(controllers), name=name, description=words)


def _load(plugins: Sequence[str | Path]) -> list[str]:
    """Register the laws of files and return their names; one outside the dialect runs in a process of its own."""
    return [law for file in plugins for law in load_sandboxed(Path(file))]


def study_of(
    study: str | Path | Mapping[str, Any], changes: Mapping[str, Any] | Sequence[str] = (), quick: bool = False
) -> Study:
    """Return a study, checked; arguments as of `run_arena`.

    Raises:
        ConfigError: it has mistakes; all of them at once.
    """
    document = document_from(study, changes)
    if quick:
        apply_overrides(document, QUICK)
        chains = value_at(document.root, ("arena", "chains"), None)
        for name in list(chains)[1:] if isinstance(chains, dict) else ():
            del chains[name]
    return take_study(document)


def _stored_study(record: Record) -> Study:
    """Return the study of a stored arena, with laws that it may not have known."""
    document = read_document(record.study, RECORD)
    for path, text in record.arms.items():
        document.arms[path] = None, ArmFile(arm_name(path), text)
    set_key(document, "arena.laws", "all")
    return take_study(document)


def _entries(study: Study, wanted: Sequence[str]) -> list[str]:
    """Return the entries that are called by a name, or by their law's.

    Raises:
        ConfigError: there is none of a name; a law that has the name of another one's entry does not enter.
    """
    laws = {own.name: own.law for track in study.tracks.values() for own in track.base.controllers}
    found = {name: [own for own, law in laws.items() if name in (own, law)] for name in wanted}
    wrong = [Problem("", "law", f"no law '{name}'{did_you_mean(name, laws)}") for name, own in found.items() if not own]
    for name in law_names():
        if name in wanted and name in laws and name not in laws.values():
            text = f"law '{name}' does not enter: an entry of law '{laws[name]}' has its name"
            wrong.append(Problem("", "law", text, wanted="another name"))
    if wrong:
        raise ConfigError(wrong)
    return list(dict.fromkeys(own for names in found.values() for own in names))


def _wanted(record: Record, study: Study, entries: Sequence[str], chains: Sequence[str]) -> list[Entry]:
    """Return chain, with its tests sealed as in a stored arena, and entry of rows."""
    secret = seed_of(record.seal["secret"])
    return [
        (track.sealed(secret), controller)
        for name, track in study.tracks.items()
        if name in chains
        for controller in track.base.controllers
        if controller.name in entries
    ]


def _run(
    study: Study,
    wanted: Sequence[Entry],
    beside: Record,
    workers: int | None,
    folder: Path | None,
    progress: Progress | None,
    draws: Callable[[Row], Sequence[int]] | None = None,
) -> tuple[Row, ...]:
    total, done = sum(sum(loops_of(study, track)) for track, _ in wanted), 0

    def tell(what: str, loops: int) -> None:
        nonlocal done
        done += loops
        if progress is not None:
            progress(what, done, total)

    with threads(workers or os.cpu_count() or 1) as pool:
        return run_rows(study, wanted, pool, beside, folder, tell, draws)


def _record(study: Study, secret: str) -> Record:
    """Return the arena of a study, without rows."""
    asked = study.asked
    return Record(
        name=study.name,
        date=today(),
        software=versions(),
        machine=machine(),
        study=study.text,
        arms=dict(study.arms),
        seal={"commitment": commitment(secret), "secret": secret},
        metric=asked.metric,
        metrics=asked.stored,
        levels=tuple(100.0 * level for level in asked.levels),
        chains=tuple(study.tracks),
        burdens=tuple(asked.burdens),
        held_out=tuple(asked.held_out),
        evaluations=asked.evaluations,
        seeds=asked.seeds,
        draws=asked.tests,
        looks=asked.looks,
        rows=(),
    )


def _claim(
    folder: Path | None, study: Study, wanted: Sequence[Entry], secret: str, more: Sequence[str] = ()
) -> tuple[RunDirectory, str]:
    """Return the folder to write to, and the secret of the test draws, whose hash is there before the first run.

    Args:
        folder: New, empty, or one in which the same rows of the same laws were begun; None for ``runs/NAME-UTC``.
        study: The study.
        wanted: Chain and entry of each row.
        secret: The secret, unless the folder has one.
        more: What else rows depend on.
    """
    laws = sorted({(own.name, own.law, digest_of(find_law(own.law))) for _, own in wanted})
    parts = [study.text, *sorted(study.arms.items()), *laws, *more]
    digest = hashlib.sha256(json.dumps(parts).encode()).hexdigest()
    if folder is not None and (folder / SEAL).is_file():
        kept = json.loads((folder / SEAL).read_bytes())
        if kept.get("study") != digest:
            text = f"{folder} holds another arena, or of laws that have changed since, wanted a new or empty folder"
            raise ConfigError([Problem("--out", "", text)])
        (folder / MANIFEST).unlink(missing_ok=True)
        BEGUN.append(folder)
        return RunDirectory(folder), str(kept["secret"])
    directory = RunDirectory(claim_folder(folder, study.name))
    kept = {"study": digest, "commitment": commitment(secret), "secret": secret}
    atomic_write(directory.folder / SEAL, json_bytes(kept))
    return directory, secret


def _write(record: Record, directory: RunDirectory) -> None:
    """Write the files of an arena; the manifest last."""
    directory.write(RECORD, record.to_json())
    study = _stored_study(record)
    tracks = {name: track.sealed(seed_of(record.seal["secret"])) for name, track in study.tracks.items()}
    for row in record.rows:
        if not row.state:
            replay = replay_of(tracks[row.chain], row, record.levels)
            write_experiment(directory, replay, f"entries/{row.chain}/{row.entry}.yaml")
    for name, content in write_files(record):
        directory.write(name, content)
    directory.finish({"name": record.name, "arena": True})

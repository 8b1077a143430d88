"""``torquebench arena``: every law tuned alike, judged on draws that no tuning saw, and ranked."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.begun import BEGUN
from torquebench.cli.app import command
from torquebench.cli.parameters import (
    Config,
    File,
    Number,
    Words,
    argument,
    option,
    out_folder,
    plugins,
    refuse,
    settings,
)
from torquebench.cli.parameters import workers as workers_option
from torquebench.cli.terminal import complain, emit, following, progress_bar, say, table, tell, warn

if TYPE_CHECKING:
    from torquebench.arena.pages import Duel
    from torquebench.arena.record import Record
    from torquebench.arenas import Arena

STORED = ".json"


class Subject(Config):
    """A config with a section ``arena``, or what an arena left."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return its path."""
        path = Path(str(value))
        return (
            path if path.suffix == STORED or (path / f"arena{STORED}").is_file() else super().convert(value, param, ctx)
        )


@command(example="torquebench arena studies/arena --quick")
@argument(
    "subject",
    type=Subject(),
    required=False,
    help="config with a section `arena`, a file or a shipped one; or a stored arena.json, which is ranked again",
)
@out_folder(help="folder for the results: new, empty, or one in which this arena was begun (default: runs/NAME-UTC)")
@option("--quick", is_flag=True, help="a handful of evaluations and draws on the first chain: for a look")
@option("--against", type=File(STORED), metavar="FILE", help="judge the law of --plugin beside a stored arena's")
@option(
    "--law",
    type=Words(),
    default=None,
    metavar="NAME,...",
    help="with --against: the laws that enter; with a stored arena: the entries that are set beside all others",
)
@option("--check", metavar="ROW", help="make a row of a stored arena again, such as slow/pid, and compare every figure")
@option("--config", "replay", metavar="ROW", help="print the config that replays a row of a stored arena")
@option("--metric", metavar="METRIC", help="rank a stored arena by another metric that it has")
@option(
    "--level", type=Number(float, 0.0), metavar="PERCENT", help="chattering of the tables (default: the middle one)"
)
@option("--markdown", "as_markdown", is_flag=True, help="print the tables as Markdown")
@option("--latex", "as_latex", is_flag=True, help="print the tables as LaTeX")
@workers_option(help="how many closed loops run at once (default: one per core)")
@settings(help="change one key, for example arena.evaluations=50")
@plugins
def arena(
    subject: Path | None,
    out: Path | None,
    quick: bool,
    against: Path | None,
    law: Sequence[str] | None,
    check: str | None,
    replay: str | None,
    metric: str | None,
    level: float | None,
    as_markdown: bool,
    as_latex: bool,
    workers: int | None,
    overrides: Sequence[str],
    plugin: Sequence[Path],
) -> int:
    """Tune every law alike and rank the laws with ties.

    Laws are compared at equal chattering, by paired draws that no tuning saw; a difference below the spread of tunings
    is a tie. The page, the figure and arena.json hold everything.
    """
    from torquebench.arenas import against as enter
    from torquebench.arenas import read_arena, run_arena

    is_stored = subject is not None and (subject.suffix == STORED or subject.is_dir())
    if (subject is None) == (against is None):
        refuse([("SUBJECT", "wanted: either a study or stored arena, or --against FILE")])
    wrong = [("--check", check), ("--config", replay), ("--metric", metric)]
    refuse([(name, "is for a stored arena.json") for name, value in wrong if value and not is_stored])
    if check is not None or replay is not None:
        path = subject or Path()
        return _check(path, check, plugin, workers) if check else _replay(path, str(replay), plugin)
    try:
        with progress_bar(0, "loop", "starting (compiles on first use)") as bar:
            if against is not None:
                found = enter(
                    against, laws=law or (), plugins=plugin, folder=out, workers=workers, progress=following(bar)
                )
            elif is_stored:
                found = read_arena(subject or Path(), plugin)
            else:
                found = run_arena(
                    str(subject),
                    folder=out,
                    changes=overrides,
                    quick=quick,
                    workers=workers,
                    plugins=plugin,
                    progress=following(bar),
                )
    except KeyboardInterrupt as error:  # SIGTERM is one too
        if not BEGUN:
            raise
        words = [str(subject)] if against is None else ["--against", str(against)]
        words += ["--law", ",".join(law)] if law else []
        words += ["--quick"] if quick else []
        words += [word for text in overrides for word in ("--set", text)]
        words += [word for file in plugin for word in ("--plugin", str(file))]
        again = shlex.join(["torquebench", "arena", *words, "--out", str(BEGUN[-1])])
        raise type(error)(f"what is done is kept, go on with: {again}") from error
    if as_markdown or as_latex:
        emit(found.markdown() if as_markdown else found.latex())
        return 0
    files = {file.name for file in plugin}
    own = [*(law or ()), *(row.entry for row in found.record.rows if row.source in files)]
    report(found, metric or "", level, list(dict.fromkeys(own)))
    if found.folder is not None:
        more = "".join(f" --plugin {shlex.quote(str(file))}" for file in plugin)
        first = next((row for row in found.record.rows if row.entry in own), found.record.rows[0])
        say(f"results: {found.folder}; ranked again from there, and a row's film:")
        say(f"torquebench arena {shlex.quote(str(found.folder))}{more}", fold=False)
        config = shlex.quote(str(found.folder / "entries" / f"{first.name}.yaml"))
        say(f"torquebench run {config}{more} --set 'video={{}}'", fold=False)
    return 0


def _check(path: Path, name: str, plugin: Sequence[Path], workers: int | None) -> int:
    """Make a row again and compare."""
    from torquebench.arenas import ALIKE, check_row

    with progress_bar(0, "loop", f"making {name} again") as bar:
        most = check_row(path, name, plugins=plugin, workers=workers, progress=following(bar))
    tell(row=name, difference=most, reproduced=most <= ALIKE)
    say(f"{name}: every figure within {most:.2g} of what is stored")
    if most > ALIKE:
        complain(f"torquebench: row '{name}' is not reproduced: a figure is off by {most:.3g}, allowed is {ALIKE:g}")
    return 0 if most <= ALIKE else 1


def _replay(path: Path, name: str, plugin: Sequence[Path]) -> int:
    """Print the config of a row."""
    from torquebench.arenas import entry_config, read_arena

    record = read_arena(path, plugin).record
    emit(entry_config(record, name).rstrip("\n"))
    if record.arms:
        warn("torquebench: it needs its arm beside it; a folder that an arena wrote has both in entries/CHAIN")
    return 0


def report(found: Arena, metric: str = "", level: float | None = None, own: Sequence[str] = ()) -> None:
    """Say what came out: a dot for each chain and level, a table for each chain, and entries beside all others.

    Args:
        found: The arena.
        metric: What ranks; the arena's own if left out.
        level: Chattering of the tables; the middle level if left out.
        own: Entries that are set beside all others.
    """
    from torquebench.arena.pages import (
        HEAD,
        KEY,
        budget,
        by_rank,
        cells,
        dots,
        level_remark,
        lines,
        main_level,
        unit_of,
        worth,
    )

    record = found.record
    level = main_level(record) if level is None else level
    every = lines(record, metric, sorted({*record.levels, level}))
    duels = {entry: found.duels(entry, level, metric) for entry in own}
    conditions = {entry: found.by_condition(entry, level, metric) for entry in own}
    remark = level_remark(record, level)
    tell(
        directory=found.folder,
        budget={key: getattr(record, key) for key in ("evaluations", "seeds", "draws")},
        remark=remark,
        standings=[{"chain": line.chain, "level": line.level} | line.standing._asdict() for line in every],
        duels=duels,
        conditions=conditions,
    )
    say(f"{budget(record)}.")
    say()
    rows = [[entry, *(text for _, text in dots(record, entry, every))] for entry in by_rank(record, every)]
    say(table(["law", *record.chains], rows, left=1 + len(record.chains)))
    levels = ", ".join(f"{own:g} %" for own in sorted({*record.levels, level}))
    say(f"{KEY}; a dot for each level of chattering: {levels}")
    if remark:
        say(f"{remark}.")
    unit = unit_of(record, metric)[0]
    for chain in record.chains:
        shown = [cells(record, line, metric) for line in every if line.chain == chain and line.level == level]
        head = [f"error [{unit}]" if title == "error" else title for title in HEAD]
        kept = [i for i in range(len(head)) if any(row[i] not in ("", "-") for row in shown) or i < 2]
        say()
        say(f"{chain}, at {level:g} % chattering")
        say(table([head[i] for i in kept], [[row[i] for i in kept] for row in shown], left=2, keys=2))
    for entry in own:
        _say_duels(record, entry, duels[entry], level)
        _say_conditions(record, entry, conditions[entry], metric)
    if alone := worth(record):
        warn(f"torquebench: {alone}")


def _say_duels(record: Record, entry: str, duels: Sequence[Duel], level: float) -> None:
    """Say whom an entry beats and who beats it on each chain."""
    from torquebench.arena.pages import ratio_text

    marks = {1: "beats", -1: "behind", 0: "ties"}
    told = {(one.rival, one.chain): f"{marks[one.verdict]} {ratio_text(one.ratio)}" for one in duels}
    score = {rival: sum(one.verdict for one in duels if one.rival == rival) for rival, _ in told}
    rivals = sorted({one.rival for one in duels if one.verdict}, key=lambda rival: (score[rival], rival))
    say()
    for chain in record.chains:
        counts = [sum(one.verdict == sign for one in duels if one.chain == chain) for sign in marks]
        text = f"beats {counts[0]}, is behind {counts[1]}, ties with {counts[2]}" if any(counts) else "is not ranked"
        say(f"{chain}: {entry} {text}")
    if rivals:
        say()
        say(f"{entry} against the others at {level:g} % chattering: its error over theirs [95 %]")
        rows = [[rival, *(told.get((rival, chain), "-") for chain in record.chains)] for rival in rivals]
        say(table(["law", *record.chains], rows, left=1 + len(record.chains)))


def _say_conditions(
    record: Record, entry: str, conditions: Mapping[str, Mapping[str, Mapping[str, float]]], metric: str
) -> None:
    """Say an entry's errors under each condition of each chain beside the best other one's."""
    from torquebench.arena.pages import number, unit_of

    if conditions:
        unit, scale = unit_of(record, metric)
        names = [*record.burdens, *record.held_out]
        say()
        say(f"error under each condition [{unit}], of {entry} and of the best other law")
        rows = [
            [chain, name, *(number(means[condition] * scale) for condition in names)]
            for chain, both in conditions.items()
            for name, means in both.items()
        ]
        say(table(["chain", "law", *names], rows, left=2, keys=2))

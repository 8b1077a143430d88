"""The files of an arena: tables as Markdown and LaTeX, the figure, and a page that stands alone."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from torquebench.arena.ranking import TOLERANCE, Standing, compare, mean_over_runs, verdict
from torquebench.arena.record import RULESETS, SELF, TUNED, Record, Row
from torquebench.errors import ResultError, did_you_mean
from torquebench.metrics import METRICS
from torquebench.report.tables import Cells
from torquebench.statistics import Ratio

BEST, MIDDLE, OTHER, NONE = "●", "◐", "○", "·"
KEY = f"{BEST} nobody is better, {MIDDLE} a rank in the first half, {OTHER} behind, {NONE} not ranked"


class Line(NamedTuple):
    """A line of the tables: an entry on a chain at a level."""

    chain: str
    level: float
    standing: Standing
    held_out: Standing | None
    given: Standing | None
    """Where it stands with the gains that it has by itself."""


def main_level(record: Record) -> float:
    """Return the level of chattering of tables that have one alone: the middle one."""
    return record.levels[len(record.levels) // 2]


def level_remark(record: Record, level: float) -> str:
    """Return whose gains are shown at a level of chattering that is none of the arena's; nothing at one that is."""
    if level in record.levels:
        return ""
    picked = " and ".join(f"{own:g}" for own in record.levels)
    below = max((own for own in record.levels if own < level), default=None)
    nearest = "none, as a rule" if below is None else f"as a rule those of {below:g} %"
    return (
        f"{level:g} % is no level of this arena: no gains were picked for it. Of those picked for {picked} %, each "
        f"tuning's best are shown that chattered by no more than {level:g} % where they were tuned: {nearest}"
    )


def lines(record: Record, metric: str = "", levels: Sequence[float] = ()) -> list[Line]:
    """Return every line, chain by chain, the best first.

    Args:
        record: The arena.
        metric: What ranks; the arena's own if left out.
        levels: Levels of chattering; the arena's own if left out.
    """
    found = list[Line]()
    for chain in record.chains:
        for level in levels or record.levels:
            held = _by_entry(record, chain, level, metric, TUNED, True) if record.held_out else {}
            given = _by_entry(record, chain, level, metric, SELF, False)
            for standing in record.standings(chain, level, metric):
                found.append(Line(chain, level, standing, held.get(standing.entry), given.get(standing.entry)))
    return found


def _by_entry(
    record: Record, chain: str, level: float, metric: str, ruleset: str, held_out: bool
) -> dict[str, Standing]:
    return {own.entry: own for own in record.standings(chain, level, metric, ruleset, held_out)}


def dots(record: Record, entry: str, found: Sequence[Line]) -> list[tuple[str, str]]:
    """Return a dot for each level of each chain: where an entry stands.

    Args:
        record: The arena.
        entry: The entry.
        found: Lines of all levels.
    """
    told = []
    for chain in record.chains:
        marks = ""
        for level in dict.fromkeys(line.level for line in found):
            here = [line.standing for line in found if line.chain == chain and line.level == level]
            own = next((one.rank for one in here if one.entry == entry), None)
            count = sum(one.rank is not None for one in here)
            marks += NONE if own is None else BEST if own == 1 else MIDDLE if own <= 0.5 * count else OTHER
        told.append((chain, marks))
    return told


def by_rank(record: Record, found: Sequence[Line]) -> list[str]:
    """Return the entries, those first that rank best over all chains and levels; what is not ranked counts as last."""
    last = len({row.entry for row in record.rows})
    total = {row.entry: 0.0 for row in record.rows}
    for line in found:
        total[line.standing.entry] += line.standing.rank or last
    return sorted(total, key=lambda entry: total[entry])


def unit_of(record: Record, metric: str = "") -> tuple[str, float]:
    """Return the unit of the metric that ranks, and by how much SI values are multiplied."""
    info = METRICS[metric or record.metric]
    return info.shown_unit, info.scale


def overview(record: Record, level: float, metric: str = "", ruleset: str = TUNED) -> Cells:
    """Return a row for each entry, and for each chain its rank and error.

    Args:
        record: The arena.
        level: Level of chattering.
        metric: As of `lines`.
        ruleset: One of `RULESETS`.
    """
    unit, scale = unit_of(record, metric)
    tables = {chain: _by_entry(record, chain, level, metric, ruleset, False) for chain in record.chains}
    order = by_rank(record, [Line(c, level, own, None, None) for c, table in tables.items() for own in table.values()])
    rows = []
    for entry in order:
        cells = [entry]
        for table in tables.values():
            own = table.get(entry)
            cells.append("-" if own is None or own.rank is None else f"{ranks(own)}: {number(own.value * scale)}")
        rows.append(cells)
    return ["law", *(f"{chain}: rank, {METRICS[metric or record.metric].title} [{unit}]" for chain in tables)], rows


HEAD = ("rank", "law", "error", "95 %", "tuning", "chattering [%]", "failed", "held out", "as given", "note")


def cells(record: Record, line: Line, metric: str = "") -> list[str]:
    """Return a line's cells, as `HEAD` names them; `tuning` is the largest tuning's mean over the smallest's."""
    _, scale = unit_of(record, metric)
    own = line.standing
    known = own.value == own.value
    return [
        ranks(own),
        own.entry,
        number(own.value * scale),
        f"{number(own.low * scale)} to {number(own.high * scale)}" if known else "-",
        f"x{own.tuning:.3g}" if own.tuning == own.tuning else "-",
        number(own.chattering),
        f"{own.failed}/{own.runs}" if own.runs else "-",
        _beside(line.held_out, scale),
        _beside(line.given, scale),
        own.note,
    ]


def number(x: float) -> str:
    """Return a figure in three digits; a dash for none."""
    return f"{x:.3g}" if math.isfinite(x) else "-"


def _beside(own: Standing | None, scale: float) -> str:
    if own is None or own.value != own.value:
        return "-"
    return f"{ranks(own)}: {number(own.value * scale)}"


def ranks(own: Standing) -> str:
    """Return the ranks that an entry may have: one, or the first and the last."""
    if own.rank is None:
        return "-"
    return str(own.rank) if own.rank == own.last else f"{own.rank}-{own.last}"


def variants(record: Record, level: float, metric: str = "") -> list[tuple[str, str, str, Ratio]]:
    """Return chain, entry, the entry it is a variant of, and its error over that one's.

    Entries with one law are variants of the first of them: what an option is worth.

    Args:
        record: The arena.
        level: Level of chattering.
        metric: As of `lines`.
    """
    found = []
    for chain in record.chains:
        first = dict[str, Row]()
        for row in record.rows:
            if row.chain != chain or row.state:
                continue
            base = first.setdefault(row.law, row)
            if base is not row:
                try:
                    a, b = (record.scores(own, level, metric) for own in (row, base))
                    ratio = compare(a, b, looks=record.looks)
                except ResultError:
                    continue
                found.append((chain, row.entry, base.entry, ratio))
    return found


def worth(record: Record) -> str:
    """Return a remark where no entry is a variant of another; nothing where one is."""
    if len({(row.chain, row.law) for row in record.rows}) < len(record.rows):
        return ""
    return (
        "No part of any law is taken out here, so that nothing tells which part its error is due to: add controllers "
        "with `extends:` that change an option, as studies/arena does for the proposed law."
    )


class Duel(NamedTuple):
    """An entry against another one on a chain."""

    chain: str
    rival: str
    verdict: int
    """1 where the entry beats it, -1 where it is beaten, 0 for a tie."""
    ratio: Ratio
    """The entry's error over the rival's."""


def duels(record: Record, entry: str, level: float, metric: str = "") -> list[Duel]:
    """Return an entry's duels with all others, chain by chain, the best rival first.

    A chain on which the entry is not ranked has none, nor has a rival that is not ranked there.

    Args:
        record: The arena.
        entry: The entry.
        level: Level of chattering.
        metric: As of `lines`.

    Raises:
        ResultError: there is no such entry.
    """
    if entry not in (known := {row.entry for row in record.rows}):
        raise ResultError(f"no entry '{entry}'{did_you_mean(entry, known)}")
    found = []
    for chain in record.chains:
        names = [own.entry for own in record.standings(chain, level, metric) if own.rank is not None]
        shown = {name: record.scores(record.row(f"{chain}/{name}"), level, metric) for name in names}
        if own := shown.pop(entry, None):
            for name, it in shown.items():
                ratio = compare(own, it, looks=record.looks)
                found.append(Duel(chain, name, verdict(own, it, looks=record.looks), ratio))
    return found


def by_condition(record: Record, entry: str, level: float, metric: str = "") -> dict[str, dict[str, dict[str, float]]]:
    """Return chain -> entry and the best other one -> condition -> geometric mean of the metric over what completed.

    Args:
        record: The arena.
        entry: The entry; a chain that has no gains of this level of it is left out.
        level: Level of chattering.
        metric: As of `lines`.
    """
    found = dict[str, dict[str, dict[str, float]]]()
    for chain in record.chains:
        order = [own.entry for own in record.standings(chain, level, metric) if own.value == own.value]
        if entry in order:
            names = [entry, *(name for name in order if name != entry)][:2]
            found[chain] = {name: _means(record, record.row(f"{chain}/{name}"), level, metric) for name in names}
    return found


def _means(record: Record, row: Row, level: float, metric: str) -> dict[str, float]:
    found = {}
    for names, held in ((record.burdens, False), (record.held_out, True)):
        if names:
            own = record.scores(row, level, metric, held_out=held)
            for i, name in enumerate(names):
                found[name] = mean_over_runs(own._replace(values=own.values[:, [i]]))
    return found


def budget(record: Record) -> str:
    """Return the budget in a sentence."""
    loops = max((row.loops for row in record.rows), default=0)
    seconds = max((row.seconds for row in record.rows), default=0.0)
    tuning = (
        f"{record.seeds} tunings of {record.evaluations} sets of gains each, {loops:,} closed loops of {seconds:,.0f} s"
    )
    held = f" and of {len(record.held_out)} held out of kinds that no tuning saw" if record.held_out else ""
    judged = (
        f"{'up to ' * (record.looks > 1)}{record.draws} paired draws of each of {len(record.burdens)} burdens{held}"
    )
    return f"Every law, on every chain: {tuning} together; judged on {judged}"


def rules(record: Record) -> list[str]:
    """Return the rules of the ranking, a sentence or two each."""
    levels = ", ".join(f"{level:g} %" for level in record.levels)
    return [
        f"Laws are compared at equal chattering, {levels} of the torque limit: of each tuning's front those gains are "
        "judged that have the least error at no more chattering.",
        "Error: the geometric mean over tunings, burdens and draws. Two laws tie where the 95 % interval of their "
        "ratio holds 1; in it the spread of draws and that of tunings are added as independent ones, so that a "
        "difference which other tuning seeds would turn round is none. The first rank of a law is 1 + how many are "
        "better, the last one how many are not worse.",
        "A failed run is counted and never averaged: who fails in more runs by more than chance is not better, and is "
        "behind unless single tunings explain it. Two laws are compared in the runs that both complete.",
        f"Who chatters more than {TOLERANCE:g} times the level on the test draws, or has no gains of that level in "
        "some tuning, is not ranked there.",
        "The seed of the test draws was drawn before the first run, its hash stored; it is revealed in the file.",
        "A row whose law is gone, or has changed, has expired: it is shown and not ranked.",
        f"As given: {RULESETS[SELF].partition(': ')[2]}.",
    ]


def _markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(header)} |", "|" + "---|" * len(header), *(f"| {' | '.join(row)} |" for row in rows)]


def markdown(record: Record, picture: str = "", heading: str = "") -> str:
    """Return the tables and the rules as Markdown.

    Args:
        record: The arena.
        picture: Address of the figure; none if left out.
        heading: First line; the arena's name if left out.
    """
    level, unit = main_level(record), unit_of(record)[0]
    title, deeper = METRICS[record.metric].title, "###" if heading.startswith("##") else "##"
    out = [heading or f"# {record.name}", "", f"{record.date}. {budget(record)}.", ""]
    if picture:
        out += [f"![Error against chattering of every law, a panel for each chain]({picture})", ""]
    out += [f"{deeper} Tuned, at {level:g} % chattering", "", f"Rank, and {title} [{unit}]; equal ranks tie.", ""]
    found = lines(record)
    header, rows = overview(record, level)
    marks = {entry: dots(record, entry, found) for entry in by_rank(record, found)}
    told = [[*row, " ".join(text for _, text in marks[row[0]])] for row in rows]
    out += _markdown_table([header[0], *record.chains, "all levels"], told)
    out += ["", f"{KEY}; a group for each chain, a dot for each level.", ""]
    out += [f"{deeper} As given, at {level:g} % chattering", "", "The laws' own gains: what tuning changes.", ""]
    header, rows = overview(record, level, ruleset=SELF)
    out += _markdown_table([header[0], *record.chains], rows)
    for chain in record.chains:
        out += ["", f"{deeper} On the chain {chain}, at {level:g} %", ""]
        own = [line for line in found if line.chain == chain and line.level == level]
        out += _markdown_table(HEAD, [cells(record, line) for line in own])
    out += ["", f"{deeper} What the parts of a law are worth", ""]
    out += [worth(record) or "Error over that of the first entry of the same law [95 %].", ""]
    if parts := [[chain, entry, base, ratio_text(ratio)] for chain, entry, base, ratio in variants(record, level)]:
        out += _markdown_table(["chain", "variant", "of", "ratio"], parts)
    out += ["", f"{deeper} Rules", "", *(f"* {rule}" for rule in rules(record))]
    made = ", ".join(f"{name} {version}" for name, version in record.software.items())
    out += ["", f"Made by {made}. Commitment of the draws: `{record.seal['commitment']}`.", ""]
    return "\n".join(out)


def ratio_text(ratio: Ratio) -> str:
    """Return a ratio with its interval."""
    return "-" if ratio.ratio != ratio.ratio else f"x{ratio.ratio:.3g} [{ratio.low:.3g}, {ratio.high:.3g}]"


def latex(record: Record) -> str:
    """Return a table for each chain at each level, for booktabs."""
    unit, found = unit_of(record)[0], lines(record)
    out = []
    for chain in record.chains:
        for level in record.levels:
            out += [
                "\\begin{table}",
                f"\\caption{{{_tex(METRICS[record.metric].title)} on the chain {_tex(chain)} at {level:g}\\,\\% "
                f"chattering. {_tex(budget(record))}.}}",
                "\\begin{tabular}{rlrrrrr}",
                "\\toprule",
                f"rank & law & error [{_tex(unit)}] & 95\\,\\% & tuning & chattering [\\%] & failed \\\\",
                "\\midrule",
            ]
            for line in found:
                if (line.chain, line.level) == (chain, level):
                    out.append(" & ".join(_tex(cell) for cell in cells(record, line)[:7]) + " \\\\")
            out += ["\\bottomrule", "\\end{tabular}", "\\end{table}", ""]
    return "\n".join(out)


def _tex(text: str) -> str:
    for sign in "&%_#$":
        text = text.replace(sign, f"\\{sign}")
    return text


def write_files(record: Record) -> Iterator[tuple[str, bytes]]:
    """Yield the files that are made of ``arena.json``: name and content of each."""
    from torquebench.arena.figures import fronts
    from torquebench.report.figures.files import figure_bytes
    from torquebench.report.render import PAGE, Picture, render

    figure = fronts(record)
    svg = figure_bytes(figure, "svg")
    yield "figures/fronts.svg", svg
    yield "figures/fronts.png", figure_bytes(figure, "png")
    yield "arena.md", markdown(record, "figures/fronts.svg").encode()
    yield "arena.tex", latex(record).encode()
    found, level, unit = lines(record), main_level(record), unit_of(record)[0]
    yield (
        PAGE,
        render(
            "arena",
            scripts=["page"],
            title=record.name,
            lead=f"{record.date}. {budget(record)}.",
            picture=Picture("Error against chattering", svg),
            order=[(entry, dots(record, entry, found)) for entry in by_rank(record, found)],
            key=KEY,
            head=HEAD,
            metric=f"{METRICS[record.metric].title} [{unit}]",
            lines=[(line, cells(record, line)) for line in found],
            chains=list(record.chains),
            levels=list(record.levels),
            level=level,
            worth=worth(record),
            variants=[(chain, entry, base, ratio_text(ratio)) for chain, entry, base, ratio in variants(record, level)],
            rules=rules(record),
            facts=json.dumps({"software": record.software, "machine": record.machine, "seal": record.seal}, indent=2),
        ),
    )

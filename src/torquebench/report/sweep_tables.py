"""Sentences and tables about a sweep: the best laws, each law over all cases, failures, and the keys that matter."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from torquebench.experiment.reference import unit_of
from torquebench.experiment.sweep_section import in_words
from torquebench.metrics import METRICS
from torquebench.report.tables import Cells
from torquebench.statistics import SMALL, Ratio, draws_needed
from torquebench.sweep.best import Choice, best_choices, conditions, short_names
from torquebench.sweep.border import Level, level_of
from torquebench.sweep.effects import Effect, Effects
from torquebench.sweep.sensitivity import Sensitivity
from torquebench.sweep.summary import Figure, Group, Summary
from torquebench.sweep.table import Table, grid_keys, rows_by

SHOWN = ("rmse", "chattering")
"""Metrics that answers, fronts and figures are about: error against chattering."""
LEFT_OUT = ("steady_state_error", "chattering_peak", "limit_cycle", "hf", "saturation_fraction")
"""Metrics with a column elsewhere that tables of the best have no room for; ``summary.json`` has them."""
BARS = "▁▂▃▄▅▆▇█"
"""From low to high."""
STRIP = 32
"""Characters of an axis of dots."""
Titles = Mapping[str, tuple[str, float]]
"""Title with unit and scale of each metric, as of `headlines`."""


def answer(summary: Summary, titles: Titles) -> list[str]:
    """Return what a sweep says, in sentences: the least error, also of those that chatter little, and what failed.

    Little is no more than a round number that is below half of the best one's chattering.

    Args:
        summary: The sweep's summary.
        titles: Titles and scales of the metrics.
    """
    runs, failed = sum(law.runs for law in summary.overall), sum(law.runs - law.successes for law in summary.overall)
    kinds = [f"{law.controller} {law.runs - law.successes:,}" for law in summary.overall if law.successes < law.runs]
    failures = (
        f"{failed:,} of {runs:,} runs failed: {', '.join(kinds)}.{_who_fails_more(summary)}"
        if failed
        else f"None of {runs:,} runs failed."
    )
    if not set(SHOWN) <= set(summary.metrics):
        return [failures]
    error, chattering = (
        [one for one in best_choices(summary, by) if one.completed == one.runs and set(SHOWN) <= set(one.figures)]
        for by in SHOWN
    )
    if not error:
        return ["No law completed every run of any choice.", failures]
    best, calm, limit = error[0], chattering[0], round_below(0.5 * error[0].figures["chattering"].mean)
    quiet = next((one for one in error if one.figures["chattering"].mean <= limit), calm)
    said = {"Least error": best, f"Least error with at most {limit:g} % of chattering": quiet, "Least chattering": calm}
    if best.figures["chattering"].mean <= calm.figures["chattering"].mean:
        said = {"Least error and least chattering": best}
    elif _values(quiet, summary) == _values(calm, summary):
        said = {"Least error": best, "Least chattering": calm}
    lines = list[str]()
    for what, one in said.items():
        figures = ", ".join(figure_text(one, key, titles) for key in SHOWN)
        text = f"{what}: {choice_text(one, summary)}; {figures}{_worst_of(one, summary) if not lines else ''}"
        lines.append(f"{text}{_shakes(one, error, summary, titles) if not lines else ''}.")
    return [*lines, failures]


def _who_fails_more(summary: Summary) -> str:
    """Return in how many draws each law fails more than the reference, and whether by chance; one draw says nothing."""
    told = [
        f"{law.controller} in {law.outcomes.first} and {law.outcomes.second} (p = {law.outcomes.p:.2g})"
        for law in summary.overall
        if law.outcomes.first + law.outcomes.second > 1
    ]
    draws = summary.overall[0].outcomes.pairs
    text = f" Draws of {draws} with more failures than {summary.reference}, and with fewer, exact McNemar test: "
    return f"{text}{', '.join(told)}." if told else ""


def _shakes(best: Choice, choices: Sequence[Choice], summary: Summary, titles: Titles) -> str:
    """Return that the best choice chatters, where it does, and which is the best that does not.

    Args:
        best: The choice.
        choices: All that completed, by error.
        summary: The sweep's summary.
        titles: Titles and scales of the metrics.
    """
    if not best.chatters:
        return ""
    calm = next((one for one in choices if not one.chatters), None)
    if calm is None:
        return "; it chatters, as does every other choice"
    return f"; it chatters: without chattering, {choice_text(calm, summary)}; {figure_text(calm, SHOWN[0], titles)}"


def round_below(value: float) -> float:
    """Return the greatest of .., 0.3, 1, 3, 10, .. that is not above a value that is not negative."""
    power = 10.0 ** math.floor(math.log10(max(value, 1e-300)))
    return float(f"{3.0 * power if 3.0 * power <= value else power:.1g}")


def choice_text(choice: Choice, summary: Summary) -> str:
    """Return a choice in words: its law, where there are several, and the values that were chosen."""
    names = short_names(summary.grid)
    values = ", ".join(f"{names[key]} {value_text(value)}" for key, value in _values(choice, summary)[1:])
    if values and len(summary.overall) == 1:
        return values
    return f"{choice.controller} with {values}" if values else choice.controller


def value_text(value: float | str) -> str:
    """Return a key's value as it is shown: a number to six digits, or a word."""
    return in_words(value) if isinstance(value, str) else f"{value:.6g}"


def _values(choice: Choice, summary: Summary) -> list[Any]:
    """Return the law, then each key that is chosen, and that it has, with its value."""
    apart = conditions(summary)
    values = [(key, value) for key, value in choice.worst.values.items() if key not in apart and value is not None]
    return [choice.controller, *values]


def _worst_of(choice: Choice, summary: Summary) -> str:
    names = short_names(summary.grid)
    where = [
        f"{names[key]} {value_text(value)}"
        for key in conditions(summary)
        if (value := choice.worst.values[key]) is not None
    ]
    return f", each in the worst of {choice.cases} cases (error: {', '.join(where)})" if choice.cases > 1 else ""


def columns_of(summary: Summary, titles: Titles) -> list[str]:
    """Return the metrics that tables of the best have columns for, those in `SHOWN` first.

    Args:
        summary: The sweep's summary.
        titles: Titles and scales of the metrics.
    """
    return [key for key in dict.fromkeys((*SHOWN, *titles)) if key in summary.metrics and key not in LEFT_OUT]


def figure_text(choice: Choice, key: str, titles: Titles, named: bool = True, ends: bool = True) -> str:
    """Return the mean of a metric, with its 95 % interval where draws differ, to three digits; a dash for none.

    Args:
        choice: Law and gains.
        key: The metric.
        titles: Titles and scales of the metrics.
        named: Whether to say its name and its unit.
        ends: Whether to say the interval.
    """
    figure, (title, scale) = choice.figures.get(key), titles[key]
    name, _, unit = title.rstrip("]").partition(" [")
    if figure is None:
        return f"{name} -" if named else "-"
    mean, low, high = (f"{scale * x:.3g}" if abs(scale * x) < 1000.0 else f"{scale * x:.0f}" for x in figure[1:4])
    text = f"{name} {mean} {unit}".rstrip() if named else mean
    return f"{text} [{low}, {high}]" if ends and math.isfinite(figure.low) else text


def told_choices(summary: Summary, titles: Titles, most: int) -> list[Choice]:
    """Return the best choices, the least error first, at most `most` of them and the best choice of each law."""
    shown, found = columns_of(summary, titles), list[Choice]()
    for place, one in enumerate(best_choices(summary, shown[0]) if shown else ()):
        if place < most or all(other.controller != one.controller for other in found):
            found.append(one)
    return found


def dot_rows(choices: Sequence[Choice], summary: Summary, titles: Titles) -> Cells:
    """Return a row for each choice: a dot for the mean of each metric in `SHOWN`, a line for its interval.

    Args:
        choices: What is shown.
        summary: The sweep's summary.
        titles: Titles and scales of the metrics.
    """
    header, columns = [""], [[choice_text(one, summary) for one in choices]]
    for key in SHOWN:
        known = [one.figures[key] for one in choices if key in one.figures]
        if not known:
            continue
        least, most = min(figure.mean for figure in known), max(figure.mean for figure in known)
        is_wide, scale = least > 0.0 and most > 3.0 * least, titles[key][1]
        ends = f"{scale * least:.3g} to {scale * most:.3g}" if most > least else f"{scale * least:.3g}"
        header.append(f"{titles[key][0]}: {ends}{', logarithmic' * is_wide}")
        columns.append([_strip(one.figures.get(key), least, most, is_wide) for one in choices])
    return header, [list(row) for row in zip(*columns, strict=True)]


def _strip(figure: Figure | None, least: float, most: float, is_wide: bool) -> str:
    """Return a metric's mean as a dot between the least and the greatest of all, with its interval as a line."""
    if figure is None:
        return "no run completed"

    def place(x: float) -> int:
        low, high, x = (math.log(max(y, 1e-300)) if is_wide else y for y in (least, most, x))
        share = (x - low) / (high - low) if high > low else 0.0
        return round((STRIP - 1) * min(max(share, 0.0), 1.0))

    cells = ["·"] * STRIP
    if math.isfinite(figure.low):
        for i in range(place(figure.low), place(figure.high) + 1):
            cells[i] = "─"
    cells[place(figure.mean)] = "●"
    return "".join(cells)


def best_table(choices: Sequence[Choice], summary: Summary, titles: Titles) -> Cells:
    """Return a row of figures for each choice; arguments as of `dot_rows`."""
    shown = columns_of(summary, titles)
    heads = [titles[key][0] for key in shown]
    header = ["controller", *short_names(summary.grid).values(), *heads, "runs", "failed"]
    rows = list[list[str]]()
    for one in choices:
        values = ["-" if value is None else value_text(value) for value in one.worst.values.values()]
        figures = [figure_text(one, key, titles, named=False, ends=key in SHOWN) for key in shown]
        rows.append([one.controller, *values, *figures, f"{one.runs:,}", f"{one.runs - one.completed:,}"])
    return header, rows


def border_table(table: Table) -> Cells:
    """Return a row for each law under each further condition: where it starts to shake along the first key.

    The bars of the second column are the borders, on a logarithmic scale from the least to the greatest of all.

    Args:
        table: A sweep's table with borders.
    """
    along, *apart = [key for key in grid_keys(table) if len(set(table[key].tolist())) > 1] or ["case"]
    places = list(dict.fromkeys(table[along].tolist()))
    found = {at: level_of(table, rows) for at, rows in rows_by(table, "controller", *apart, along).items()}
    known = [x.border for x in found.values() if math.isfinite(x.border)]
    least, most = (min(known), max(known)) if known else (1.0, 1.0)
    short = short_names((along, *apart))
    unit = unit_of(along)
    named = short[along] if unit in (None, "1") else f"{short[along]} [{unit}]"
    header = ["controller", *(short[key] for key in apart), f"{named}:", *map(value_text, places)]
    rows = []
    for own in dict.fromkeys(at[:-1] for at in found):
        levels = [found.get((*own, x)) for x in places]
        bars = "".join(" " if x is None else _bar_of(x.border, least, most) for x in levels)
        words = [value_text(x) for x in own[1:]]
        rows.append([own[0], *words, bars, *("-" if x is None else border_text(x) for x in levels)])
    return header, rows


def border_text(found: Level) -> str:
    """Return a border, where it goes back to stillness beyond it, and what is predicted."""

    def word(x: float) -> str:
        return "none" if math.isinf(x) else f"{x:.3g}"

    if math.isnan(found.border):
        return "-"
    text = "all" if math.isnan(found.before) and math.isfinite(found.border) else word(found.border)
    if not math.isnan(found.last):
        text += f" (still at {word(found.last)})"
    return text if math.isnan(found.predicted) else f"{text} ~{word(found.predicted)}"


def _bar_of(x: float, least: float, most: float) -> str:
    """Return a bar as high as a border lies between the least and the greatest; a full one where there is none."""
    if math.isnan(x):
        return " "
    share = 1.0 if x >= most else math.log(max(x, least) / least) / math.log(most / least)
    return BARS[round(share * (len(BARS) - 1))]


def ratio_text(ratio: Ratio | None) -> str:
    """Format a ratio with its interval, if draws differ, and the number of draws that were left out.

    Where the interval holds 1, it says how many draws would show a change by `SMALL`.
    """
    if ratio is None:
        return "-"
    interval = f" [{ratio.low:.3g}, {ratio.high:.3g}]" if math.isfinite(ratio.low) else ""
    missing = f", {ratio.left_out} left out" if ratio.left_out else ""
    needed = None if ratio.below or ratio.above else draws_needed(ratio)
    more = f", {needed:,} draws show {100.0 * (SMALL - 1.0):.3g} %" if needed and needed > ratio.pairs else ""
    return f"{ratio.ratio:.3g}{interval}{missing}{more}"


def failures_table(summary: Summary) -> Cells:
    """Return a row for each law and case in which runs failed: how many, how, and the earliest of them."""
    rows, names = [], short_names(summary.grid)
    for group in summary.groups:
        first = group.earliest_failure
        if first is not None:
            kinds = ", ".join(f"{n} {kind.lower().replace('_', ' ')}" for kind, n in group.outcomes.items())
            rows.append([group.controller, case_text(group, names), kinds, str(first.row), str(first.draw)])
    return ["controller", "case", "outcomes", "index of the earliest failure", "its draw"], rows


def case_text(group: Group, names: Mapping[str, str]) -> str:
    """Return the values of a case as text; keys that the law does not have are left out.

    Args:
        group: The law in the case.
        names: Names of the keys.
    """
    values = [f"{names[key]} {value_text(value)}" for key, value in group.values.items() if value is not None]
    return ", ".join(values) or "the only case"


class Influence(NamedTuple):
    """Influences on one metric of one law, as text and bars."""

    controller: str
    metric: str
    cases: str
    draws: str
    effects: Sequence[tuple[str, float, float]]
    """Text, left end and width of a bar, from 0 to 100, where 50 is no effect; the strongest first."""
    explained: str


def influences(found: Sequence[Sensitivity]) -> list[Influence]:
    """Return for each law and metric that depends on something on what it does, and how strongly."""
    return [
        Influence(
            one.controller,
            METRICS[one.metric].short_title,
            ", ".join(map(str, one.cases)) if len(one.cases) <= 6 else f"{len(one.cases)} cases",
            str(one.draws),
            [(effect_text(effect), *_bar(effect.strength)) for effect in strongest],
            explained_text(one.effects),
        )
        for one in found
        if one.effects is not None
        and (strongest := sorted((e for e in one.effects.effects if e.matters), key=lambda e: -abs(e.strength)))
    ]


def effect_text(effect: Effect) -> str:
    """Return an effect with its interval."""
    return f"{effect.name} {effect.strength:+.2f} [{effect.low:.2f}, {effect.high:.2f}]"


def _bar(strength: float) -> tuple[float, float]:
    half = 50.0 * min(abs(strength), 1.0)
    return (50.0 if strength > 0.0 else 50.0 - half), half


def explained_text(effects: Effects) -> str:
    """Return how much the inputs explain without their products."""
    explained = effects.explained
    return "one at a time" if explained is None else f"{100 * max(explained, 0.0):.0f} % explained"


def silent_text(found: Sequence[Sensitivity]) -> str:
    """Explain where no effect was found; empty if every law and metric has one."""
    reasons: dict[str, list[str]] = {}
    for one in found:
        if one.effects is None:
            reason = one.reason
        elif any(effect.matters for effect in one.effects.effects):
            continue
        else:
            count = len(one.effects.effects)
            numbers = f"the {count} drawn numbers" if count > 1 else "the drawn number"
            products = f" and of their {one.effects.pairs} products" if one.effects.pairs else ""
            reason = f"of {numbers}{products} none shows an influence in {one.draws} draws"
        reasons.setdefault(reason, []).append(f"{METRICS[one.metric].short_title} of {one.controller}")
    return "; ".join(
        f"{'every metric of every law' if len(names) == len(found) > 2 else ', '.join(dict.fromkeys(names))}: {reason}"
        for reason, names in reasons.items()
    )

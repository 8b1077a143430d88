"""Sweeps from Python: run, read, summarised, compared."""

from __future__ import annotations

import html
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.errors import ConfigError, Problem, ResultError, did_you_mean
from torquebench.experiment.dump import dump_experiment, dump_tree
from torquebench.experiment.groups import SWEEP
from torquebench.experiment.run import Progress
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document, apply_overrides, document_of, read_bytes, read_document
from torquebench.experiment.store import atomic_write
from torquebench.laws.plugin import load_plugin
from torquebench.metrics import METRICS
from torquebench.report.render import PAGE
from torquebench.report.sweep import dependences, info_of, jobs_of, report_files
from torquebench.results import Source as Config
from torquebench.robot.library import ArmFile
from torquebench.shipped import find_config
from torquebench.sweep import run as runs
from torquebench.sweep.best import best_choices
from torquebench.sweep.executors import Processes, Threads
from torquebench.sweep.folder import TABLE, StoredSweep, open_sweep, verify
from torquebench.sweep.plan import Plan, Source
from torquebench.sweep.summary import Summary, summarise
from torquebench.sweep.table import Table, metric_keys, read_table

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


def run_sweep(
    experiment: Experiment | Config,
    *,
    grid: Mapping[str, Any] | None = None,
    random: Mapping[str, Any] | None = None,
    draws: int | None = None,
    changes: Mapping[str, Any] | None = None,
    workers: int | None = None,
    processes: bool = False,
    folder: str | Path | None = None,
    plugins: Sequence[str | Path] = (),
    progress: Progress | None = None,
) -> Sweep:
    """Run an experiment in every case of a grid, in every draw, for every controller.

    Args:
        experiment: An experiment, or a config's file, name or keys, which may have a section ``sweep``.
        grid: Dotted key -> its values, an array or a list, or ``{"from": 0.1, "to": 1, "count": 5, "spacing": "log"}``.
        random: Dotted key -> its distribution, such as ``{"uniform": [9, 11]}``.
        draws: Number of draws of everything that is random.
        changes: Dotted key -> value, set before the check, as of `load_experiment`.
        workers: How many loops run at once; None for one per core.
        processes: Run in processes instead of threads, which is faster for thousands of runs; a script must then do its
            work under ``if __name__ == "__main__":``.
        folder: Where to store it, or where it was stored in part; None for a temporary folder, which is removed when
            Python ends.
        plugins: Python files that register laws of your own.
        progress: Called with what is being done, how many runs are done, and of how many.

    Raises:
        ConfigError: the config has mistakes, all of them at once, or the folder holds something else.
        ResultError: a worker died, or a file of a finished sweep was altered.
    """
    files = tuple(Path(plugin).absolute() for plugin in plugins)
    for file in files:
        load_plugin(file)
    text, name, arms = _config(experiment)
    given = {"grid": grid, "random": random, "draws": draws}
    keys = {key: value for key, value in given.items() if value is not None}
    edits = edits_of(dict(changes or {}) | {f"{SWEEP}.{key}": value for key, value in keys.items()})
    by_hand = isinstance(experiment, Mapping)  # whose paths start where the person works
    plan = Plan(Source(text, name, tuple(edits), files, arms=arms, outside=by_hand))
    count = workers or os.cpu_count() or 1
    if count < 1:
        raise ConfigError([Problem("workers", "", f"got {workers}, wanted at least 1")])

    def more(stored: StoredSweep) -> Iterator[tuple[str, bytes]]:
        return report_files(stored, progress) if folder is not None else iter(())

    stored = runs.run_sweep(
        plan,
        None if folder is None else Path(folder),
        Processes(count) if processes else Threads(count),
        progress=lambda done, rows: None if progress is None else progress("running", done, rows),
        more=more,
    )
    return Sweep(stored)


def _config(experiment: Experiment | Config) -> tuple[bytes, str, tuple[tuple[str, ArmFile], ...]]:
    """Return the text of a sweep, with a section ``sweep``, what to call it in messages, and arms that it names."""
    arms = tuple[tuple[str, ArmFile], ...]()
    if isinstance(experiment, Experiment):
        text, name = dump_experiment(experiment).encode(), experiment.name
        arms = ((str(arm), arm),) if isinstance(arm := experiment.plant.model, ArmFile) else ()
    elif isinstance(experiment, Mapping):
        text, name = dump_tree(tree_of(experiment)).encode(), "experiment"
    else:
        path = find_config(str(experiment))
        text, name = read_bytes(path), str(path)
    root = read_document(text, name).root
    return (text if SWEEP in root else text + f"\n{SWEEP}: {{}}\n".encode()), name, arms


def edits_of(changes: Mapping[str, Any]) -> list[str]:
    """Return changed keys as edits ``key=value``, the value as YAML.

    Raises:
        ConfigError: a value is nothing that YAML can hold.
    """
    edits = []
    for key, value in changes.items():
        try:
            edits.append(f"{key}={json.dumps(value, default=_plain, allow_nan=False)}")
        except (TypeError, ValueError) as error:
            raise ConfigError([Problem("changes", str(key), f"got {value!r}, wanted a value for a config")]) from error
    return edits


def document_from(
    config: str | Path | Mapping[str, Any],
    changes: Mapping[str, Any] | Sequence[str] = (),
    outside: bool = False,
    plugins: Sequence[str | Path] = (),
) -> Document:
    """Return the document of a config with changes, not yet checked.

    Args:
        config: A YAML file, the name of a shipped config, or the keys of one.
        changes: Dotted key -> value, or edits ``key=value``.
        outside: Whether the arm's file may be outside the folder of the config.
        plugins: Python files that register kinds of your own.

    Raises:
        ConfigError: there is no such config, or it is no YAML.
    """
    for file in plugins:
        load_plugin(Path(file))
    if isinstance(config, Mapping):
        document = document_of(config)
    else:
        path = find_config(str(config))
        document = read_document(read_bytes(path), str(path))
    document.outside = outside
    apply_overrides(document, edits_of(changes) if isinstance(changes, Mapping) else list(changes))
    return document


def tree_of(keys: Mapping[str, Any]) -> dict[str, Any]:
    """Return keys of a config, which may hold arrays and paths, as plain values.

    Raises:
        ConfigError: a value is nothing that YAML can hold.
    """
    try:
        tree: dict[str, Any] = json.loads(json.dumps(keys, default=_plain, allow_nan=False))
    except (TypeError, ValueError, RecursionError) as error:
        raise ConfigError([Problem("experiment", "", f"cannot be written as YAML ({error})")]) from error
    return tree


def _plain(value: Any) -> Any:
    """Return what JSON can hold for an array or a number of numpy, or a path."""
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is no value of a config")


def load_sweep(folder: str | Path, plugins: Sequence[str | Path] = ()) -> Sweep:
    """Read the folder of a finished sweep.

    Args:
        folder: Where ``torquebench sweep`` or `run_sweep` left it.
        plugins: Python files that register laws which the sweep uses.

    Raises:
        ConfigError: it is no sweep's folder, or what the sweep is made of has changed.
        ResultError: it is not finished, or a file of it is missing or changed.
    """
    files = tuple(Path(plugin).absolute() for plugin in plugins)
    for file in files:
        load_plugin(file)
    stored = open_sweep(Path(folder), files, "folder", to_read=True)
    if not stored.finished:
        raise ResultError(f"{folder} is not a finished sweep: run it again with this folder to go on with it")
    verify(stored)
    return Sweep(stored)


class Sweep:
    """A finished sweep: its table, a row for each closed loop, and what it says.

    Args:
        stored: The sweep's folder.
    """

    def __init__(self, stored: StoredSweep) -> None:
        self.stored = stored
        """The sweep and the folder that it is stored in."""

    @property
    def folder(self) -> Path:
        """Folder in which the sweep is stored."""
        return self.stored.folder

    @cached_property
    def _table(self) -> Table:
        return read_table(self.folder / TABLE)

    def to_dataframe(self) -> pd.DataFrame:
        """Return the table, a row for each closed loop.

        Columns: ``index, case, draw, controller, outcome, failed_at``, every varied key, every metric in SI units. A
        run that failed has an outcome and no metrics. ``attrs["units"]`` has the units of the metrics.
        """
        import pandas as pd

        table = pd.DataFrame(self._table)
        table.attrs["units"] = {key: info.unit for key, info in METRICS.items() if key in table}
        return table

    @cached_property
    def statistics(self) -> Summary:
        """Everything that is said of the sweep: tails, worst runs, intervals, ratios to the first controller."""
        return summarise(self._table)

    @property
    def summary(self) -> pd.DataFrame:
        """Each controller in each case: the grid's keys, numbers of runs, and means of the runs that completed."""
        import pandas as pd

        rows = [
            dict(group.values)
            | {"runs": sum(group.outcomes.values()), "completed": group.outcomes.get("COMPLETED", 0)}
            | {key: figure.mean for key, figure in group.figures.items()}
            for group in self.statistics.groups
        ]
        keys = [(group.case, group.controller) for group in self.statistics.groups]
        columns = [*self.statistics.grid, "runs", "completed", *metric_keys(self._table)]
        index = pd.MultiIndex.from_tuples(keys, names=["case", "controller"])
        table = pd.DataFrame(rows, index=index, columns=columns)
        table.attrs["units"] = {key: METRICS[key].unit for key in columns if key in METRICS}
        return table

    def best(
        self, metric: str = "rmse", where: Mapping[str, Any] | None = None, over: Sequence[str] | None = None
    ) -> pd.DataFrame:
        """Return every law with every choice of gains that completed all runs, the best mean of a metric first.

        Where the grid has conditions besides, such as a payload, a law counts as in the worst of them, each metric in
        its own worst; ``case`` and keys are those in which `metric` is worst. Columns: the grid's keys, ``cases`` and
        ``runs`` behind the row, the metric with the ``low`` and ``high`` end of its 95 % interval, the other metrics.

        Args:
            metric: Key of the metric, such as ``rmse``.
            where: Metric or key, by its full or its short name -> what it has to be, a text or a value:
                ``{"chattering": "<= 1", "phi": "> 0.1", "chain": "ideal"}``; metrics in SI units.
            over: Keys in whose worst value a law counts; None for those that are no controller's, ``()`` for none.

        Raises:
            ConfigError: there is no such metric or key, or a condition is none.
            ResultError: no law completes every run and meets the conditions.
        """
        import pandas as pd

        summary = self.statistics
        best = [one for one in best_choices(summary, metric, where, over) if one.completed == one.runs]
        best = [one for one in best if metric in one.figures]
        if not best:
            raise ResultError(f"no law completes every run{f' and meets {dict(where)}' if where else ''}")
        rows = []
        for one in best:
            own, figure = {"cases": one.cases, "runs": one.runs}, one.figures[metric]
            ends = {metric: figure.mean, "low": figure.low, "high": figure.high}
            rows.append({**one.worst.values, **own, **ends, **{key: x.mean for key, x in one.figures.items()}})
        keys = [(one.worst.case, one.controller) for one in best]
        columns = dict.fromkeys([*summary.grid, "cases", "runs", metric, "low", "high", *summary.metrics])
        return pd.DataFrame(
            rows, columns=list(columns), index=pd.MultiIndex.from_tuples(keys, names=["case", "controller"])
        )

    def experiment(self, row: int) -> Experiment:
        """Return the experiment of one row of the table, with its controller alone, to run it again.

        Args:
            row: Its ``index``.

        Raises:
            ResultError: there is no such row.
        """
        plan = self.stored.plan
        if not 0 <= row < plan.rows:
            raise ResultError(f"no row {row} in this sweep, wanted 0 to {plan.rows - 1}")
        return plan.experiment_of(plan.row(row))

    def figure(self, name: str) -> Figure:
        """Draw a figure of the sweep: ``spread``, ``front``, ``over-KEY``, ``map-METRIC`` or ``effects-METRIC``.

        Args:
            name: The figure, as its file is called in a sweep's folder.

        Raises:
            ResultError: this sweep has no such figure.
        """
        jobs = jobs_of(info_of(self.stored), self._table, dependences(self.stored, self._table))
        if name not in jobs:
            raise ResultError(f"no figure '{name}' of this sweep{did_you_mean(name, jobs)}")
        return jobs[name]()

    def report(self, path: str | Path | None = None) -> bytes:
        """Return the page of the sweep, HTML that stands alone.

        Args:
            path: File to write the page to as well; None for none.

        Raises:
            ResultError: the sweep is too large for one.
        """
        page = dict(report_files(self.stored)).get(PAGE)
        if page is None:
            raise ResultError(f"{self.folder}: has too many runs for a page; the table has them")
        if path is not None:
            atomic_write(Path(path), page)
        return page

    def __repr__(self) -> str:
        """Name the sweep and its size."""
        plan = self.stored.plan
        return (
            f"<Sweep {plan.first.name}: {plan.cases} cases x {plan.draws} draws x {len(plan.controllers)} controllers>"
        )

    def _repr_html_(self) -> str:
        """Show the summary in a notebook."""
        table = self.summary.reset_index().to_html(index=False, border=0, float_format=lambda x: f"{x:.4g}", na_rep="-")
        return f"<p><b>{html.escape(self.stored.plan.first.name)}</b><br>{html.escape(repr(self)[1:-1])}</p>{table}"
